"""Recovering from throws as soon as possible: a task for the global-policy score."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..physics.dynamics import tip_height
from ..types import Key, Scalar, State, Torque
from .pendulum import PendulumState, PendulumTask

HEIGHT = 0.9
"""Fraction of l1 + l2 above which the tip counts as up; as in the benchmark's rules."""
EDGE = 0.01
"""Width of the smoothed line above which the tip is up (m)."""


class RecoveryTask(PendulumTask):
    """Be up, from any of many given states; what costs is the time until then.

    The quadratic cost is saturated, so that being fast on the way costs no more than being slow:
    r = -[(1 - w) (1 - exp(-cost / s)) + w down]. This is not the paper's reward; every number was chosen.
    """

    starts: Float[Array, "n 4"] = eqx.field(kw_only=True)
    """States that episodes begin in (rad, rad/s)."""
    saturation: float = 0.3
    """s: a quadratic cost that is already large."""
    down_weight: float = 0.5
    """w: share of the reward that only asks whether the tip is up."""

    def reset(self, key: Key) -> PendulumState:
        """Any of the given states."""
        start = self.starts[jax.random.randint(key, (), 0, len(self.starts))]
        return PendulumState(x=start, steps=jnp.array(0))

    def reward(self, x: State, u: Torque) -> Scalar:
        """From -1, far down, to 0, upright at rest without torque."""
        away = 1 - jnp.exp(super().reward(x, u) / self.saturation)
        down = jax.nn.sigmoid((HEIGHT * self.parameters.length - tip_height(self.parameters, x)) / EDGE)
        return -((1 - self.down_weight) * away + self.down_weight * down)
