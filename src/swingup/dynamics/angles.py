"""The goal, upright at rest, and a wrapping of angles that has no jump there."""

from typing import TypeVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.types import State

Angle = TypeVar("Angle", Array, np.ndarray)

UPRIGHT = np.array([np.pi, 0.0, 0.0, 0.0])
"""The goal g = [q1, q2, dq1, dq2] (rad, rad/s)."""


def wrap(x: State) -> State:
    """The state with q1 in [0, 2π) and q2 in [-π, π): both angles are continuous around upright."""
    return jnp.concatenate([jnp.array([jnp.mod(x[0], 2 * jnp.pi), wrap_difference(x[1])]), x[2:]])


def upright_error(x: Float[np.ndarray, "*n 4"]) -> Float[np.ndarray, "*n 4"]:
    """How far states are off upright at rest (rad, rad/s), angles to the nearest turn."""
    error = np.asarray(x, np.float64) - UPRIGHT
    error[..., :2] = wrap_difference(error[..., :2])
    return error


def wrap_difference(angle: Angle) -> Angle:
    """Wrap differences of angles (rad) to [-π, π). Small ones lose digits, unlike in ``Maths.nearest``."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
