"""Variants of the pendulum's task by name; presets are Python values."""

import dataclasses
from collections.abc import Callable

from ..errors import SwingupError
from ..physics.parameters import Robot, leaderboard_parameters
from .observation import PendulumObservation
from .pendulum import PendulumTask


def paper_task(robot: Robot) -> PendulumTask:
    """The paper's task to the letter, on the leaderboards' plant (paper, section IV)."""
    return PendulumTask(robot=robot, parameters=leaderboard_parameters(robot))


def smooth_task(robot: Robot) -> PendulumTask:
    """The paper's task without its two edges: angles seen as sines and cosines, costs of velocities bounded."""
    observation = PendulumObservation(angles="sincos")
    return PendulumTask(
        robot=robot,
        parameters=leaderboard_parameters(robot),
        observation=observation,
        cost_velocity_limit=observation.velocity_scale,
    )


def global_task(robot: Robot) -> PendulumTask:
    """The smooth task, for a policy that comes back from anywhere: most episodes start there."""
    return dataclasses.replace(smooth_task(robot), anywhere=0.7, anywhere_speed=10.0)


TASKS: dict[str, Callable[[Robot], PendulumTask]] = {
    "paper": paper_task,
    "smooth": smooth_task,
    "global": global_task,
}


def get_task(name: str, robot: Robot) -> PendulumTask:
    """Build a variant of the task for a robot.

    Raises:
        SwingupError: there is no such variant.
    """
    if name not in TASKS:
        raise SwingupError(f"unknown task {name!r}: use one of {', '.join(TASKS)}")
    return TASKS[name](robot)
