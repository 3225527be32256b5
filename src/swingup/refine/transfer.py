"""A policy for one known plant without training: the shipped one, told another plant than the true one.

The shipped ``adaptive`` was taught plants about design C.1. Many others it swings up where its network is told base
parameters that differ from the true ones, for a part of the motor's torque. A search by cross-entropy finds such
numbers: candidates swing the true plant up in a perfect loop, side by side, and the next ones are drawn about the
best. The state estimator and the regulator at the top have the true plant. The search proves nothing where no
candidate comes up.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..benchmark.rollout import Scenario, simulate
from ..common.types import Flag, Scalar, State
from ..controllers.stack.policy import make_controller
from ..dynamics.dynamics import tip_height
from ..dynamics.integrate import stable_substeps
from ..loop.loop import LOOP_DT
from ..plant.base_parameters import base_parameters
from ..plant.plant import ZEROS, Plant, Robot
from ..plant.units import TORQUE, arm_scales, scaled
from ..policy.estimator import default_estimator
from ..policy.guard import GuardSettings
from ..policy.network import fold, stages_for
from ..policy.pendulum import PendulumPolicy, policy_plant
from ..policy.shipped import ADAPTIVE, load_pendulum_policy
from ..tasks.pendulum import UP_FRACTION
from .gradient import single_precision
from .recipe import HAND_OVER


@dataclass(frozen=True)
class SearchSettings:
    """What is drawn, and what counts."""

    candidates: int = 128  # Of a round; the first one is told the true plant
    rounds: int = 5
    best: int = 12
    """Candidates about which the next ones are drawn. The search ends when so many hold from all starts."""
    runs: int = 256  # Simulations of a round
    angles: float = 0.06  # Largest angle of either joint in a start, at rest (rad)
    spread: float = 0.3  # Standard deviation of the factors' logarithms in the first round
    least_share: float = 0.4  # Least share of the motor's torque in the first round
    narrowing: float = 0.7  # A later round's deviations, of those of the best; at least ``least_spread``
    least_spread: float = 0.08
    duration: float = 8.0  # Of a simulation (s)
    held: float = 2.0  # A run counts as held where the tip is up for the last of it (s)
    margin: float = 0.95  # Share of a guard's limits beyond which a run counts as hanging


class Tried(NamedTuple):
    """A candidate and how it did."""

    held: float  # Share of its starts from which it holds
    height: float  # Mean height of the tip over time, from -1 to 1
    told: Float[np.ndarray, "5"]
    policy: PendulumPolicy


def find_policies(
    plant: Plant,
    robot: Robot,
    guard: GuardSettings,
    seed: int = 0,
    settings: SearchSettings = SearchSettings(),
    progress: Callable[[int, int], None] = lambda *_: None,
) -> list[PendulumPolicy]:
    """Policies that swing a plant up within a guard's limits, the most reliable first; perhaps none.

    ``progress`` is called with the number of rounds that are done, and of all.
    """
    shipped, random = load_pendulum_policy(ADAPTIVE, robot), np.random.default_rng(seed)
    plant = policy_plant(plant, robot)
    trial, number = Trial(tell(shipped, plant, np.zeros(5)), guard, settings), settings.candidates
    shares = random.uniform(np.log(settings.least_share), 0.0, number)
    told = np.column_stack([settings.spread * random.normal(size=(number, 4)), shares])
    told[0] = 0.0
    found: list[Tried] = []

    def best_first(tried: list[Tried]) -> list[Tried]:
        return sorted(tried, key=lambda each: (each.held, each.height), reverse=True)

    for index in range(settings.rounds):
        tried = trial([(each, tell(shipped, plant, each)) for each in told], random)
        found = best_first(found + tried)[: settings.best]
        progress(index + 1, settings.rounds)
        if found[-1].held == 1.0:
            break
        best = np.array([each.told for each in found])
        spread = np.maximum(settings.least_spread, settings.narrowing * best.std(0))
        told = best[random.integers(len(best), size=number)] + spread * random.normal(size=(number, 5))
        told[:, 4] = np.minimum(told[:, 4], 0.0)
    # Again, from more starts.
    final = trial([(each.told, each.policy) for each in found if each.held], random)
    return [each.policy for each in best_first(final) if each.held]


def tell(shipped: PendulumPolicy, plant: Plant, told: Float[np.ndarray, "5"]) -> PendulumPolicy:
    """The shipped policy for a plant, told another one.

    ``told`` has logarithms: of the factors of the plant's inertia and gravity (the first four base parameters), and
    of the share of the motor's torque that the policy uses, at most 0.
    """
    robot = shipped.robot
    *factors, share = np.exp(told).tolist()
    motor = ("tl1", "tl2")[robot.joint]
    weaker = plant.frictionless().changed(**{motor: share * plant.limit(robot.joint)})
    base = base_parameters(weaker)
    base[:4] *= factors
    network = replace(shipped.network, stages=stages_for(shipped.network.stages, shipped.plant, weaker))
    limit = shipped.torque_limit / shipped.plant.limit(robot.joint) * weaker.limit(robot.joint)
    return PendulumPolicy(
        fold(network, base),
        robot,
        min(limit, plant.limit(robot.joint)),
        plant,
        estimator=default_estimator(plant),
        regulator=scaled(HAND_OVER[robot.name], arm_scales(plant)),
        metadata={"base": {"policy": ADAPTIVE, "told": {"factors": factors, "torque_share": share}}},
    )


class Trial:
    """Simulations of candidates for one plant, compiled once."""

    def __init__(self, first: PendulumPolicy, guard: GuardSettings, settings: SearchSettings) -> None:
        """Candidates may differ from the first in the network's first bias and in the torque limit."""
        plant = first.plant.changed(**ZEROS)
        controller = make_controller(replace(first, plant=plant), estimator=False)
        scenario = Scenario(plant, substeps=stable_substeps(plant, LOOP_DT))
        limits = settings.margin * guard.angle_limit, settings.margin * guard.velocity_limit
        self._known = single_precision((controller, scenario, arm_scales(plant).of(TORQUE), limits))
        self._settings = settings

    def __call__(
        self, candidates: list[tuple[Float[np.ndarray, "5"], PendulumPolicy]], random: np.random.Generator
    ) -> list[Tried]:
        """How candidates do, each from as many random starts as make the number of runs."""
        if not candidates:
            return []
        settings = self._settings
        owner = np.arange(settings.runs) % len(candidates)
        biases = np.stack([policy.network.trunk[0].bias for _, policy in candidates])[owner]
        torques = np.array([policy.torque_limit for _, policy in candidates])[owner]
        angles = random.uniform(-settings.angles, settings.angles, (settings.runs, 2))
        starts = np.column_stack([angles, np.zeros_like(angles)])
        runs = _runs(self._known, single_precision((biases, torques, starts)), settings)
        held, height = (np.bincount(owner, np.asarray(each)) / np.bincount(owner) for each in runs)
        rows = zip(held.tolist(), height.tolist(), candidates, strict=True)
        return [Tried(share, mean, *candidate) for share, mean, candidate in rows]


