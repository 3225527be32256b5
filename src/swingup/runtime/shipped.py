"""Which policy files the package ships, and where."""

from importlib import resources
from importlib.resources.abc import Traversable

from ..checks import one_of
from ..errors import SwingupError
from ..robots import Robot, get_robot

REFINED = "refined"
"""The default: trained by AR-EAPO, then taught by a teacher's swing-up; it runs behind a state estimator."""
AR_EAPO = "ar-eapo"
"""What the paper's learner alone gives."""
GLOBAL = "global"
"""Trained to recover from throws."""
ROBOT = "robot"
"""Trained on the simulated robot."""

SHIPPED_POLICIES = (REFINED, AR_EAPO, GLOBAL, ROBOT)
"""Names of the shipped policies, which are those of their controllers and of their files."""


def shipped_file(robot: Robot | str, name: str = REFINED) -> Traversable:
    """The file of a policy that the package ships for a robot.

    Args:
        robot: which joint is driven.
        name: one of :data:`SHIPPED_POLICIES`.

    Raises:
        SwingupError: there is no such robot or policy, or the package lacks the file.
    """
    robot = get_robot(robot)
    one_of("policy", name, SHIPPED_POLICIES)
    file = resources.files(__package__.rpartition(".")[0]) / "zoo" / f"{robot.name}-{name}.npz"
    if not file.is_file():
        raise SwingupError(f"this package lacks the policy {file.name}: use {REFINED} or train one")
    return file
