"""Recoveries on many plants, from throws and about the top: a cost that ends a distillation by its gradient."""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..benchmark.boards import ICRA_REAL
from ..benchmark.rollout import Scenario
from ..common.types import Key, Scalar, State
from ..controllers.interface import AbstractController
from ..controllers.stack.policy import PolicyController, plant_of
from ..controllers.stack.regulator import RegulatingController, with_regulator
from ..dynamics.dynamics import UPRIGHT
from ..loop.starts import thrown_states
from ..plant.plant import Plant
from ..policy.regulator import Loop, RegulatorSettings
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


class ToldRegulator(RegulatingController):
    """A regulator whose cost-to-go is that of its plant from the first call on, and so need not follow."""

    @property
    def loop(self) -> Loop:
        """What the regulator knows."""
        return super().loop._replace(advanced=lambda P, _: P)


class Recoveries(NamedTuple):
    """What recoveries are drawn from; the last plant is the nominal one."""

    plant: Plant
    """Leaves of shape (plants,)."""
    base: Float[Array, "plants 9"]
    starts: Float[Array, "starts 4"]
    """States that recoveries begin in (rad, rad/s)."""
    on: Int[Array, "starts"]
    """The plants that they begin on; -1 for any."""
    regulators: ToldRegulator | None = None
    """Those of the plants, without the policy: ``start`` has shape (plants, 15). None where the policy is alone."""

    def told(self, student: PolicyController, index: Int[Array, ""] | int) -> AbstractController[Any]:
        """The student, and the regulator if there is one, told one of the plants."""
        student = replace(student, base=self.base[index])
        if self.regulators is None:
            return student
        start = self.regulators.start[index]
        return replace(self.regulators, controller=student, base=student.base, start=start)


def make_regulators(
    student: PolicyController, start: Float[np.ndarray, "plants 15"], settings: RegulatorSettings
) -> ToldRegulator:
    """The regulators of plants with these costs-to-go, upper triangles in C.1's units."""
    made = with_regulator(student, student.robot, plant_of(student), settings, student.torque_limit)
    known = {name: getattr(made, name) for name in ("torque_limit", "geometry", "settings", "scales", "robot")}
    return ToldRegulator(None, made.base, jnp.float32(start), **known)  # type: ignore[arg-type]  # see ``told``


def make_recoveries(
    student: PolicyController,
    plant: Plant,
    base: Float[Array, "plants 9"],
    cost_to_go: Float[Array, "4 4"],
    settings: RecoverySettings | None,
    random: np.random.Generator,
    regulators: ToldRegulator | None = None,
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
    return Recoveries(plant, base, jnp.float32(starts), jnp.asarray(on), regulators)


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
    """Mean cost of some recoveries of a student that is told its plant, as far as a regulator lets it act.

    Their gradients are bounded.
    """
    number, weights = settings.episodes, settings.weights
    plant_key, start_key = jax.random.split(key)
    start = jax.random.randint(start_key, (number,), 0, len(recoveries.starts))
    chosen, on = jax.random.randint(plant_key, (number,), 0, len(recoveries.base)), recoveries.on[start]
    chosen = jnp.where(on < 0, chosen, on)
    # The mean gives each recovery this share of its gradient, which the weight of its time down scales.
    limit = PolicyGradientSettings().adjoint_limit * weights.down / number

    def one(index: Int[Array, ""], start: State) -> Scalar:
        plant = jax.tree.map(lambda leaf: leaf[index], recoveries.plant)
        controller = recoveries.told(student, index)
        return weights.cost(run_episode(Scenario(plant), controller, start, settings.duration, limit))

    costs = jax.vmap(one)(chosen, recoveries.starts[start])
    # A pendulum that became too fast for its time step teaches nothing.
    return jnp.mean(jnp.where(jnp.isfinite(costs), costs, 0.0))
