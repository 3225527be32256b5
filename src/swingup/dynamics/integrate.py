"""Fixed-step integrators with the torque held over the step (zero-order hold).

RK4 is explicit: a step far above 10 ms is neither accurate nor stable for this pendulum, and the smoothed Coulomb
friction of a short link asks for less than 2 ms. :func:`implicit_step` is stable on any plant.
"""

import math

import jax

from ..common.errors import SwingupError, one_line
from ..common.types import Scalar, State, Torque
from ..plant.equations import COULOMB_STEEPNESS, Friction, Lumped, Number, Pair, StateFloats, gravity, mass_entries
from ..plant.plant import Plant, lump
from .dynamics import derivative
from .trigonometry import arctan, sine_cosine

LARGEST_STIFFNESS = 2.5
"""Largest λ dt of one step of RK4, which diverges above 2.79; C.1 as identified has 2.26 at 2 ms."""

MOST_SUBSTEPS = 10_000  # A plant that needs more is no pendulum, and would run for hours

NEWTON_STEPS = 4
"""From rest; each squares the error once it is near. No residual is checked.

Against 40 steps, the rates after 1 ms (small links: 0.5 ms) differ by at most 5e-5 rad/s on A.0, B.0, C.1 and
CloudPendulum, and after twice that by 2e-3 rad/s. With five times their Coulomb friction they differ by up to 0.05
and 0.2 rad/s. Measured on 200,000 random states and torques of each.
"""

ELBOWS = 9  # Values of cos(q2) at which the mass matrix is looked at


def friction_rate(parameters: Plant) -> float:
    """λ (1/s), the largest eigenvalue of M(q)⁻¹ diag(b + 100 cf): how fast friction slows a joint near rest."""
    p = parameters
    d1, d2 = (float(b + COULOMB_STEEPNESS * cf) for b, cf in ((p.b1, p.cf1), (p.b2, p.cf2)))
    rates = []
    for index in range(ELBOWS):
        m11, m12, m22 = mass_entries(lump(p), 2 * index / (ELBOWS - 1) - 1)
        determinant = float(m11 * m22 - m12 * m12)
        # Both eigenvalues are real, since M is symmetric; rounding may not make the root's argument negative.
        half = 0.5 * float(m22 * d1 + m11 * d2) / determinant
        rates.append(half + math.sqrt(max(0.0, half * half - d1 * d2 / determinant)))
    return max(rates)


def stable_substeps(parameters: Plant, dt: float) -> int:
    """Steps of RK4 in which dt (s) has to be taken, so that friction near rest stays stable: 1 without friction.

    Raises:
        SwingupError: they are more than ``MOST_SUBSTEPS``.
    """
    rate = friction_rate(parameters)
    if not rate * dt / LARGEST_STIFFNESS <= MOST_SUBSTEPS:
        raise SwingupError(
            f"{one_line(parameters.name)}: friction would stop its joints within {1 / rate:.1g} s, too fast to "
            "simulate: check b1, b2 (N m s/rad), cf1, cf2 (N m) and the inertias"
        )
    return max(1, math.ceil(rate * dt / LARGEST_STIFFNESS))


def rk4_steps(parameters: Plant, x: State, u: Torque, dt: float | Scalar, number: int) -> State:
    """A number of equal steps of RK4 over dt (s) in all."""
    if number == 1:
        return rk4_step(parameters, x, u, dt)
    # A loop, since compiling many copies of a step takes long.
    return jax.lax.fori_loop(0, number, lambda _, at: rk4_step(parameters, at, u, dt / number), x)


