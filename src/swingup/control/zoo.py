"""The policies that the package ships."""

from importlib import resources
from typing import Any

from ..physics.parameters import Robot
from ..runtime.shipped import REFINED, shipped_file
from .learned import PolicyController, load_policy


def shipped_policy(robot: Robot | str, name: str = REFINED) -> tuple[PolicyController, dict[str, Any]]:
    """A policy that the package ships for a robot, without an estimator, and its metadata.

    Args:
        robot: which joint is driven.
        name: ``refined``, ``ar-eapo``, ``global`` or ``robot``.

    Raises:
        SwingupError: there is no such robot or policy, or the package lacks the file.
    """
    with resources.as_file(shipped_file(robot, name)) as path:
        return load_policy(path, robot)
