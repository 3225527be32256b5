"""The policies that the package ships."""

from importlib import resources
from typing import Any

from ..physics.parameters import Robot
from ..runtime.shipped import BASE as BASE
from ..runtime.shipped import GLOBAL as GLOBAL
from ..runtime.shipped import KINDS as KINDS
from ..runtime.shipped import SHIPPED as SHIPPED
from ..runtime.shipped import shipped_file
from .learned import PolicyController, load_policy


def shipped_policy(robot: Robot | str, kind: str = "") -> tuple[PolicyController, dict[str, Any]]:
    """A policy that the package ships for a robot, without an estimator, and its metadata.

    Args:
        robot: which joint is driven.
        kind: nothing, ``base`` or ``global``.

    Raises:
        SwingupError: there is no such robot or kind, or the package lacks the file.
    """
    with resources.as_file(shipped_file(robot, kind)) as path:
        return load_policy(path, robot)
