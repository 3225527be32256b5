"""Baselines on a plant with dry friction: compensated where there is a motor, counted on where there is none.

Friction of the driven joint is a torque that its motor adds (``own_units.py``). Friction of the passive joint is a
disturbance. Near upright a regulator counts on it twice: as damping, since it resists motion, and by a share of the
torque that is best against it as a constant (``lqr.disturbance_gain``). How much of both holds a plant differs: the
settings are tried on the model, and the best ones are taken. Some plants are held by none.
"""

import itertools
import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.types import Scalar, State
from ...dynamics.dynamics import UPRIGHT, wrap_difference
from ...dynamics.integrate import rk4_step
from ...plant.plant import Plant, Robot
from .lqr import LQR, LQRSettings, disturbance_gain, upright_lqr

KNEE = 10.0
"""Along a swing-up the friction's sign is 2/π arctan of this times the velocity (s/rad), in C.1's units."""
STATE_WEIGHT, TORQUE_WEIGHT = 10.0, 0.1
"""Multiples of a TVLQR's weights: the friction's sign is the plan's, which holds only near the plan."""
HAND_OVER = (0.4, 0.4, 1.5, 1.5)
"""|errors| below which the regulator takes over from a swing-up (rad, rad/s), in C.1's units. Friction keeps the
motion from the published ones, which are a quarter of these and less."""


class Counting(NamedTuple):
    """How a regulator counts on the passive joint's friction cf arctan(100 q̇)."""

    damping: float
    """cf times this is added to the joint's damping (s/rad)."""
    share: float
    """Share of the torque against cf as a constant."""
    knee: float
    """The friction's sign is 2/π arctan of this times the velocity (s/rad)."""


COUNTINGS = (Counting(1.0, 0.6, 6.0), Counting(4.0, 0.9, 30.0))
"""The two best of 540 settings on the shipped designs A.0, B.0, C.0 and C.1: neither is the better on all."""
MORE_COUNTINGS = tuple(
    itertools.starmap(Counting, itertools.product((4.0, 8.0, 16.0), (0.3, 0.6, 0.9), (12.0, 30.0)))
)
"""Others, for plants that the two hold from few starts: light ones, and heavy ones with much friction."""

STARTS = np.random.default_rng(0).uniform(-0.25, 0.25, (32, 4)) * HAND_OVER
"""Errors from which the settings are tried: a quarter of the hand-over's (rad, rad/s)."""
TRIAL_CALLS, LAST_CALLS = 3000, 500
"""Calls of a trial, and those of its end that count."""
FALLEN_ANGLE = 0.6
"""A larger error of an angle at the end of a trial is a fall (rad)."""

_LOGGER = logging.getLogger(__name__)


def passive_friction(plant: Plant, robot: Robot) -> float:
    """Coulomb friction of the joint without a motor (N m)."""
    return float((plant.cf2, plant.cf1)[robot.joint])


def holding_lqr(plant: Plant, robot: Robot, settings: LQRSettings, dt: float) -> LQR:
    """The regulator at the top of a plant; a warning tells of one that friction makes hard to hold.

    The plant is in C.1's units, with the dry friction of its passive joint alone; dt is the loop's period in these
    units (s).
    """
    if not passive_friction(plant, robot):
        return upright_lqr(plant, robot, settings)
    found, held = _best(plant, robot, settings, COUNTINGS, dt)
    if held < len(STARTS) / 2:
        other, more = _best(plant, robot, settings, MORE_COUNTINGS, dt)
        found, held = (other, more) if more > held else (found, held)
        _LOGGER.warning(
            f"the {robot.name}'s joint {2 - robot.joint} has dry friction and no motor: its regulator holds this "
            f"plant from {held} of {len(STARTS)} starts near upright"
        )
    return found


def _best(
    plant: Plant, robot: Robot, settings: LQRSettings, countings: Sequence[Counting], dt: float
) -> tuple[LQR, int]:
    """The regulator that holds from the most starts, and their number."""
    tried = []
    for each in countings:
        regulator = upright_lqr(linear_friction(plant, each.damping), robot, settings)
        tried.append(replace(regulator, friction=friction_gain(plant, regulator, each), knee=each.knee))
    # One program for all settings: they differ in numbers alone.
    with jax.enable_x64(True):
        stacked = jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf) for leaf in leaves]), *tried)
        errors = np.asarray(_errors_held(stacked, plant, dt))
    held = (errors < FALLEN_ANGLE).sum(axis=1)
    # Where several hold from as many starts, the smaller error that remains decides.
    best = max(range(len(tried)), key=lambda index: (held[index], -np.median(errors[index])))
    return tried[best], int(held[best])


def linear_friction(plant: Plant, damping: float = 1.0) -> Plant:
    """The plant with Coulomb friction as damping: cf arctan(100 q̇) becomes ``damping`` (s/rad) times cf q̇.

    Its slope at rest is a hundred times as large, by which a regulator would take the joint for frozen.
    """
    b1, b2 = plant.b1 + damping * plant.cf1, plant.b2 + damping * plant.cf2
    return plant.changed(b1=b1, b2=b2, cf1=0.0, cf2=0.0)


def friction_gain(plant: Plant, regulator: LQR, counting: Counting) -> float:
    """Torque (N m) that this regulator of a plant adds against the undriven joint's Coulomb friction.

    Where the joint moves forwards, friction is a constant torque backwards (``lqr.disturbance_gain``).
    """
    damped = linear_friction(plant, counting.damping)
    return counting.share * disturbance_gain(damped, regulator) * passive_friction(plant, regulator.robot)


@jax.jit
def _errors_held(regulators: LQR, plant: Plant, dt: Scalar) -> Float[Array, "regulators starts"]:
    """Largest error of an angle in the last calls of each trial (rad)."""

    def error(x: State) -> State:
        off = x - jnp.asarray(UPRIGHT)
        return off.at[:2].set(wrap_difference(off[:2]))

    def trial(regulator: LQR, start: State) -> Array:
        def step(x: State, _: None) -> tuple[State, Array]:
            _, u = regulator(None, jnp.zeros(()), x)
            x = rk4_step(plant, x, u, dt)
            return x, jnp.abs(error(x)[:2]).max()

        # The end alone: a regulator that catches the pendulum lets it swing first.
        return jnp.max(jax.lax.scan(step, jnp.asarray(UPRIGHT) + start, length=TRIAL_CALLS)[1][-LAST_CALLS:])

    return jax.vmap(jax.vmap(trial, (None, 0)), (0, None))(regulators, jnp.asarray(STARTS))
