"""Upright at rest, where every swing-up ends, and what controllers have in common there."""

import jax.numpy as jnp
import numpy as np

from ..physics.parameters import TORQUE_LIMIT, Robot
from ..types import Scalar, State, Torque

UPRIGHT = np.array([np.pi, 0.0, 0.0, 0.0])
"""The goal [q1, q2, dq1, dq2] (rad, rad/s)."""


def wrap(x: State) -> State:
    """The state with q1 in [0, 2π) and q2 in [-π, π), where neither jumps near upright."""
    return jnp.stack([jnp.mod(x[0], 2 * jnp.pi), wrap_error(x[1]), x[2], x[3]])


def wrap_error(angle: Scalar) -> Scalar:
    """An angle in [-π, π) (rad)."""
    return jnp.mod(angle + jnp.pi, 2 * jnp.pi) - jnp.pi


def drive(u: Scalar, robot: Robot, limit: float = TORQUE_LIMIT) -> Torque:
    """Both joints' torques (N m): u, clipped to the limit, on the driven joint and 0 on the passive one."""
    return jnp.clip(u, -limit, limit) * jnp.array(robot.actuation, u.dtype)
