"""A fixed-step integrator whose Coulomb friction is implicit: stable on any plant, at a third of RK4's cost.

The smoothed Coulomb friction cf arctan(s q̇) has the slope cf s at rest. Explicit methods need λ dt below 2 to 2.8,
with λ the largest eigenvalue of M⁻¹ diag(cf s). At 2 ms it is 2.3 on design C.1, 4.7 on a link of 5 cm and 0.1 kg.

Half a step of drift, a kick, half a step of drift, with everything but friction at the middle:

    q½ = q + dt/2 q̇
    M(q½) (q̇' - q̇) = dt [u + G(q½) - C(q½, v) v - diag(b) v - diag(cf) arctan(s q̇')],   v = (q̇ + q̇') / 2
    q' = q½ + dt/2 q̇'

Second order where friction is smooth, exact where Coulomb friction is constant; first order where a joint stops.
"""

from typing import NamedTuple, TypeAlias

import jax.numpy as jnp

from ..types import Scalar, State, Torque
from .equations import COULOMB_STEEPNESS, Lumped, Number, Pair, coriolis, gravity, lump, mass_entries
from .parameters import Parameters
from .trigonometry import sine_cosine

Numbers: TypeAlias = tuple[Number, Number, Number, Number]
"""One number for each of q1, q2, dq1, dq2."""


class Friction(NamedTuple):
    """Friction of both joints."""

    damping: Pair
    """b1, b2 (N m s/rad)."""
    coulomb: Pair
    """cf1, cf2 (N m)."""
    steepness: Number = COULOMB_STEEPNESS
    """Slope s of the smoothed Coulomb friction (s/rad)."""


def implicit_friction_step(
    parameters: Parameters, x: State, u: Torque, dt: float | Scalar, steepness: float = COULOMB_STEEPNESS
) -> State:
    """One step over dt (s), with the torque held and friction implicit."""
    p = parameters
    friction = Friction((p.b1, p.b2), (p.cf1, p.cf2), steepness)
    after = advance(lump(p), friction, (x[0], x[1], x[2], x[3]), (u[0], u[1]), dt)
    return jnp.stack(after)


def advance(plant: Lumped, friction: Friction, x: Numbers, u: Pair, dt: Number) -> Numbers:
    """The same step on one number for each part of the state, which vectorises better."""
    q1, q2, dq1, dq2 = x
    half1, half2 = q1 + 0.5 * dt * dq1, q2 + 0.5 * dt * dq2
    (sin1, _), (sin2, cos2), (sin12, _) = sine_cosine(half1), sine_cosine(half2), sine_cosine(half1 + half2)
    mass, pull = mass_entries(plant, cos2), gravity(plant, sin1, sin12)
    (m11, m12, m22), (b1, b2) = mass, friction.damping
    # Momentum after the kick, but for Coriolis' and the friction's parts.
    pushed1 = m11 * dq1 + m12 * dq2 + dt * (u[0] + pull[0] - 0.5 * b1 * dq1)
    pushed2 = m12 * dq1 + m22 * dq2 + dt * (u[1] + pull[1] - 0.5 * b2 * dq2)
    mass = (m11 + 0.5 * dt * b1, m12, m22 + 0.5 * dt * b2)
    # Newton's method converges from 0 on any side, since arctan is steepest there: at rest, its slope is cf s.
    after: Pair = (0.0 * dq1, 0.0 * dq2)
    rates: Pair = (dq1, dq2)
    for _ in range(2):
        swing1, swing2 = coriolis(plant, sin2, *rates)
        target = (pushed1 - dt * swing1, pushed2 - dt * swing2)
        for _ in range(2):
            after = _newton(mass, friction, target, after, dt)
        rates = (0.5 * (dq1 + after[0]), 0.5 * (dq2 + after[1]))
    return half1 + 0.5 * dt * after[0], half2 + 0.5 * dt * after[1], after[0], after[1]


def _newton(mass: tuple[Number, Number, Number], friction: Friction, target: Pair, rates: Pair, dt: Number) -> Pair:
    """One step of Newton's method for M v + dt cf arctan(s v) = target."""
    (m11, m12, m22), (v1, v2), s = mass, rates, friction.steepness
    hold1, hold2 = dt * friction.coulomb[0], dt * friction.coulomb[1]
    slope1, slope2 = hold1 * s / (1.0 + (s * v1) ** 2), hold2 * s / (1.0 + (s * v2) ** 2)
    right1 = target[0] - hold1 * jnp.arctan(s * v1) + slope1 * v1
    right2 = target[1] - hold2 * jnp.arctan(s * v2) + slope2 * v2
    a11, a22 = m11 + slope1, m22 + slope2
    determinant = a11 * a22 - m12 * m12
    return (a22 * right1 - m12 * right2) / determinant, (a11 * right2 - m12 * right1) / determinant
