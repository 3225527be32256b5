"""The analytic policy gradient: backwards through policy and pendulum over whole episodes, then a step of Adam.

First states of episodes are drawn at random, new ones for every step. Throws are drawn by the rules of the
global-policy score; none of them is one of the benchmark's own.
"""

import itertools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Bool, Float

from ..areapo.networks import Actor
from ..benchmark.rollout import Scenario, simulate
from ..common import cores
from ..common.types import Scalar, State
from ..controllers.interface import AbstractController
from ..controllers.stack.policy import PolicyController
from ..dynamics.integrate import stable_substeps
from ..loop.starts import anywhere_states, thrown_states
from ..plant.files import load_plant
from ..plant.plant import LEADERBOARD, Plant, PlantLike, Robot
from .objective import SCORE_RULES, EpisodeWeights, Measures, bound_adjoint, measure_episode


@dataclass(frozen=True)
class PolicyGradientSettings:
    """How many gradient steps are taken, how large they are, and what the episodes minimise."""

    iterations: int = 900
    """Gradient steps."""
    learning_rate: float = 5e-4
    """Adam's largest step size: it rises over the first eighth of the steps and falls to a fiftieth on a cosine."""
    duration: float = 1.5
    """Length of an episode (s)."""
    adjoint_limit: float = 4.0
    """Largest norm of an episode's gradient with respect to one of its states (1/rad, s/rad)."""
    gradient_limit: float = 0.5
    """Largest norm of the policy's gradient; a larger one is scaled down."""
    weights: EpisodeWeights = EpisodeWeights(down=1.0, away=0.2)  # noqa: RUF009 - frozen
    """Weights of an episode's measures."""


@dataclass(frozen=True)
class EpisodeSettings:
    """How many episodes of each kind a step has, and the spread of their first states."""

    nominal: int = 4
    """Episodes that start hanging."""
    anywhere: int = 18
    """Episodes that start in any configuration, with random velocities; see ``speed``."""
    thrown: int = 180
    """Episodes that start where the throws of the global-policy score leave the pendulum."""
    speed: float = 8.0
    """Largest standard deviation of the first velocities of ``anywhere`` (rad/s)."""
    spread: float = 0.02
    """Largest standard deviation of the first states of ``nominal`` (rad, rad/s)."""


def sample_episodes(
    random: np.random.Generator, robot: Robot, settings: EpisodeSettings, plant: PlantLike = LEADERBOARD
) -> tuple[Float[np.ndarray, "n 4"], Bool[np.ndarray, "n"]]:
    """First states (rad, rad/s) of one step's episodes, in single precision, and which of them start hanging."""
    nominal, anywhere, thrown = settings.nominal, settings.anywhere, settings.thrown
    hanging = settings.spread * random.uniform(size=(nominal, 1)) * random.normal(size=(nominal, 4))
    free = anywhere_states(random, anywhere, settings.speed)
    after = thrown_states(random, load_plant(plant).driven(robot), thrown) if thrown else np.zeros((0, 4))
    x0 = np.concatenate([hanging, free, after]).astype(np.float32)
    # Shuffled: each core takes a slice of the batch, and every slice needs episodes of all kinds.
    order = random.permutation(len(x0))
    # The nominal episodes came first before the shuffle.
    return x0[order], order < nominal


