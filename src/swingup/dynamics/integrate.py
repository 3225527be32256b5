"""Fixed-step integrators with the torque held over the step (zero-order hold).

They are explicit: a step far above 10 ms is neither accurate nor stable for this pendulum, and the smoothed Coulomb
friction of a short link asks for less than 2 ms.
"""

import math

import jax

from ..common.types import Scalar, State, Torque
from ..plant.equations import COULOMB_STEEPNESS, lump, mass_entries
from ..plant.plant import Plant
from .dynamics import derivative

LARGEST_STIFFNESS = 2.5
"""Largest λ dt of one step of RK4, which diverges above 2.79; C.1 as identified has 2.26 at 2 ms."""

ELBOWS = 9
"""Values of cos(q2) at which the mass matrix is looked at."""


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
    """Steps of RK4 in which dt (s) has to be taken, so that friction near rest stays stable: 1 without friction."""
    return max(1, math.ceil(friction_rate(parameters) * dt / LARGEST_STIFFNESS))


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
