"""Variants of the pendulum's task by name; presets are Python values."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..checks import one_of
from ..errors import SwingupError
from ..physics.parameters import Robot, get_robot, leaderboard_parameters
from ..physics.units import scales_of
from ..plants.domain import Domain, load_domain
from ..plants.loop import LOOP_DT
from ..plants.plant import PlantLike, robot_parameters
from ..policy.jax_backend.front_end import FrontEnd
from ..policy.jax_backend.observation import PendulumObservation
from ..policy.settings import FrontEndSettings
from .middle_plant import known_plant
from .pendulum import AbstractPendulumTask, PendulumTask
from .recovery import UP_LINE_WIDTH, RecoveryTask
from .sim2real import Sim2RealTask
from .throws import thrown_states
from .units import in_own_units

STARTS_SEED = 0
"""Seed of the states that the global task begins in."""


def paper_task(robot: Robot, plant: PlantLike | None = None) -> PendulumTask:
    """The paper's task to the letter (paper, section IV), in the units of its plant."""
    return in_own_units(PendulumTask(robot=robot, parameters=robot_parameters(plant, robot)))


def smooth_task(robot: Robot, plant: PlantLike | None = None) -> PendulumTask:
    """The paper's task without its two edges: angles observed as sines and cosines, costs of velocities bounded."""
    observation = PendulumObservation(angles="sincos")
    task = PendulumTask(
        robot=robot,
        parameters=robot_parameters(plant, robot),
        observation=observation,
        cost_velocity_limit=observation.velocity_scale,
    )
    return in_own_units(task)


def short_task(robot: Robot, plant: PlantLike | None = None) -> PendulumTask:
    """The smooth task in episodes of 3 s at most: nearly half of the frames show a swing-up, not a fifth."""
    return dataclasses.replace(smooth_task(robot, plant), max_steps=300)


def global_task(robot: Robot, plant: PlantLike | None = None) -> RecoveryTask:
    """The smooth task's pendulum, to be back up soon: mostly after throws, also from anywhere and from hanging."""
    smooth = smooth_task(robot, plant)
    scales, random = scales_of(smooth.parameters), np.random.default_rng(STARTS_SEED)
    thrown = thrown_states(random, smooth.parameters, 14_000)
    rates = random.uniform(0, 10, (3000, 1)) * random.normal(size=(3000, 2))
    anywhere = np.concatenate([random.uniform(-np.pi, np.pi, (3000, 2)), rates], axis=1)
    hanging = 0.05 * random.normal(size=(3000, 4))
    chosen = np.concatenate([anywhere, hanging]) * [1.0, 1.0, scales.velocity, scales.velocity]
    starts = np.concatenate([thrown, chosen])
    starts[:, :2] = (starts[:, :2] + np.pi) % (2 * np.pi) - np.pi  # full turns cost digits in single precision
    return RecoveryTask(
        **(vars(smooth) | {"max_steps": 300}),
        starts=jnp.asarray(starts, jnp.float32),
        up_line_width=UP_LINE_WIDTH * scales.length,
    )


def anywhere_task(robot: Robot, plant: PlantLike | None = None) -> RecoveryTask:
    """The smooth task's quadratic cost, from the global task's first states: small networks learn it in minutes."""
    # Saturated later than the global task's, where a motion is far too fast; no step where the tip is up.
    return dataclasses.replace(global_task(robot, plant), saturation=1.0, down_weight=0.0)


def sim2real_task(
    robot: Robot,
    domain: Domain | None = None,
    estimated: bool = True,
    velocity_weight: float = 1.0,
    dead_band: float = 0.0,
) -> Sim2RealTask:
    """The task on a robot that is simulated with friction, delay and noise; in the units of the domain's plant.

    The front end compensates the friction at the middle of the domain's ranges, or none where that is negative.

    Args:
        robot: which joint is driven.
        domain: ranges of plant and loop; the identified domain by default.
        estimated: whether a state estimator precedes the policy. If so, training shows the true state.
        velocity_weight: weight of a new velocity in the front end's low-pass filter; 1 is no filter. The paper's
            authors had 0.2 on the robot.
        dead_band: slower velocities count as 0 (rad/s). The paper's authors had 0.1 on the robot.
    """
    domain = load_domain("identified") if domain is None else domain
    observation = PendulumObservation(angles="sincos")
    settings = FrontEndSettings(
        # A negative compensation would add friction.
        damping=(max(0.0, domain.middle("b1")), max(0.0, domain.middle("b2"))),
        coulomb=(max(0.0, domain.middle("cf1")), max(0.0, domain.middle("cf2"))),
        passive_limit=domain.middle("passive_limit"),
        velocity_weight=velocity_weight,
        dead_band=dead_band,
    )
    plant = known_plant(domain, robot)
    task = Sim2RealTask(
        robot=robot,
        parameters=leaderboard_parameters(robot) if plant is None else plant,
        observation=observation,
        cost_velocity_limit=observation.velocity_scale,
        domain=domain,
        front_end=FrontEnd(settings),
        estimated=estimated,
    )
    scaled = in_own_units(task)
    return dataclasses.replace(scaled, calls=max(1, round(scaled.dt / LOOP_DT)))


SIM2REAL_TASKS: dict[str, Callable[[Robot, Domain | None], Sim2RealTask]] = {"sim2real": sim2real_task}
"""Tasks on the simulated robot, which a domain may change."""

PLANT_TASKS: dict[str, Callable[[Robot, PlantLike | None], AbstractPendulumTask[Any]]] = {
    "paper": paper_task,
    "smooth": smooth_task,
    "short": short_task,
    "global": global_task,
    "anywhere": anywhere_task,
}
"""Tasks on one plant, the leaderboards' by default."""

TASKS: dict[str, Callable[..., AbstractPendulumTask[Any]]] = {**PLANT_TASKS, **SIM2REAL_TASKS}
"""All of them; each has its defaults for a robot alone."""


def get_task(name: str, robot: Robot, plant: PlantLike | None = None) -> AbstractPendulumTask[Any]:
    """Build a variant of the task for a robot.

    Args:
        name: the variant.
        robot: which joint is driven.
        plant: the pendulum, in whose units the task is; the leaderboards' by default.

    Raises:
        SwingupError: there is no such variant or plant, or the variant has its plants from a domain.
    """
    if plant is None:
        return TASKS[one_of("task", name, TASKS)](robot)
    if name in SIM2REAL_TASKS:
        raise SwingupError(f"the task {name} draws its plants from a domain: give a domain, not a plant")
    return PLANT_TASKS[one_of("task", name, TASKS)](robot, plant)


def find_task(
    task: str | AbstractPendulumTask[Any], robot: str, plant: PlantLike | None = None
) -> AbstractPendulumTask[Any]:
    """A task for a robot's environment, by name or passed in.

    Args:
        task: name of a variant, or a task, which must be the robot's.
        robot: its name.
        plant: the pendulum, in whose units a named task is; the leaderboards' by default.

    Raises:
        SwingupError: there is no such robot, variant or plant, or the task that was passed in is another robot's
            or comes with a plant.
    """
    if plant is not None and not isinstance(task, str):
        raise SwingupError(f"a {type(task).__name__} has a plant of its own: pass the task's name with plant=")
    chosen = get_task(task, get_robot(robot), plant) if isinstance(task, str) else task
    if chosen.robot != get_robot(robot):
        raise SwingupError(f"the task is for the {chosen.robot.name}, not for the {robot}: change one of them")
    return chosen
