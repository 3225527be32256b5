"""The policies that the package ships."""

from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any

from ..errors import SwingupError
from ..physics.parameters import Robot, get_robot
from .learned import PolicyController, load_policy

SHIPPED = "ar-eapo"
"""Name of the shipped policies' controller: refined, with an estimator."""
BASE = "ar-eapo-base"
"""Name of the policies that these were refined from, as AR-EAPO alone trained them."""
GLOBAL = "ar-eapo-global"
"""Name of the policies that were also trained to come back from anywhere."""

KINDS = {SHIPPED: "", BASE: "base", GLOBAL: "global"}
"""Kinds of the shipped policies by the names of their controllers."""


def shipped_policy(robot: Robot | str, kind: str = "") -> tuple[PolicyController, dict[str, Any]]:
    """A policy that the package ships for a robot, without an estimator, and its metadata.

    Args:
        robot: which joint is driven.
        kind: nothing, ``base`` or ``global``.

    Raises:
        SwingupError: there is no such robot or kind, or the package lacks the file.
    """
    robot = get_robot(robot)
    if kind not in KINDS.values():
        raise SwingupError(f"unknown kind of policy {kind!r}: use {' or '.join(map(repr, KINDS.values()))}")
    if not is_shipped(robot, kind):
        raise SwingupError(f"this package lacks the policy {_file(robot, kind).name}: use {SHIPPED} or train one")
    with resources.as_file(_file(robot, kind)) as path:
        return load_policy(path, robot)


def is_shipped(robot: Robot, kind: str) -> bool:
    """Whether the package has a policy of this kind for a robot."""
    return _file(robot, kind).is_file()


def _file(robot: Robot, kind: str) -> Traversable:
    return resources.files("swingup") / "zoo" / f"{'-'.join(filter(None, (robot.name, kind)))}.npz"
