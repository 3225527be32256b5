"""Variants of the pendulum's task by name; presets are Python values."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from ..errors import SwingupError
from ..physics.parameters import Robot, identified_parameters, leaderboard_parameters
from .domain import Domain, load_domain
from .front_end import FrontEnd, FrontEndSettings
from .hardware import HardwareTask
from .observation import PendulumObservation
from .pendulum import UPRIGHT, PendulumTask
from .recovery import RecoveryTask
from .throws import thrown_states

STARTS_SEED = 0
"""Seed of the states that the global task begins in."""


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


def global_task(robot: Robot) -> RecoveryTask:
    """The smooth task's pendulum: be back up soon, mostly after throws, but also from anywhere and from hanging."""
    smooth = smooth_task(robot)
    random = np.random.default_rng(STARTS_SEED)
    thrown = thrown_states(random, smooth.parameters, 14_000)
    rates = random.uniform(0, 10, (3000, 1)) * random.normal(size=(3000, 2))
    anywhere = np.concatenate([random.uniform(-np.pi, np.pi, (3000, 2)), rates], axis=1)
    starts = np.concatenate([thrown, anywhere, 0.05 * random.normal(size=(3000, 4))])
    starts[:, :2] = (starts[:, :2] + np.pi) % (2 * np.pi) - np.pi  # in single precision, full turns cost digits
    return RecoveryTask(**(vars(smooth) | {"max_steps": 300}), starts=jnp.asarray(starts, jnp.float32))


def hardware_task(robot: Robot, domain: Domain | None = None) -> HardwareTask:
    """The real robot's: swing up from hanging, or come back from anywhere, on plants drawn from a domain.

    Every number here is chosen, but for the frictions, which are the identified ones.
    """
    observation = PendulumObservation(angles="sincos", torques=2, history=2)
    plant = identified_parameters()
    front_end = FrontEndSettings(
        velocity_weight=0.2, dead_band=0.1,
        damping=(float(plant.b1), float(plant.b2)), coulomb=(float(plant.cf1), float(plant.cf2)),
    )  # fmt: skip
    random = np.random.default_rng(STARTS_SEED)
    rates = random.uniform(0, 4, (6000, 1)) * random.normal(size=(6000, 2))
    anywhere = np.concatenate([random.uniform(-np.pi, np.pi, (6000, 2)), rates], axis=1)
    hanging = 0.05 * random.normal(size=(8000, 4))
    near = UPRIGHT + random.uniform(0, 1, (6000, 1)) * [0.2, 0.2, 1.0, 1.0] * random.normal(size=(6000, 4))
    starts = np.concatenate([anywhere, hanging, near])
    return HardwareTask(
        robot=robot,
        parameters=leaderboard_parameters(robot),
        observation=observation,
        cost_velocity_limit=observation.velocity_scale,
        max_steps=500,
        starts=jnp.asarray(starts, jnp.float32),
        domain=load_domain("randomised") if domain is None else domain,
        front_end=FrontEnd(front_end, observation.torques, observation.history),
    )


TASKS: dict[str, Callable[[Robot], PendulumTask]] = {
    "paper": paper_task,
    "smooth": smooth_task,
    "global": global_task,
    "hardware": hardware_task,
}


def get_task(name: str, robot: Robot) -> PendulumTask:
    """Build a variant of the task for a robot.

    Raises:
        SwingupError: there is no such variant.
    """
    if name not in TASKS:
        raise SwingupError(f"unknown task {name!r}: use one of {', '.join(TASKS)}")
    return TASKS[name](robot)
