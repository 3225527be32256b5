"""Recoveries on many plants, from throws and near the top: a cost that ends a distillation by its gradient."""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..benchmark.rollout import Scenario
from ..common.types import Key, Scalar, State
from ..controllers.stack.controller import PolicyController, plant_of
from ..dynamics.angles import UPRIGHT
from ..loop.supervisors.throws import thrown_states
from ..plant.plant import Plant
from .analytic_policy_gradient import SCORE_RULES, PolicyGradientSettings, run_episode
from .distillation_settings import DistillationSettings
from .teacher import Teachers

STARTS = 4096
"""States that recoveries begin with."""
LARGEST_COST_TO_GO = 1.0
"""Largest cost-to-go of the nominal plant's LQR where a recovery begins near the top."""


class Recoveries(NamedTuple):
    """What recoveries are drawn from."""

    plant: Plant
    """Leaves of shape (plants,)."""
    base: Float[Array, "plants 9"]
    starts: Float[Array, "starts 4"]
    """States after throws and near the top (rad, rad/s)."""


def make_recoveries(
    student: PolicyController, teachers: Teachers, settings: DistillationSettings, random: np.random.Generator
) -> Recoveries:
    """Recoveries on the teachers' plants, from throws of the nominal one, the last, and from near its top."""
    near = round(settings.recovery_top * STARTS)
    thrown = thrown_states(random, plant_of(student), STARTS - near)
    starts = np.concatenate([thrown, _near_top(np.asarray(teachers.cost_to_go[-1], float), near, random)])
    return Recoveries(teachers.plant, teachers.base, jnp.float32(starts))


def _near_top(
    cost_to_go: Float[np.ndarray, "4 4"], number: int, random: np.random.Generator
) -> Float[np.ndarray, "number 4"]:
    """States about upright whose costs-to-go are uniform up to ``LARGEST_COST_TO_GO``."""
    directions = random.normal(size=(number, 4))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    sizes = np.sqrt(LARGEST_COST_TO_GO * random.uniform(size=(number, 1)))
    # With S = L Lᵀ, errors L⁻ᵀ z have the costs zᵀ z.
    errors = np.linalg.solve(np.linalg.cholesky(cost_to_go).T, (sizes * directions).T)
    return UPRIGHT + errors.T


def recovery_cost(
    student: PolicyController, recoveries: Recoveries, settings: DistillationSettings, key: Key
) -> Scalar:
    """Mean cost of some recoveries of a student that is told its plant; their gradients are bounded."""
    number, weights = settings.recovery_episodes, settings.recovery_weights
    plant_key, start_key = jax.random.split(key)
    chosen = jax.random.randint(plant_key, (number,), 0, len(recoveries.base))
    x0 = recoveries.starts[jax.random.randint(start_key, (number,), 0, len(recoveries.starts))]
    steps = round(settings.recovery_duration / SCORE_RULES.dt)
    # The mean gives each recovery this share of its gradient, which the weight of its time down scales.
    limit = PolicyGradientSettings().adjoint_limit * weights.down / number

    def one(plant: Plant, base: Float[Array, "9"], start: State) -> Scalar:
        return weights.cost(run_episode(Scenario(plant), replace(student, base=base), start, steps, limit))

    costs = jax.vmap(one)(jax.tree.map(lambda leaf: leaf[chosen], recoveries.plant), recoveries.base[chosen], x0)
    # A pendulum that became too fast for its time step teaches nothing.
    return jnp.mean(jnp.where(jnp.isfinite(costs), costs, 0.0))
