"""From a controller's one torque to those of both joints, within the limit of the plant's own motor."""

import jax.numpy as jnp

from ...common.types import Scalar, Torque
from ...plant.robots import Robot


def joint_torques(u: Scalar, robot: Robot, limit: Scalar | float) -> Torque:
    """Both joints' torques (N m): u, clipped to the limit, on the driven joint and 0 on the passive one."""
    return jnp.clip(u, -limit, limit) * jnp.array(robot.actuation, u.dtype)