def rk4_step(parameters: Plant, x: State, u: Torque, dt: float | Scalar) -> State:
    """One step of the classical fourth-order Runge-Kutta method over dt (s)."""
    k1 = derivative(parameters, x, u)
    k2 = derivative(parameters, x + 0.5 * dt * k1, u)
    k3 = derivative(parameters, x + 0.5 * dt * k2, u)
    k4 = derivative(parameters, x + dt * k3, u)
    return x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def implicit_step(
    plant: Lumped, friction: Friction, x: StateFloats, u: Pair, dt: Number, steepness: Number = COULOMB_STEEPNESS
) -> StateFloats:
    """One step over dt (s) with implicit friction: stable on any plant, with one evaluation of the sines.

    The smoothed Coulomb friction cf arctan(s q̇) has the slope cf s at rest. Explicit methods need λ dt below 2 to
    2.8, with λ the largest eigenvalue of M⁻¹ diag(cf s). At 2 ms it is 2.3 on design C.1, 4.7 on a link of 5 cm and
    0.1 kg.

    Half a step of drift, a kick, half a step of drift, with everything at the middle of the step:

        q½ = q + dt/2 q̇
        M(q½) (q̇' - q̇) = dt [u + G(q½) - C(q½, v) v - diag(b) v - diag(cf) arctan(s v)],   v = (q̇ + q̇') / 2
        q' = q½ + dt/2 q̇'

    Second order, and stable for every λ dt. Newton's method solves for v. Derivatives pass through its last step
    alone, which has those of the solution: at a root, the step does not depend on where it starts.

    The state is one number for each of its parts, which vectorises better than an array.
    """
    q1, q2, dq1, dq2 = x
    half1, half2 = q1 + 0.5 * dt * dq1, q2 + 0.5 * dt * dq2
    (sin1, _), (sin2, cos2), (sin12, _) = sine_cosine(half1), sine_cosine(half2), sine_cosine(half1 + half2)
    mass, pull = mass_entries(plant, cos2), gravity(plant, sin1, sin12)
    (m11, m12, m22), (b1, b2) = mass, friction.damping
    # Half the kick leads from q̇ to v. The rest is Coriolis' torque, and friction.
    half = 0.5 * dt
    pushed1 = m11 * dq1 + m12 * dq2 + half * (u[0] + pull[0])
    pushed2 = m12 * dq1 + m22 * dq2 + half * (u[1] + pull[1])
    # Damping is linear in v and joins the mass. Coulomb friction and Coriolis' torque are left to Newton's method.
    mass = (m11 + half * b1, m12, m22 + half * b2)
    holds: Pair = (half * friction.coulomb[0], half * friction.coulomb[1])
    # From 0 the method converges on any side, since arctan is steepest there: at rest, its slope is cf s.
    mean: Pair = (0.0 * dq1, 0.0 * dq2)
    for _ in range(NEWTON_STEPS):
        # Only the last step's derivative is kept, which is that of the solution.
        mean = (jax.lax.stop_gradient(mean[0]), jax.lax.stop_gradient(mean[1]))
        mean = _newton(mass, holds, half * plant.coupling * sin2, (pushed1, pushed2), mean, steepness)
    after1, after2 = 2.0 * mean[0] - dq1, 2.0 * mean[1] - dq2
    return half1 + half * after1, half2 + half * after2, after1, after2


def _newton(
    mass: tuple[Number, Number, Number], holds: Pair, swing: Number, target: Pair, rates: Pair, s: Number
) -> Pair:
    """One step of Newton's method for M v + swing [-v2 (2 v1 + v2), v1²] + holds arctan(s v) = target."""
    (m11, m12, m22), (hold1, hold2), (v1, v2) = mass, holds, rates
    left1 = target[0] - m11 * v1 - m12 * v2 + swing * v2 * (2.0 * v1 + v2) - hold1 * arctan(s * v1)
    left2 = target[1] - m12 * v1 - m22 * v2 - swing * v1 * v1 - hold2 * arctan(s * v2)
    j11 = m11 + hold1 * s / (1.0 + (s * v1) ** 2) - 2.0 * swing * v2
    j12, j21 = m12 - 2.0 * swing * (v1 + v2), m12 + 2.0 * swing * v1
    j22 = m22 + hold2 * s / (1.0 + (s * v2) ** 2)
    determinant = j11 * j22 - j12 * j21
    return v1 + (j22 * left1 - j12 * left2) / determinant, v2 + (j11 * left2 - j21 * left1) / determinant
