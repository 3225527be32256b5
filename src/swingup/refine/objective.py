"""The cost of an episode: measures that are smooth, so that they have a gradient, and their weights."""

import functools
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..benchmark.boards import PERFORMANCE
from ..benchmark.rollout import Trajectory
from ..benchmark.swing_up_board import realai_score
from ..common.types import Scalar, State
from ..dynamics.dynamics import UPRIGHT, tip_height
from ..plant.plant import Plant
from ..tasks.pendulum import UP_LINE_WIDTH

SCORE_RULES = PERFORMANCE
"""The rules whose score the objective smooths, and whose time step the episodes have."""
GOAL_WIDTH = 0.3
"""Width of the goal's neighbourhood (rad)."""
SPEED_OF_A_RADIAN = 4.0
"""The velocity that counts as much as an error of one radian (rad/s)."""
FAST = 14.0
"""The velocity from which on a joint is fast (rad/s). Loops of real robots stop at 20."""
WOUND = 2.0
"""Half turns from upright from which on a joint is wound. Loops of real robots stop at 3.5 or 4 from hanging."""


class Measures(eqx.Module):
    """The measures of an episode."""

    score: Scalar
    """The RealAI score, in which the smoothly counted time down replaces the swing-up time."""
    down: Scalar
    """Share of the time for which the tip is down."""
    away: Scalar
    """Mean distance from the goal, from 0 to 1. Half of it saturates outside the goal's neighbourhood."""
    fast: Scalar
    """Mean over the rows of the joints' squared velocities above ``FAST``, in units of it."""
    wound: Scalar
    """Mean sum of squares of the joints' half turns from upright beyond ``WOUND``."""


def measure_episode(trajectory: Trajectory, parameters: Plant) -> Measures:
    """Measure an episode. The time after it counts as free of cost."""
    x, u, dt = jnp.asarray(trajectory.x), jnp.asarray(trajectory.u), SCORE_RULES.dt
    line = SCORE_RULES.height * parameters.length
    down = jnp.sum(jax.nn.sigmoid((line - jax.vmap(tip_height, (None, 0))(parameters, x)) / UP_LINE_WIDTH)) * dt
    changes = jnp.diff(u, axis=0)
    # The rows of a whole run, as in the judge: after the episode the torque counts as constant.
    rows = SCORE_RULES.steps - 1
    mean, square = jnp.sum(changes, axis=0) / rows, jnp.sum(changes**2, axis=0) / rows
    costs = {
        "swingup_time": down,
        "energy": jnp.sum(jnp.abs(jnp.diff(x[:, :2], axis=0) * u[:-1])),
        "torque_cost": jnp.sum(u**2) * dt,
        # The passive joint's torque is always 0, where a square root has no finite slope.
        "torque_smoothness": jnp.sum(jnp.sqrt(square - mean**2 + 1e-12)),
        "velocity_cost": jnp.sum(x[:, 2:] ** 2) * dt,
    }
    score = realai_score(costs, SCORE_RULES.normalisers, jnp.tanh)
    above = jax.nn.relu(jnp.abs(x[:, 2:]) / FAST - 1)
    turns = jax.nn.relu(jnp.abs(x[:, :2] - jnp.asarray(UPRIGHT[:2], x.dtype)) / jnp.pi - WOUND)
    away, fast = jnp.mean(jax.vmap(_away)(x)), jnp.mean(jnp.sum(above**2, axis=1))
    return Measures(score, down / (dt * len(x)), away, fast, jnp.mean(jnp.sum(turns**2, axis=1)))


def _away(x: State) -> Scalar:
    """Distance from upright at rest, from 0 to 1; it has a slope everywhere."""
    tilt, bend = 2 + 2 * jnp.cos(x[0]), 2 - 2 * jnp.cos(x[1])  # squared chords
    far = (0.6 * tilt + 0.4 * bend) / 4
    near = tilt + bend + jnp.sum(x[2:] ** 2) / SPEED_OF_A_RADIAN**2
    return 0.5 * far + 0.5 * (1 - jnp.exp(-0.5 * near / GOAL_WIDTH**2))


@dataclass(frozen=True)
class EpisodeWeights:
    """Weights of an episode's measures. ``score`` lowers the cost, the others add to it."""

    score: float = 0.0
    down: float = 0.0
    away: float = 0.0
    fast: float = 0.0
    wound: float = 0.0

    def cost(self, measures: Measures) -> Scalar:
        """The cost that the gradient steps minimise."""
        bad = self.down * measures.down + self.away * measures.away + self.fast * measures.fast
        return bad + self.wound * measures.wound - self.score * measures.score


@functools.partial(jax.custom_vjp, nondiff_argnums=(1,))
def bound_adjoint(x: State, limit: float) -> State:
    """The state itself. Backwards, the gradient of all later costs is scaled down to a norm of at most ``limit``.

    A pendulum that turns over is chaotic: gradients through it grow without bound and carry no information.
    """
    return x


def _backwards(limit: float, _: None, gradient: Float[Array, "4"]) -> tuple[Float[Array, "4"]]:
    # A gradient that overflowed has no direction: it is dropped.
    gradient = jnp.nan_to_num(gradient, nan=0.0, posinf=0.0, neginf=0.0)
    # The summand keeps a gradient of 0 from 0 / 0.
    return (gradient * jnp.minimum(1.0, limit / jnp.sqrt(jnp.sum(gradient**2) + 1e-20)),)


bound_adjoint.defvjp(lambda x, limit: (x, None), _backwards)