@eqx.filter_jit
def _runs(known: Any, varied: Any, settings: SearchSettings) -> tuple[Bool[Array, "n"], Float[Array, "n"]]:
    """Whether each run holds, and the mean height of its tip."""
    controller, scenario, torque_unit, (angle_limit, velocity_limit) = known
    last = round(settings.held / LOOP_DT)

    def one(bias: Float[Array, "hidden"], limit: Scalar, x0: State) -> tuple[Flag, Scalar]:
        own = eqx.tree_at(
            lambda c: (c.controller.policy.actor.trunk[0].bias, c.controller.torque_limit, c.torque_limit),
            controller,
            (bias, limit, limit / torque_unit),
        )
        _, _, rows = simulate(scenario, own, x0, LOOP_DT, round(settings.duration / LOOP_DT))
        height = jax.vmap(lambda x: tip_height(scenario.parameters, x))(rows.x) / scenario.parameters.length
        # A guard stops a run for good.
        most = jax.lax.cummax(jnp.abs(rows.x), axis=0)
        within = (most[:, :2].max(1) < angle_limit) & (most[:, 2:].max(1) < velocity_limit)
        height = jnp.where(within, height, -1.0)
        return height[-last:].min() > UP_FRACTION, height.mean()

    return jax.vmap(one)(*varied)
