"""The score made smooth, and what is minimised: one number of a whole episode that has a gradient."""

import functools
import math
from dataclasses import dataclass, fields

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..benchmark.rollout import Trajectory
from ..benchmark.rules import PerformanceRules
from ..physics.dynamics import tip_height
from ..physics.parameters import Parameters
from ..types import Scalar, State

EDGE = 0.01
"""Width of the smoothed line above which the tip is up (m)."""
NEAR = 0.3
"""Width of the goal's neighbourhood (rad)."""
FAST = 4.0
"""Velocity that counts as one radian off (rad/s)."""


class Measures(eqx.Module):
    """What an episode amounts to."""

    score: Scalar
    """The RealAI score with the time that the tip is down, smoothly counted, for swing-up time."""
    down: Scalar
    """Share of the time that the tip is down."""
    away: Scalar
    """Mean distance from the goal, from 0 to 1: half of it says whether it is near, half how far."""


def measure(trajectory: Trajectory, parameters: Parameters, dt: float, rules: PerformanceRules) -> Measures:
    """Measure an episode whose rows are dt (s) apart; what comes after it is taken to cost nothing."""
    x, u = jnp.asarray(trajectory.x), jnp.asarray(trajectory.u)
    line = rules.height * parameters.length
    down = jnp.sum(jax.nn.sigmoid((line - jax.vmap(tip_height, (None, 0))(parameters, x)) / EDGE)) * dt
    changes = jnp.diff(u, axis=0)
    rows = rules.steps - 1
    mean, square = jnp.sum(changes, axis=0) / rows, jnp.sum(changes**2, axis=0) / rows
    costs = {
        "swingup_time": down,
        "energy": jnp.sum(jnp.abs(jnp.diff(x[:, :2], axis=0) * u[:-1])),
        "torque_cost": jnp.sum(u**2) * dt,
        # A square root has no slope at 0, where the passive joint's torque is.
        "torque_smoothness": jnp.sum(jnp.sqrt(square - mean**2 + 1e-12)),
        "velocity_cost": jnp.sum(x[:, 2:] ** 2) * dt,
    }
    names = [field.name for field in fields(rules.normalisers)]
    penalties = [jnp.tanh(math.pi * costs[name] / getattr(rules.normalisers, name)) for name in names]
    score = 1.0 - sum(penalties, start=jnp.zeros(())) / len(penalties)
    return Measures(score, down / (dt * len(x)), jnp.mean(jax.vmap(_away)(x)))


def _away(x: State) -> Scalar:
    """Distance from upright at rest, from 0 to 1; it has a slope everywhere."""
    tilt, bend = 2 + 2 * jnp.cos(x[0]), 2 - 2 * jnp.cos(x[1])  # squared chords
    far = (0.6 * tilt + 0.4 * bend) / 4
    near = tilt + bend + jnp.sum(x[2:] ** 2) / FAST**2
    return 0.5 * far + 0.5 * (1 - jnp.exp(-0.5 * near / NEAR**2))


@dataclass(frozen=True)
class Weights:
    """What counts in an episode, and how much: the cost is down and away, less the score."""

    score: float = 0.0
    down: float = 0.0
    away: float = 0.0

    def cost(self, measures: Measures) -> Scalar:
        """What is minimised."""
        return self.down * measures.down + self.away * measures.away - self.score * measures.score


SCORE = Weights(score=1.0)
"""The score alone."""
SCORE_AND_TIME = Weights(score=0.5, down=0.5, away=0.5)
"""The score, and being at the goal."""
TIME = Weights(down=1.0, away=0.2)
"""Being up, and not only for a moment."""


@functools.partial(jax.custom_vjp, nondiff_argnums=(1,))
def bound_adjoint(x: State, limit: float) -> State:
    """The state itself; backwards, the gradient of all that follows is cut to a norm of ``limit``.

    A pendulum that turns over is chaotic: gradients through it grow without bound and say nothing.
    """
    return x


def _forwards(x: State, limit: float) -> tuple[State, None]:
    return x, None


def _backwards(limit: float, _: None, gradient: Float[Array, "4"]) -> tuple[Float[Array, "4"]]:
    gradient = jnp.nan_to_num(gradient, nan=0.0, posinf=0.0, neginf=0.0)
    return (gradient * jnp.minimum(1.0, limit / jnp.sqrt(jnp.sum(gradient**2) + 1e-20)),)


bound_adjoint.defvjp(_forwards, _backwards)
