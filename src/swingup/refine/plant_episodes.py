"""Episodes on many plants at the end of a distillation: swing-ups, and recoveries from throws.

Each is simulated with the student, which comes to see its plant, and its cost is differentiated through the
pendulum, as on the nominal plant (:mod:`.analytic_policy_gradient`).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..benchmark.rollout import Scenario, simulate
from ..physics.parameters import Parameters, leaderboard_parameters
from ..policy.jax_backend.controller import PolicyController
from ..tasks.throws import thrown_states
from ..types import Flag, Key, Scalar, State
from .analytic_policy_gradient import SCORE_RULES, PolicyGradientSettings
from .distillation_settings import DistillationSettings
from .informed import Informed, draw_known_after
from .objective import bound_adjoint, measure_episode, swingup_score
from .teacher import Teachers

THROWN = 4096
"""Throws that recoveries begin with."""
OFFSETS = 0.035, 0.02, 0.0, 0.0
"""Largest errors of the measured angles (rad): those of the domain ``recorded``."""
SPREAD = 0.05
"""Standard deviation of the first states of swing-ups (rad, rad/s)."""


class PlantEpisodes(NamedTuple):
    """What the episodes are drawn from."""

    plant: Parameters
    """Leaves of shape (plants,)."""
    base: Float[Array, "plants 9"]
    nominal: Float[Array, "9"]
    """Base parameters that the student sees first."""
    thrown: Float[Array, "throws 4"]
    """States after throws (rad, rad/s)."""


def plant_episodes(student: PolicyController, teachers: Teachers, random: np.random.Generator) -> PlantEpisodes:
    """Episodes on the teachers' plants."""
    thrown = thrown_states(random, leaderboard_parameters(student.robot), THROWN)
    return PlantEpisodes(teachers.plant, teachers.base, teachers.nominal[0], jnp.float32(thrown))


def plant_cost(
    student: PolicyController, episodes: PlantEpisodes, settings: DistillationSettings, key: Key
) -> Scalar:
    """Mean cost of some episodes, drawn by the key; gradients through a pendulum are bounded."""
    s, number, dt = settings, settings.plant_episodes, SCORE_RULES.dt
    plant_key, throw_key, hang_key, known_key, offset_key = jax.random.split(key, 5)
    chosen = jax.random.randint(plant_key, (number,), 0, len(episodes.base))
    thrown = episodes.thrown[jax.random.randint(throw_key, (number,), 0, len(episodes.thrown))]
    hanging = SPREAD * jax.random.normal(hang_key, (number, 4))
    swings_up = jnp.arange(number) < s.plant_swingups
    x0 = jnp.where(swings_up[:, None], hanging, thrown)
    offsets = s.plant_offset * jax.random.uniform(offset_key, (number, 4), minval=-1.0) * jnp.array(OFFSETS)
    # The mean gives each episode this share of its gradient, which the weight of its time down scales.
    bound = PolicyGradientSettings().adjoint_limit * s.plant_weights.down / number

    def one(
        plant: Parameters, base: Float[Array, "9"], start: State, swings_up: Flag, offset: State, key: Key
    ) -> Scalar:
        known_after = draw_known_after(key, s.slowest)
        informed = Informed(student, episodes.nominal, base, known_after, offset)
        _, rows = simulate(
            Scenario(plant), informed, start, dt, round(s.plant_duration / dt),
            guard=lambda x: bound_adjoint(x, bound),
        )  # fmt: skip
        measures = measure_episode(rows, plant, dt, SCORE_RULES)
        swingup = s.plant_weights.fast * measures.fast - s.score_weight * swingup_score(measures)
        return jnp.where(swings_up, swingup, s.plant_weights.cost(measures))

    plants = jax.tree.map(lambda leaf: leaf[chosen], episodes.plant)
    keys = jax.random.split(known_key, number)
    costs = jax.vmap(one)(plants, episodes.base[chosen], x0, swings_up, offsets, keys)
    # A pendulum that became too fast for its time step teaches nothing.
    return jnp.mean(jnp.where(jnp.isfinite(costs), costs, 0.0))
