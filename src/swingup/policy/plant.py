"""The estimator's model in plain floats.

The state is x = [q1, q2, dq1, dq2] (rad, rad/s). The equations of motion stand in ``plant/equations.py``. The
estimator calls them for one state at a time, where a dozen numbers are fastest as Python's own.
"""

import math

from ..plant import equations
from ..plant.damped import Friction, damped_midpoint_step
from ..plant.equations import Lumped, StateFloats
from ..plant.maths import NUMPY


def acceleration(plant: Lumped, x: StateFloats, u1: float, u2: float) -> tuple[float, float]:
    """q̈ (rad/s²) of M(q) q̈ = G(q) + u - C(q, q̇) q̇; NaN where an angle is not finite."""
    q1, q2, dq1, dq2 = x
    if not math.isfinite(q1 + q2):  # for which math.sin raises an error
        return math.nan, math.nan
    sines = math.sin(q1), math.sin(q2), math.sin(q1 + q2)
    first, second = equations.acceleration(plant, sines, math.cos(q2), (dq1, dq2), (u1, u2))
    return first, second


def torque_response(plant: Lumped, x: StateFloats, u1: float, u2: float) -> tuple[float, float]:
    """∂q̈/∂u · u = M(q)⁻¹ u (rad/s²)."""
    first, second = equations.response(plant, math.cos(x[1]) if math.isfinite(x[1]) else math.nan, (u1, u2))
    return first, second


def midpoint_step(plant: Lumped, x: StateFloats, u1: float, u2: float, dt: float) -> StateFloats:
    """One step of the explicit midpoint rule over dt (s)."""
    q1, q2, dq1, dq2 = x
    a1, a2 = acceleration(plant, x, u1, u2)
    half = 0.5 * dt
    v1, v2 = dq1 + half * a1, dq2 + half * a2
    a1, a2 = acceleration(plant, (q1 + half * dq1, q2 + half * dq2, v1, v2), u1, u2)
    return q1 + dt * v1, q2 + dt * v2, dq1 + dt * a1, dq2 + dt * a2


def model_step(
    plant: Lumped, friction: Friction | None, x: StateFloats, u1: float, u2: float, dt: float
) -> StateFloats:
    """One step over dt (s), with friction if there is any."""
    if friction is None:
        return midpoint_step(plant, x, u1, u2, dt)
    return damped_midpoint_step(plant, friction, x, (u1, u2), dt, NUMPY)
