"""Recoveries on many plants, from throws and about the top: a cost that ends a distillation by its gradient."""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..benchmark.boards import ICRA_REAL
from ..benchmark.rollout import Scenario
from ..common.types import Key, Scalar, State
from ..controllers.stack.controller import PolicyController, plant_of
from ..dynamics.angles import UPRIGHT
from ..loop.supervisors.throws import thrown_states
from ..plant.plant import Plant
from .analytic_policy_gradient import PolicyGradientSettings, run_episode
from .distillation_settings import RecoverySettings

STARTS = 8192
"""States that recoveries begin with."""
LARGEST_COST_TO_GO = 1.0
"""Largest cost-to-go of the nominal plant's LQR where a recovery begins near the top."""
PASSING = (0.4, 0.5, 2.5, 2.0)
"""Standard deviations of states that pass over the top (rad, rad/s)."""
HANGING = 0.02
"""Standard deviation of hanging ones (rad, rad/s)."""


class Recoveries(NamedTuple):
    """What recoveries are drawn from; the last plant is the nominal one."""

    plant: Plant
    """Leaves of shape (plants,)."""
    base: Float[Array, "plants 9"]
    starts: Float[Array, "starts 4"]
    """States that recoveries begin in (rad, rad/s)."""
    on: Int[Array, "starts"]
    """The plants that they begin on; -1 for any."""


def make_recoveries(
    student: PolicyController,
    plant: Plant,
    base: Float[Array, "plants 9"],
    cost_to_go: Float[Array, "4 4"],
    settings: RecoverySettings | None,
    random: np.random.Generator,
) -> Recoveries | None:
    """Recoveries on plants with these base parameters; the last, the nominal one, has this LQR's cost-to-go.

    Without settings there are none.
    """
    if settings is None:
        return None
    s = settings
    shares = np.array([s.thrown * s.nominal, s.thrown * (1 - s.nominal), s.robots, s.top, s.passing, s.hanging])
    ends = np.round(STARTS * np.cumsum(shares) / shares.sum()).astype(int)
    nominal, others, robots, top, passing, hanging = np.diff(ends, prepend=0)
    of = plant_of(student)
    starts = np.concatenate(
        [
            thrown_states(random, of, nominal + others),
            thrown_states(random, of, robots, ICRA_REAL.thrower, ICRA_REAL.throw_duration),
            _near_top(np.asarray(cost_to_go, float), top, random),
            UPRIGHT + np.array(PASSING) * random.normal(size=(passing, 4)),
            HANGING * random.normal(size=(hanging, 4)),
        ]
    )
    # The policy sees no full turns, and is not to blame for those that a throw makes.
    starts[:, :2] = np.mod(starts[:, :2] + [0.0, np.pi], 2 * np.pi) - [0.0, np.pi]
    on = np.where(np.arange(STARTS) < nominal, len(base) - 1, -1)
    return Recoveries(plant, base, jnp.float32(starts), jnp.asarray(on))


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
    student: PolicyController, recoveries: Recoveries, settings: RecoverySettings, key: Key
) -> Scalar:
    """Mean cost of some recoveries of a student that is told its plant; their gradients are bounded."""
    number, weights = settings.episodes, settings.weights
    plant_key, start_key = jax.random.split(key)
    start = jax.random.randint(start_key, (number,), 0, len(recoveries.starts))
    chosen, on = jax.random.randint(plant_key, (number,), 0, len(recoveries.base)), recoveries.on[start]
    chosen = jnp.where(on < 0, chosen, on)
    # The mean gives each recovery this share of its gradient, which the weight of its time down scales.
    limit = PolicyGradientSettings().adjoint_limit * weights.down / number

    def one(plant: Plant, base: Float[Array, "9"], start: State) -> Scalar:
        return weights.cost(
            run_episode(Scenario(plant), replace(student, base=base), start, settings.duration, limit)
        )

    plants = jax.tree.map(lambda leaf: leaf[chosen], recoveries.plant)
    costs = jax.vmap(one)(plants, recoveries.base[chosen], recoveries.starts[start])
    # A pendulum that became too fast for its time step teaches nothing.
    return jnp.mean(jnp.where(jnp.isfinite(costs), costs, 0.0))
