"""What a network computes, once for NumPy and JAX: the stages of an observation.

Arguments are arrays of NumPy or JAX, ``xp`` is their module. The linear maps and the activations stand with each
back end: JAX's have gradients of their own and a form for batches, NumPy's work in buffers.
"""

import math
from typing import Any

from ...plant.maths import TURN

Array = Any


def pendulum_features(xp: Any, x: Array, angles: str, scale: float) -> Array:
    """The state x = [q1, q2, dq1, dq2] (rad, rad/s) as a network sees it; every entry lies in [-1, 1].

    ``wrapped`` is the paper's [(q1 mod 2π - π)/π, (q2 mod 2π - π)/π, dq1/s, dq2/s] (after Zhang et al.): upright
    lies on its jump at q2 = 0. ``sincos`` is [sin q1, cos q1, sin q2, cos q2, dq1/s, dq2/s], which has no jump.
    Velocities are clipped to ±s (rad/s) first. mod is the non-negative remainder.
    """
    q, velocities = x[:2], clipped(xp, x[2:], scale) / scale
    if angles == "wrapped":
        return xp.concatenate([(xp.mod(q, TURN) - math.pi) / math.pi, velocities])
    sines, cosines = xp.sin(q), xp.cos(q)
    return xp.concatenate([sines[:1], cosines[:1], sines[1:], cosines[1:], velocities])


def normalised(xp: Any, observation: Array, mean: Array, variance: Array, clip: float, epsilon: float) -> Array:
    """(o - mean) / sqrt(variance + ε) within ± clip; an observation may have leading axes."""
    return clipped(xp, (observation - mean) / xp.sqrt(variance + epsilon), clip)


def plant_features(xp: Any, base: Array, centre: Array, scale: Array, clip: float) -> Array:
    """What a network sees of base parameters θ (9,): (θ - centre) / scale within ± clip."""
    return clipped(xp, (base - centre) / scale, clip)


def clipped(xp: Any, values: Array, most: float) -> Array:
    """Values within ± most; NaN stays."""
    return xp.minimum(xp.maximum(values, -most), most)
