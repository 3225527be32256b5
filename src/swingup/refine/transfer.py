"""A policy for one known plant without training: the shipped one, told another plant than the true one.

The shipped ``adaptive`` was taught plants about design C.1. Many others it swings up where its network is told base
parameters that differ from the true ones, and has a part of the motor's torque. Such numbers are drawn, and the
candidates swing the true plant up in a perfect loop, side by side. The state estimator and the regulator at the top
have the true plant. The search proves nothing where no candidate comes up.
"""

from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..benchmark.rollout import Scenario, simulate
from ..common.types import Scalar, State
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
class TransferSettings:
    """What is drawn, and which candidates count."""

    candidates: int = 128  # The first one is told the true plant
    finalists: int = 16  # Those that are tried again
    runs: int = 256  # Simulations in each of both trials
    angles: float = 0.06  # Largest angle of either joint in a start (rad)
    spread: float = 0.25
    """Standard deviation of the logarithms of the factors of the inertia's and gravity's base parameters."""
    torque_shares: tuple[float, float] = (0.35, 1.05)
    """Shares of the motor's torque for which the network is made, even in the logarithm."""
    duration: float = 8.0  # Of a simulation (s)
    held: float = 2.0  # A run counts where the tip stays up for the last of it (s)
    margin: float = 0.95  # ... and speeds and angles stay below this share of the guard's limits
    speed_weight: float = 2.0  # A speed at the guard's limit costs as much as this time to the top (s)


def draw_candidates(
    plant: Plant, robot: Robot, seed: int = 0, settings: TransferSettings = TransferSettings()
) -> list[PendulumPolicy]:
    """Policies for a plant whose networks are told other plants, each behind an estimator, with a regulator."""
    shipped, plant, random = (
        load_pendulum_policy(ADAPTIVE, robot),
        policy_plant(plant, robot),
        np.random.default_rng(seed),
    )
    factors = np.exp(settings.spread * random.normal(size=(settings.candidates, 4)))
    shares = np.exp(random.uniform(*np.log(settings.torque_shares), settings.candidates))
    factors[0], shares[0] = 1.0, 1.0
    return [_told(shipped, plant, each, share) for each, share in zip(factors, shares, strict=True)]


def _told(shipped: PendulumPolicy, plant: Plant, factors: Float[np.ndarray, "4"], share: float) -> PendulumPolicy:
    """The shipped policy for a share of the motor's torque, told the plant's inertia and gravity times factors."""
    robot = shipped.robot
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
        metadata={"base": {"policy": ADAPTIVE, "told": {"factors": factors.tolist(), "torque_share": share}}},
    )


def best_candidates(
    candidates: list[PendulumPolicy],
    guard: GuardSettings,
    seed: int = 0,
    settings: TransferSettings = TransferSettings(),
) -> list[PendulumPolicy]:
    """Those that swing their plant up within a guard's limits: the most reliable first, then the fast and calm.

    The best are tried again, from other starts.
    """
    plant, random = candidates[0].plant.changed(**ZEROS), np.random.default_rng(seed)
    controller = make_controller(replace(candidates[0], plant=plant), estimator=False)
    scenario = Scenario(plant, substeps=stable_substeps(plant, LOOP_DT))
    known = single_precision((controller, scenario, arm_scales(plant).of(TORQUE)))
    left = candidates
    for _ in range(2):
        if not left:
            break
        owner = np.arange(settings.runs) % len(left)  # The number of runs stays, so that they compile once
        biases = np.stack([each.network.trunk[0].bias for each in left])[owner]
        limits = np.array([each.torque_limit for each in left])[owner]
        angles = random.uniform(-settings.angles, settings.angles, (settings.runs, 2))
        runs = single_precision((biases, limits, np.column_stack([angles, 0 * angles])))
        arrival, speed, angle = map(np.asarray, _runs(*known, *runs, settings))
        good = (arrival < settings.duration - settings.held) & (speed < settings.margin * guard.velocity_limit)
        good &= angle < settings.margin * guard.angle_limit
        # Failures are far apart: time and speed decide among candidates that are equally reliable.
        cost = 1e3 * ~good + np.where(good, arrival + settings.speed_weight * speed / guard.velocity_limit, 0.0)
        means, share = (np.bincount(owner, each) / np.bincount(owner) for each in (cost, good))
        left = [left[index] for index in np.argsort(means)[: settings.finalists] if share[index] > 0]
    return left


@eqx.filter_jit
def _runs(
    controller: Any,
    scenario: Scenario,
    torque_unit: Scalar,
    biases: Float[Array, "n hidden"],
    limits: Float[Array, "n"],
    starts: Float[Array, "n 4"],
    settings: TransferSettings,
) -> tuple[Float[Array, "n"], ...]:
    """When each run is up for good (s), and its largest speed (rad/s) and angle (rad)."""
    line = UP_FRACTION * scenario.parameters.length

    def varied(c: Any) -> tuple[Any, ...]:
        return c.controller.policy.actor.trunk[0].bias, c.controller.torque_limit, c.torque_limit

    def one(bias: Array, limit: Scalar, x0: State) -> tuple[Scalar, ...]:
        own = eqx.tree_at(varied, controller, (bias, limit, limit / torque_unit))
        _, _, rows = simulate(scenario, own, x0, LOOP_DT, round(settings.duration / LOOP_DT))
        down = jax.vmap(lambda x: ~(tip_height(scenario.parameters, x) > line))(rows.x)
        arrival = LOOP_DT * (1 + jnp.max(jnp.where(down, jnp.arange(len(down)), -1)))
        size = jnp.max(jnp.abs(rows.x), axis=0)
        return arrival, jnp.max(size[2:]), jnp.max(size[:2])

    return jax.vmap(one)(biases, limits, starts)
