"""The goal, upright at rest, and a wrapping of angles that has no jump there."""

from typing import TypeVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..common.types import State

Angle = TypeVar("Angle", Array, np.ndarray)

UPRIGHT = np.array([np.pi, 0.0, 0.0, 0.0])
"""The goal g = [q1, q2, dq1, dq2] (rad, rad/s)."""


def wrap(x: State) -> State:
    """The state with q1 in [0, 2π) and q2 in [-π, π): both angles are continuous around upright."""
    return jnp.concatenate([jnp.array([jnp.mod(x[0], 2 * jnp.pi), wrap_difference(x[1])]), x[2:]])


def wrap_difference(angle: Angle) -> Angle:
    """Wrap differences of angles (rad) to [-π, π). Small ones lose digits, unlike in ``Maths.nearest``."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
