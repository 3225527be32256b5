"""A task in the units of its own plant: the numbers that suit design C.1, scaled to another pendulum.

With the scales of time T, torque limit and length of :mod:`swingup.plant.units`, numbers of a task become

    dt: T          velocities that are observed, that cost, and that an episode starts with: 1/T
    Q: 1 for angles, T² for velocities          R: 1 / torque limit²

so that a similar pendulum has the same Markov decision process, step for step. The temperature, the number of steps
in an episode and all other settings have no unit.
"""

import dataclasses
from typing import TypeVar

from ..common.errors import SwingupError
from ..dynamics.integrate import stable_substeps
from ..plant.units import scales_of
from .pendulum import AbstractPendulumTask

TaskT = TypeVar("TaskT", bound=AbstractPendulumTask)


def in_own_units(task: TaskT) -> TaskT:
    """The task with its numbers scaled from C.1's units to those of its plant; the same numbers for C.1."""
    driven = ("tl1", "tl2")[task.robot.joint]
    if not getattr(task.parameters, driven) > 0:
        limit = float(getattr(task.parameters, driven))
        raise SwingupError(f"the {task.robot.name}'s torque limit {driven} = {limit:g} N m must be positive")
    scales = scales_of(task.parameters)
    dt = task.dt * scales.time
    angle1, angle2, rate1, rate2 = task.state_cost
    return dataclasses.replace(
        task,
        observation=dataclasses.replace(
            task.observation, velocity_scale=task.observation.velocity_scale * scales.velocity
        ),
        dt=dt,
        substeps=stable_substeps(task.parameters, dt),
        state_cost=(angle1, angle2, rate1 * scales.time**2, rate2 * scales.time**2),
        torque_cost=task.torque_cost / scales.torque_limit**2,
        reset_rate=task.reset_rate * scales.velocity,
        cost_velocity_limit=task.cost_velocity_limit * scales.velocity,
    )