class AnalyticPolicyGradient:
    """Gradient steps for one controller: a part of each batch on every core, or one batch on an accelerator."""

    def __init__(
        self, controller: PolicyController, settings: PolicyGradientSettings, plant: PlantLike = LEADERBOARD
    ) -> None:
        """Prepare; nothing is compiled before the first step. Without a plant it is the leaderboards'."""
        self._plant = load_plant(plant).driven(controller.robot)
        # The actor is differentiated, and so an argument of its own; here it is left out.
        self._controller = eqx.tree_at(lambda c: c.policy.actor, single_precision(controller), None)
        self._settings = settings
        rate, number = settings.learning_rate, settings.iterations
        schedule = optax.warmup_cosine_decay_schedule(0.0, rate, number // 8, number, rate / 50)
        bounded = optax.clip_by_global_norm(settings.gradient_limit)
        self._optimiser = optax.chain(bounded, optax.adam(schedule, b2=0.98))
        self._apply = jax.jit(self._updated)
        self.actor: Actor = single_precision(controller.policy.actor)
        """The network after the steps so far."""
        self._moments = self._optimiser.init(self.actor)

    def step(self, x0: Float[np.ndarray, "n 4"]) -> Measures:
        """Take one step on episodes from these states, and return their measures (leading axis: episode)."""
        # One compiled batch keeps one core busy; threads share the batch out.
        number = len(x0)
        parts = min(cores(), number) if jax.default_backend() == "cpu" else 1
        cuts = np.linspace(0, number, parts + 1).astype(int)
        pieces = [slice(*ends) for ends in itertools.pairwise(cuts)]

        def run(piece: slice) -> tuple[tuple[Scalar, Measures], Actor]:
            some = jnp.asarray(x0[piece])
            gradient = _gradient(self.actor, self._controller, some, self._settings, self._plant)
            return jax.block_until_ready(gradient)

        with ThreadPoolExecutor(parts) as pool:
            results = list(pool.map(run, pieces))
        # Parts may differ by an episode: each mean counts by its share of the batch.
        shares = np.diff(cuts) / cuts[-1]
        gradients = [gradient for _, gradient in results]
        self.actor, self._moments = self._apply(self.actor, self._moments, gradients, shares)
        return jax.tree.map(lambda *leaves: np.concatenate(leaves), *[measures for (_, measures), _ in results])

    def _updated(
        self, actor: Actor, moments: optax.OptState, gradients: list[Actor], shares: np.ndarray
    ) -> tuple[Actor, optax.OptState]:
        mean = jax.tree.map(lambda *parts: sum(a * b for a, b in zip(shares, parts, strict=True)), *gradients)
        updates, moments = self._optimiser.update(mean, moments)
        return optax.apply_updates(actor, updates), moments


def batch_cost(
    actor: Actor,
    controller: PolicyController,
    x0: Float[Array, "n 4"],
    settings: PolicyGradientSettings,
    plant: Plant,
) -> tuple[Scalar, Measures]:
    """Mean cost of a batch of episodes under a policy with this actor, and the episodes' measures.

    The cost is differentiated with respect to the actor, which replaces the controller's own.
    """
    return mean_cost(with_actor(controller, actor), x0, settings, plant)


def mean_cost(
    controller: AbstractController[Any], x0: Float[Array, "n 4"], settings: PolicyGradientSettings, plant: Plant
) -> tuple[Scalar, Measures]:
    """Mean cost of a batch of episodes from these states, and the episodes' measures."""
    scenario = Scenario(plant, substeps=stable_substeps(plant, SCORE_RULES.dt))
    limit = settings.adjoint_limit / len(x0)  # the mean gives each episode this share of its gradient

    def one(start: Float[Array, "4"]) -> tuple[Scalar, Measures]:
        measures = run_episode(scenario, controller, start, settings.duration, limit)
        return settings.weights.cost(measures), measures

    costs, measures = jax.vmap(one)(x0)
    return jnp.mean(costs), measures


def run_episode(
    scenario: Scenario, controller: AbstractController[Any], x0: State, duration: float, adjoint_limit: float
) -> Measures:
    """The measures of one episode (s); ``adjoint_limit`` bounds the gradient with respect to each of its states."""
    steps, guard = round(duration / SCORE_RULES.dt), lambda x: bound_adjoint(x, adjoint_limit)
    *_, rows = simulate(scenario, controller, x0, SCORE_RULES.dt, steps, guard=guard)
    return measure_episode(rows, scenario.parameters)


def with_actor(controller: PolicyController, actor: Actor) -> PolicyController:
    """The controller with this network, whether it has one or was left without."""
    return eqx.tree_at(lambda c: c.policy.actor, controller, actor, is_leaf=lambda leaf: leaf is None)


_gradient = jax.jit(jax.value_and_grad(batch_cost, has_aux=True), static_argnames=("settings", "plant"))


def single_precision(tree: Any) -> Any:
    """All numbers of a controller, or of a part of it, as arrays in single precision."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32) if eqx.is_array_like(leaf) else leaf, tree)
