"""The policies that the package ships."""

from importlib import resources
from typing import Any

from ..physics.parameters import Robot, get_robot
from .learned import PolicyController, load_policy

SHIPPED = "ar-eapo"
"""Name of the shipped policies' controller."""


def shipped_policy(robot: Robot | str) -> tuple[PolicyController, dict[str, Any]]:
    """The policy that the package ships for a robot, and its metadata.

    Raises:
        SwingupError: there is no such robot.
    """
    robot = get_robot(robot)
    with resources.as_file(resources.files("swingup") / "zoo" / f"{robot.name}.npz") as path:
        return load_policy(path, robot)
