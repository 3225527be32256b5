"""The policies that the package ships, by name."""

import os
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import overload

from ..common.arrays import SUFFIX
from ..common.checks import one_of
from ..common.errors import SwingupError, naming, quoted
from ..common.files import has_suffix
from ..plant.files import load_plant
from ..plant.plant import PlantLike, Robot, get_robot
from .pendulum import PendulumPolicy, for_plant, read_pendulum_policy
from .policy import TaskPolicy, is_of_task, read_task_policy

ADAPTIVE = "adaptive"
"""Sees the plant that an identifier finds while it swings up; a regulator for that plant holds it."""
AR_EAPO = "ar-eapo"  # Trained by the paper's learner alone
GLOBAL = "global"  # Trained to recover from throws

SHIPPED_POLICIES = (ADAPTIVE, AR_EAPO, GLOBAL)
"""Names of the shipped policies, which are those of their controllers and of their files."""
DEFAULT = ADAPTIVE  # The policy of commands, pages and exports that name none

# Not by the package's name: the copy in an exported folder has another one.
ZOO = resources.files(__package__.rpartition(".")[0]) / "zoo"  # The folder of the files


def shipped_file(robot: Robot | str, name: str = DEFAULT) -> Traversable:
    """The file of a policy that the package ships for a robot."""
    robot = get_robot(robot)
    one_of("policy", name, SHIPPED_POLICIES)
    file = ZOO / f"{robot.name}-{name}{SUFFIX}"
    if not file.is_file():
        raise SwingupError(f"this package lacks the policy {file.name}: use {DEFAULT} or train one")
    return file


def is_policy(source: str | Path) -> bool:
    """Whether a name means a policy: a shipped one, or a file."""
    return source in SHIPPED_POLICIES or has_suffix(source, SUFFIX)


@overload
def load_policy(source: str | Path, robot: Robot | str, plant: PlantLike | None = None) -> PendulumPolicy: ...
@overload
def load_policy(
    source: str | Path, robot: None = None, plant: PlantLike | None = None
) -> TaskPolicy | PendulumPolicy: ...
def load_policy(
    source: str | Path, robot: Robot | str | None = None, plant: PlantLike | None = None
) -> TaskPolicy | PendulumPolicy:
    """Read a policy of any task from its file, or a pendulum's that the package ships.

    Its ``predict`` needs NumPy alone. For a pendulum that is the network without what stands around it;
    :func:`swingup.runtime.load_controller` runs all of it.

    Example:
        >>> from swingup import load_policy
        >>> policy = load_policy("ar-eapo", "acrobot")
        >>> action, _ = policy.predict([0.1, 0.0, 0.0, 0.0])
        >>> policy.task, policy.action_space.kind, action.shape
        ('acrobot', 'box', (1,))

    Args:
        source: a policy file, or ``adaptive``, ``ar-eapo`` or ``global``.
        robot: the robot that it must be for; needed with a name.
        plant: what a policy that finds its plant is to begin with, in that plant's units: a plant, its name or its
            file; None for the plant of the policy's file.

    Raises:
        SwingupError: there is no such policy or plant, or the policy is damaged, for another robot, or not for this
            plant.
    """
    if robot is None and plant is None and has_suffix(source, SUFFIX) and is_of_task(source):
        return read_task_policy(source)
    return load_pendulum_policy(source, robot, plant)


def load_pendulum_policy(
    source: str | Path, robot: Robot | str | None = None, plant: PlantLike | None = None
) -> PendulumPolicy:
    """Read a pendulum's policy as :func:`load_policy` does; those of other tasks are refused."""
    found, on = _read(source, robot), None if plant is None else load_plant(plant)
    with naming(f"policy {quoted(str(source))}"):
        return found if on is None else for_plant(found, on)


def _read(source: str | Path, robot: Robot | str | None) -> PendulumPolicy:
    if has_suffix(source, SUFFIX):
        return read_pendulum_policy(source, robot)
    if str(source) not in SHIPPED_POLICIES and os.path.isdir(source):
        inside = [*Path(source).glob(f"best{SUFFIX}"), *Path(source).glob(f"*/policy{SUFFIX}")]
        such = inside[0] if inside else Path(source, f"best{SUFFIX}")
        raise SwingupError(f"{source} is a folder: name a policy file in it, such as {such}")
    name = one_of("policy", str(source), SHIPPED_POLICIES, f" or a policy file ({SUFFIX})")
    if robot is None:
        raise SwingupError(f"policy {name!r} is shipped for both robots: name acrobot or pendubot")
    with resources.as_file(shipped_file(robot, name)) as path:
        return read_pendulum_policy(path, robot)
