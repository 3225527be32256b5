"""Baselines for any pendulum: designed for a similar one in C.1's units with C.1's settings, and wrapped.

The similar pendulum has the motor's limit and the unit of time of C.1 (``plant/units.py``), so that all settings
suit it as they are. Around its controller state, time and torque are converted. Plants that move alike get the same
controller, step for step. Ratios remain: a weaker pendulum needs another swing-up, which is searched.
"""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ...common.types import State, Torque
from ...plant.equations import COULOMB_STEEPNESS
from ...plant.plant import Robot
from ...plant.units import STATE, TIME, TORQUE, Scales, scaled
from ..interface import AbstractController, Time, TimeLike, joint_torques, never, since_first_call
from ..swingups.design import Search
from ..swingups.ilqr import ILQRSettings
from ..swingups.reference import Reference
from .optimal import Optimal
from .published import Published

DURATIONS = (1.0, 1.5, 2.0)
"""Multiples of a swing-up's duration on C.1 that are tried in turn."""

SEARCH = Search(
    ILQRSettings(
        max_iterations=600,
        tolerance=1e-6,
        regularisation=10.0,
        min_regularisation=1e-6,
        max_regularisation=1e8,
        torque_limit=5.0,
        decrease=0.5,
        increase=3.0,
        step_sizes=(1.0, 0.3, 0.1, 0.03, 0.01),
    ),
    steps=300,
    starts=6,
    amplitude=0.3,
    waves=(1.2, 2.4, 3.6, 4.8, 6.0),
    durations=DURATIONS,
)
"""How the published swing-up of another pendulum begins."""

FINE_ITERATIONS = 60
"""Most iterations of that swing-up on its fine grid, after the search on a coarse one."""


def published_for(published: Published, time: float) -> Published:
    """The published settings for a similar pendulum whose unit of time is this multiple of C.1's."""
    # With a line search fewer iterations are enough.
    settings = replace(SEARCH.settings, max_iterations=FINE_ITERATIONS)
    # The loop's period does not scale, and each call has a row: a step keeps its real length.
    problem = published.swingup
    dt, steps = problem.dt / time, round(problem.steps * time)
    problem = replace(problem, settings=settings, dt=dt, steps=steps, search=SEARCH)
    # A plan of as many of the pendulum's own units has another number of steps.
    horizon = max(10, round(published.mpc.horizon * time))
    mpc = replace(published.mpc, dt=published.mpc.dt / time, horizon=horizon)
    return replace(published, swingup=problem, mpc=mpc)


def optimal_for(optimal: Optimal, time: float) -> Optimal:
    """Our settings for the score for a similar pendulum whose unit of time is this multiple of C.1's."""
    problem, search = optimal.swingup, optimal.swingup.search
    assert search is not None
    # A step keeps its real length, and a coarse one is a whole number of them.
    each = max(1, round(problem.steps / search.steps * time))
    coarse = round(problem.steps * time / each)
    search = replace(search, steps=coarse, durations=DURATIONS)
    return replace(optimal, swingup=replace(problem, dt=problem.dt / time, steps=coarse * each, search=search))


def in_real_units(reference: Reference, scales: Scales) -> Reference:
    """A swing-up of a similar pendulum as that of the plant itself."""
    found = scaled(reference, scales)
    # A step's length is a round number of real time.
    return replace(found, dt=round(found.dt, 12))


class InOwnUnits(AbstractController[tuple[Time, Any]]):
    """A controller of the similar pendulum without friction of its driven joint, for the plant itself.

    It sees the plant's state and time in C.1's units.
    """

    controller: AbstractController[Any]
    limit: float
    """The plant's motor's (N m)."""
    coulomb: float
    """The driven joint's Coulomb friction, which is added to the torque (N m)."""
    scales: Scales
    """The plant's units; not static, so that plants share a program."""
    robot: Robot = eqx.field(static=True)

    def init(self) -> tuple[Time, Any]:
        """The time of the first call, and the controller's own memory."""
        return never(), self.controller.init()

    def __call__(self, carry: tuple[Time, Any], t: TimeLike, x: State) -> tuple[tuple[Time, Any], Torque]:
        """The torques (N m)."""
        begun, elapsed = since_first_call(t, carry[0])
        similar = self.scales.similar
        inner, u = self.controller(carry[1], similar(elapsed, TIME), similar(x, *STATE))
        joint = self.robot.joint
        torque = self.scales.scaled(u[joint], TORQUE) + self.coulomb * jnp.arctan(COULOMB_STEEPNESS * x[2 + joint])
        # Neither the compensation nor the units' rounding may exceed the limit.
        return (begun, inner), joint_torques(torque, self.robot, self.limit)
