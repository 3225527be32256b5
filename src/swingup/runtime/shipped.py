"""Which policy files the package ships, and where."""

from importlib import resources
from importlib.resources.abc import Traversable

from ..errors import SwingupError
from ..robots import Robot, get_robot

SHIPPED = "ar-eapo"
"""Name of the shipped policies' controller: refined, with an estimator."""
BASE = "ar-eapo-base"
"""Name of the policies that these were refined from, as AR-EAPO alone trained them."""
GLOBAL = "ar-eapo-global"
"""Name of the policies that were also trained to come back from anywhere."""

KINDS = {SHIPPED: "", BASE: "base", GLOBAL: "global"}
"""Kinds of the shipped policies by the names of their controllers."""


def shipped_file(robot: Robot | str, kind: str = "") -> Traversable:
    """The file of a policy that the package ships for a robot.

    Args:
        robot: which joint is driven.
        kind: nothing, ``base`` or ``global``.

    Raises:
        SwingupError: there is no such robot or kind, or the package lacks the file.
    """
    robot = get_robot(robot)
    if kind not in KINDS.values():
        raise SwingupError(f"unknown kind of policy {kind!r}: use {' or '.join(map(repr, KINDS.values()))}")
    file = _file(robot, kind)
    if not file.is_file():
        raise SwingupError(f"this package lacks the policy {file.name}: use {SHIPPED} or train one")
    return file


def _file(robot: Robot, kind: str) -> Traversable:
    root = resources.files(__package__.rpartition(".")[0])
    return root / "zoo" / f"{'-'.join(filter(None, (robot.name, kind)))}.npz"
