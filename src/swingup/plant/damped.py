"""A step of the midpoint rule with implicit friction, once for NumPy's policies and for JAX.

Smoothed Coulomb friction cf arctan(100 q̇) is stiff: near rest an explicit step of 2 ms may overshoot, and the
estimator's prediction takes longer ones. Here friction is linear about the rates v that an explicit step would use,
and acts on the rates at the step's end (implicit Euler):

    (M + h D) a = G + u - C v - F(v) + D (v - v₀),    D = diag(b + 100 cf / (1 + (100 v)²)),    q̇ = v₀ + h a

A joint at rest stays there whatever the step. A step overshoots only where friction alone reverses a joint
within it, h cf π/2 > M |v|, and by no more than that. Without friction this is the explicit midpoint rule.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from . import equations
from .equations import COULOMB_STEEPNESS, Lumped, Number, Pair, StateFloats
from .maths import Maths


class Friction(NamedTuple):
    """Friction b q̇ + cf arctan(100 q̇) of both joints."""

    damping: Pair
    """b of shoulder and elbow (N m s/rad)."""
    coulomb: Pair
    """cf (N m)."""


def damped_midpoint_step(
    plant: Lumped, friction: Friction | None, x: Any, torques: Any, dt: Number, maths: Maths
) -> StateFloats:
    """One step over dt (s) from x = [q1, q2, dq1, dq2] (rad, rad/s) under torques (N m)."""
    # The first evaluation only finds the middle. The second makes the step, from x and over all of dt.
    half, rates = 0.5 * dt, (x[2], x[3])
    a1, a2 = _acceleration(plant, friction, (x[0], x[1]), rates, rates, torques, half, maths)
    middle = x[0] + half * x[2], x[1] + half * x[3]
    v1, v2 = x[2] + half * a1, x[3] + half * a2
    a1, a2 = _acceleration(plant, friction, middle, (v1, v2), rates, torques, dt, maths)
    return x[0] + dt * v1, x[1] + dt * v2, x[2] + dt * a1, x[3] + dt * a2


def _acceleration(
    plant: Lumped,
    friction: Friction | None,
    angles: Pair,
    rates: Pair,
    first: Pair,
    torques: Any,
    step: Number,
    maths: Maths,
) -> Pair:
    """q̈ (rad/s²) with friction linear about the rates, for a step (s) that starts from the first ones (rad/s)."""
    (sin1, _), (sin2, cos2) = maths.sine_cosine(angles[0]), maths.sine_cosine(angles[1])
    sines = sin1, sin2, maths.sine_cosine(angles[0] + angles[1])[0]
    if friction is None:
        return equations.acceleration(plant, sines, cos2, rates, torques)
    (b1, b2), (cf1, cf2) = friction
    slope1, loss1 = _linear(b1, cf1, rates[0], first[0], maths.arctan)
    slope2, loss2 = _linear(b2, cf2, rates[1], first[1], maths.arctan)
    # h D adds to the diagonal of M, where rotor inertia stands: `reflected` in M11 and M22, `rotor` in M11 alone.
    drag1, drag2 = step * slope1, step * slope2
    dragged = Lumped(*plant[:5], plant.reflected + drag2, plant.geared, plant.rotor + (drag1 - drag2))
    return equations.acceleration(dragged, sines, cos2, rates, torques, (loss1, loss2))


def _linear(b: Number, cf: Number, rate: Number, start: Number, arctan: Callable[[Any], Any]) -> Pair:
    """The slope of a joint's friction at a rate, and what the straight line there has at the first rate (N m)."""
    steep = COULOMB_STEEPNESS * rate
    slope = b + COULOMB_STEEPNESS * cf / (1.0 + steep * steep)
    return slope, equations.friction(b, cf, rate, arctan) - slope * (rate - start)
