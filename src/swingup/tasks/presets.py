"""Variants of the pendulum's task by name; presets are Python values."""

import dataclasses
from collections.abc import Callable
from typing import TypeVar

import jax.numpy as jnp
import numpy as np

from ..common.checks import one_of
from ..common.errors import SwingupError
from ..dynamics.dynamics import wrap_difference
from ..dynamics.integrate import stable_substeps
from ..loop.resolve import resolve
from ..loop.starts import Starts, sample_starts
from ..plant.plant import LEADERBOARD, Plant, PlantLike, Robot, get_robot
from ..plant.units import scaled, scales_of
from .acrobot_swingup import AcrobotSwingup
from .pendulum import AbstractPendulumTask, PendulumTask, RecoveryTask
from .task import PendulumStage

AnyPendulumTask = AbstractPendulumTask | AcrobotSwingup
"""A task of a double pendulum, of a robot's or of dm_control's."""
TaskT = TypeVar("TaskT", bound=AbstractPendulumTask)
AnyTaskT = TypeVar("AnyTaskT", bound=AnyPendulumTask)

GLOBAL_STARTS, STARTS_SEED = Starts(thrown=0.7, anywhere=0.15, hanging=0.15), 0
"""States in which the global task begins, and their seed. The board of global policies throws its pendulums."""
SHORT_VELOCITY_COSTS = {"acrobot": (2.8, 1.4), "pendubot": (3.4, 1.7)}
"""Velocity costs of the short task (s²/rad²). With higher costs acrobots swing up later; with lower ones pendubots
keep a slower swing-up."""


def paper_task(robot: Robot, plant: Plant = LEADERBOARD) -> PendulumTask:
    """The paper's task (section IV), in the units of its plant."""
    return _in_own_units(PendulumTask(robot=robot, parameters=plant.driven(robot)))


def smooth_task(robot: Robot, plant: Plant = LEADERBOARD) -> PendulumTask:
    """The paper's task without its two edges: angles observed as sines and cosines, costs of velocities bounded."""
    return _in_own_units(_smooth(robot, plant))


def short_task(robot: Robot, plant: Plant = LEADERBOARD) -> PendulumTask:
    """The smooth task in episodes of 3 s at most, of whose frames nearly half show a swing-up, not a fifth.

    A torque of 1 N m costs as much as 3 to 5 rad/s. In the score it costs as much as 6 rad/s, in the paper's task
    as 0.5 to 0.7 rad/s.
    """
    costs = (50.0, 50.0, *SHORT_VELOCITY_COSTS[robot.name])
    smooth = _smooth(robot, plant)
    return _in_own_units(dataclasses.replace(smooth, state_cost=costs, torque_cost=30.0, max_steps=300))


def global_task(robot: Robot, plant: Plant = LEADERBOARD) -> RecoveryTask:
    """The smooth task's pendulum, to be back up soon: mostly after throws, also from anywhere and from hanging."""
    plant.needs_motor(robot)
    smooth, random = _smooth(robot, plant), np.random.default_rng(STARTS_SEED)
    starts = sample_starts(random, smooth.parameters, GLOBAL_STARTS, 20_000)
    starts[:, :2] = wrap_difference(starts[:, :2])  # full turns cost digits in single precision
    task = RecoveryTask(**(vars(smooth) | {"max_steps": 300}), starts=jnp.asarray(starts, jnp.float32))
    return _in_own_units(task)


def anywhere_task(robot: Robot, plant: Plant = LEADERBOARD) -> RecoveryTask:
    """The smooth task's quadratic cost, from the global task's first states: small networks learn it in minutes."""
    # Saturated later than the global task's, where a motion is far too fast; no step where the tip is up.
    return dataclasses.replace(global_task(robot, plant), saturation=1.0, down_weight=0.0)


def _smooth(robot: Robot, plant: Plant) -> PendulumTask:
    """The smooth task, its numbers in C.1's units."""
    observation, parameters = PendulumStage(angles="sincos"), plant.driven(robot)
    return PendulumTask(robot, parameters, observation, cost_velocity_limit=observation.velocity_scale)


def _in_own_units(task: TaskT) -> TaskT:
    """The task with its numbers scaled from C.1's units to those of its plant."""
    task.parameters.needs_motor(task.robot)
    own = scaled(task, scales_of(task.parameters))
    return dataclasses.replace(own, substeps=stable_substeps(own.parameters, own.dt))


TASKS: dict[str, Callable[[Robot, Plant], AbstractPendulumTask]] = {
    "paper": paper_task,
    "smooth": smooth_task,
    "short": short_task,
    "global": global_task,
    "anywhere": anywhere_task,
}
"""Tasks by name, on one plant: the leaderboards' by default."""


def get_task(name: str, robot: Robot | str, plant: Plant = LEADERBOARD) -> AbstractPendulumTask:
    """Build a variant of the task for a robot, in the units of its plant."""
    return TASKS[one_of("task", name, TASKS)](get_robot(robot), plant)


def find_task(task: str | AnyTaskT, robot: str, plant: PlantLike | None = None) -> AbstractPendulumTask | AnyTaskT:
    """A task for a robot's environment, by name or passed in.

    A named task is in the units of the plant, or without one of the leaderboards'. A task that is passed in must be
    the robot's.
    """
    if not isinstance(task, str) and plant is not None:
        raise SwingupError(f"a {type(task).__name__} has a plant of its own: pass the task's name with plant=")
    found = LEADERBOARD if plant is None else resolve(plant).facts
    chosen = get_task(task, get_robot(robot), found) if isinstance(task, str) else task
    if chosen.choices:
        raise SwingupError(f"{type(chosen).__name__} has actions to choose from, an environment here has numbers")
    if chosen.robot != get_robot(robot):
        raise SwingupError(f"the task is for the {chosen.robot.name}, not for the {robot}: change one of them")
    return chosen
