"""Recover from throws as soon as possible: a task for the global-policy score."""

from typing import Annotated

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.types import Key, Scalar, State, Torque
from ..dynamics.dynamics import tip_height
from ..plant.units import LENGTH
from .pendulum import AbstractPendulumTask, PendulumState

UP_FRACTION = 0.9
"""The tip is up above this fraction of l1 + l2, as in the benchmark's rules."""
UP_LINE_WIDTH = 0.01
"""Width of the smooth step in the reward at that height, for design C.1 (m)."""


class RecoveryTask(AbstractPendulumTask):
    """Get up from any of many given states; the time until then costs.

    The quadratic cost is saturated, so that a fast motion on the way costs no more than a slow one:
    r = -[(1 - w) (1 - exp(-cost / s)) + w down]. This is not the paper's reward; every number was chosen.
    """

    starts: Float[Array, "n 4"] = eqx.field(kw_only=True)
    """States that episodes begin in (rad, rad/s)."""
    saturation: float = 0.3
    """s: a quadratic cost that is already large."""
    down_weight: float = 0.5
    """w: share of the reward that depends only on whether the tip is up."""
    up_line_width: Annotated[float, LENGTH] = eqx.field(kw_only=True, static=True, default=UP_LINE_WIDTH)
    """Width of the smooth step at the line (m)."""

    def reset(self, key: Key) -> PendulumState:
        """Any of the given states."""
        start = self.starts[jax.random.randint(key, (), 0, len(self.starts))]
        return PendulumState(x=start, steps=jnp.array(0))

    def reward(self, x: State, u: Torque) -> Scalar:
        """From -1, far down, to 0, upright at rest without torque."""
        # Saturated: far down all states are alike, and only the time counts.
        away = 1 - jnp.exp(self.quadratic_reward(x, u) / self.saturation)
        # By the height, as the board counts the time until the tip is up.
        below = UP_FRACTION * self.parameters.length - tip_height(self.parameters, x)
        down = jax.nn.sigmoid(below / self.up_line_width)
        return -((1 - self.down_weight) * away + self.down_weight * down)
