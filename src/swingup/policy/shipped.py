"""Which policy files the package ships, and where."""

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from ..checks import one_of
from ..errors import SwingupError
from ..renamed import current_name
from ..robots import Robot, get_robot
from .file import PendulumPolicy, read_pendulum_policy

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

ZOO = resources.files(__package__.rpartition(".")[0]) / "zoo"
"""The folder of the files."""


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
    file = ZOO / f"{robot.name}-{name}.npz"
    if not file.is_file():
        raise SwingupError(f"this package lacks the policy {file.name}: use {REFINED} or train one")
    return file


def read_policy(source: str | Path, robot: Robot | str | None = None) -> PendulumPolicy:
    """What a policy file holds; arguments and errors as those of ``load_controller``."""
    source = current_name("controller", str(source))
    if source not in SHIPPED_POLICIES:
        if not str(source).endswith(".npz"):
            raise SwingupError(
                f"unknown policy {source!r}: use {', '.join(SHIPPED_POLICIES)} or a policy file (.npz)"
            )
        return read_pendulum_policy(source, robot)
    if robot is None:
        raise SwingupError(f"policy {source!r} is shipped for both robots: name acrobot or pendubot")
    with resources.as_file(shipped_file(robot, source)) as path:
        return read_pendulum_policy(path, robot)
