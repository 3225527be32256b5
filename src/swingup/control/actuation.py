"""From a controller's one torque to those of both joints, within the limit of the plant's own motor."""

import jax.numpy as jnp

from ..physics.plant import Plant
from ..robots import Robot
from ..types import Scalar, Torque


def driven_limit(plant: Plant, robot: Robot) -> Scalar | float:
    """The torque limit of the motor that drives a plant (N m)."""
    return (plant.tl1, plant.tl2)[robot.joint]


def joint_torques(u: Scalar, robot: Robot, limit: Scalar | float) -> Torque:
    """Both joints' torques (N m): u, clipped to the limit, on the driven joint and 0 on the passive one."""
    return jnp.clip(u, -limit, limit) * jnp.array(robot.actuation, u.dtype)
