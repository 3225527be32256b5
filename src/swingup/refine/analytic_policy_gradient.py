"""The analytic policy gradient: backwards through policy and pendulum over whole episodes, then a step of Adam."""

import itertools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from ..areapo.networks import Actor
from ..benchmark.boards import PERFORMANCE
from ..benchmark.rollout import Scenario, simulate
from ..common.cores import cores
from ..common.types import Scalar, State
from ..controllers.interface.controller import AbstractController
from ..controllers.stack.controller import PolicyController
from ..dynamics.integrate import stable_substeps
from ..plant.plant import LEADERBOARD, Plant, PlantLike, load_plant
from .episodes import EpisodeBatch
from .objective import EpisodeWeights, Measures, bound_adjoint, measure_episode

SCORE_RULES = PERFORMANCE
"""The rules whose score the objective smooths, and whose time step the episodes have."""


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

    @property
    def steps(self) -> int:
        """Steps of an episode."""
        return round(self.duration / SCORE_RULES.dt)


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
        self._optimiser = _optimiser(settings)
        self._apply = jax.jit(self._updated)
        self.actor: Actor = single_precision(controller.policy.actor)
        """The network after the steps so far."""
        self._moments = self._optimiser.init(self.actor)

    def step(self, episodes: EpisodeBatch) -> Measures:
        """Take one step, and return the episodes' measures (leading axis: episode)."""
        # One compiled batch keeps one core busy; threads share the batch out.
        number = len(episodes.x0)
        parts = min(cores(), number) if jax.default_backend() == "cpu" else 1
        cuts = np.linspace(0, number, parts + 1).astype(int)
        pieces = [slice(*ends) for ends in itertools.pairwise(cuts)]

        def run(piece: slice) -> tuple[tuple[Scalar, Measures], Actor]:
            x0 = jnp.asarray(episodes.x0[piece])
            gradient = _gradient(self.actor, self._controller, x0, self._settings, self._plant)
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
    controller = with_actor(controller, actor)
    scenario = Scenario(plant, substeps=stable_substeps(plant, SCORE_RULES.dt))
    limit = settings.adjoint_limit / len(x0)  # the mean gives each episode this share of its gradient

    def one(start: Float[Array, "4"]) -> tuple[Scalar, Measures]:
        measures = run_episode(scenario, controller, start, settings.steps, limit)
        return settings.weights.cost(measures), measures

    costs, measures = jax.vmap(one)(x0)
    return jnp.mean(costs), measures


def run_episode(
    scenario: Scenario, controller: AbstractController[Any], x0: State, steps: int, adjoint_limit: float
) -> Measures:
    """The measures of one episode; ``adjoint_limit`` bounds the gradient with respect to each of its states."""
    _, rows = simulate(
        scenario, controller, x0, SCORE_RULES.dt, steps, guard=lambda x: bound_adjoint(x, adjoint_limit)
    )
    return measure_episode(rows, scenario.parameters, SCORE_RULES.dt, SCORE_RULES)


def with_actor(controller: PolicyController, actor: Actor) -> PolicyController:
    """The controller with this network, whether it has one or was left without."""
    return eqx.tree_at(lambda c: c.policy.actor, controller, actor, is_leaf=lambda leaf: leaf is None)


_gradient = jax.jit(jax.value_and_grad(batch_cost, has_aux=True), static_argnames=("settings", "plant"))


def _optimiser(settings: PolicyGradientSettings) -> optax.GradientTransformation:
    rate, number = settings.learning_rate, settings.iterations
    schedule = optax.warmup_cosine_decay_schedule(0.0, rate, number // 8, number, rate / 50)
    return optax.chain(optax.clip_by_global_norm(settings.gradient_limit), optax.adam(schedule, b2=0.98))


def single_precision(tree: Any) -> Any:
    """All numbers of a controller, or of a part of it, as arrays in single precision."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32) if eqx.is_array_like(leaf) else leaf, tree)
