"""Recoveries from throws on many plants: the cost that a distillation may differentiate at its end."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..benchmark.rollout import Scenario
from ..physics.parameters import Parameters, leaderboard_parameters
from ..policy.jax_backend.controller import PolicyController
from ..policy.jax_backend.told import told_base
from ..tasks.throws import thrown_states
from ..types import Key, Scalar, State
from .analytic_policy_gradient import SCORE_RULES, PolicyGradientSettings, run_episode
from .distillation_settings import DistillationSettings
from .teacher import Teachers

THROWN = 4096
"""Throws that recoveries begin with."""


class Recoveries(NamedTuple):
    """What recoveries are drawn from."""

    plant: Parameters
    """Leaves of shape (plants,)."""
    base: Float[Array, "plants 9"]
    thrown: Float[Array, "throws 4"]
    """States after throws (rad, rad/s)."""


def make_recoveries(student: PolicyController, teachers: Teachers, random: np.random.Generator) -> Recoveries:
    """Recoveries on the teachers' plants, from throws of the nominal one."""
    thrown = thrown_states(random, leaderboard_parameters(student.robot), THROWN)
    return Recoveries(teachers.plant, teachers.base, jnp.float32(thrown))


def recovery_cost(
    student: PolicyController, recoveries: Recoveries, settings: DistillationSettings, key: Key
) -> Scalar:
    """Mean cost of some recoveries of a student that is told its plant; their gradients are bounded."""
    number, weights = settings.recovery_episodes, settings.recovery_weights
    plant_key, start_key = jax.random.split(key)
    chosen = jax.random.randint(plant_key, (number,), 0, len(recoveries.base))
    x0 = recoveries.thrown[jax.random.randint(start_key, (number,), 0, len(recoveries.thrown))]
    steps = round(settings.recovery_duration / SCORE_RULES.dt)
    # The mean gives each recovery this share of its gradient, which the weight of its time down scales.
    limit = PolicyGradientSettings().adjoint_limit * weights.down / number

    def one(plant: Parameters, base: Float[Array, "9"], start: State) -> Scalar:
        return weights.cost(run_episode(Scenario(plant), told_base(student, base), start, steps, limit))

    costs = jax.vmap(one)(jax.tree.map(lambda leaf: leaf[chosen], recoveries.plant), recoveries.base[chosen], x0)
    # A pendulum that became too fast for its time step teaches nothing.
    return jnp.mean(jnp.where(jnp.isfinite(costs), costs, 0.0))
