"""Gradient steps on whole episodes: backwards through policy, disturbances and pendulum, then Adam."""

import itertools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

from ..areapo.networks import Actor
from ..benchmark.rollout import simulate
from ..benchmark.rules import PERFORMANCE_RULES
from ..benchmark.runner import cores
from ..policy.jax_backend.controller import PolicyController
from ..types import Scalar
from .episodes import DEPTH, Episodes
from .objective import SCORE, SCORE_AND_TIME, Measures, Weights, bound_adjoint, measure

RULES = PERFORMANCE_RULES["v2"]


@dataclass(frozen=True)
class PolicyGradientSettings:
    """How to descend."""

    iterations: int = 100
    """Gradient steps."""
    learning_rate: float = 1e-4
    """Adam's largest step size: it rises over the first eighth of the steps and falls to a fiftieth on a cosine."""
    duration: float = 3.0
    """Length of an episode (s)."""
    adjoint_limit: float = 1.3
    """Largest norm of an episode's gradient with respect to a state on its way (1/rad, s/rad)."""
    gradient_limit: float = 0.5
    """Norm to which the policy's gradient is cut."""
    nominal: Weights = SCORE
    """What counts in nominal episodes."""
    others: Weights = SCORE_AND_TIME
    """What counts in all others."""

    @property
    def steps(self) -> int:
        """Steps of an episode."""
        return round(self.duration / RULES.dt)


class Iterate(NamedTuple):
    """Where a descent stands."""

    actor: Actor
    optimiser: optax.OptState


class AnalyticPolicyGradient:
    """Descends for one controller: a part of each batch on every core, one batch on an accelerator."""

    def __init__(self, controller: PolicyController, settings: PolicyGradientSettings) -> None:
        """Prepare; nothing is compiled before the first step."""
        self._controller = eqx.tree_at(lambda c: c.policy.actor, single_precision(controller), None)
        self._settings = settings
        self._optimiser = _optimiser(settings)
        self._apply = jax.jit(self._updated)
        self._parts = cores() if jax.default_backend() == "cpu" else 1
        actor = single_precision(controller.policy.actor)
        self.iterate = Iterate(actor, self._optimiser.init(actor))

    def step(self, episodes: Episodes) -> Measures:
        """Take one step, and return the episodes' measures (leading axis: episode)."""
        cuts = np.linspace(0, len(episodes.x0), self._parts + 1).astype(int)
        pieces = [slice(*ends) for ends in itertools.pairwise(cuts)]

        def run(piece: slice) -> tuple[tuple[Scalar, Measures], Actor]:
            part = jax.tree.map(lambda leaf: leaf[piece], episodes)
            return jax.block_until_ready(_gradient(self.iterate.actor, self._controller, part, self._settings))

        with ThreadPoolExecutor(self._parts) as pool:
            results = list(pool.map(run, pieces))
        shares = np.diff(cuts) / cuts[-1]
        self.iterate = self._apply(self.iterate, [gradient for _, gradient in results], shares)
        return jax.tree.map(lambda *leaves: np.concatenate(leaves), *[measures for (_, measures), _ in results])

    def _updated(self, iterate: Iterate, gradients: list[Actor], shares: np.ndarray) -> Iterate:
        mean = jax.tree.map(lambda *parts: sum(a * b for a, b in zip(shares, parts, strict=True)), *gradients)
        updates, state = self._optimiser.update(mean, iterate.optimiser)
        return Iterate(optax.apply_updates(iterate.actor, updates), state)


def batch_cost(
    actor: Actor, controller: PolicyController, episodes: Episodes, settings: PolicyGradientSettings
) -> tuple[Scalar, Measures]:
    """Mean cost of a batch of episodes under a policy with this actor, and their measures."""
    controller = eqx.tree_at(lambda c: c.policy.actor, controller, actor, is_leaf=lambda leaf: leaf is None)
    limit = settings.adjoint_limit / len(episodes.x0)  # of each one's share in the mean

    def one(episode: Episodes) -> tuple[Scalar, Measures]:
        _, rows = simulate(
            episode.scenario, controller, jnp.asarray(episode.x0), RULES.dt, settings.steps, DEPTH,
            guard=lambda x: bound_adjoint(x, limit),
        )  # fmt: skip
        measures = measure(rows, episode.scenario.parameters, RULES.dt, RULES)
        cost = jnp.where(episode.nominal, settings.nominal.cost(measures), settings.others.cost(measures))
        return cost, measures

    costs, measures = jax.vmap(one)(episodes)
    return jnp.mean(costs), measures


_gradient = jax.jit(jax.value_and_grad(batch_cost, has_aux=True), static_argnames="settings")


def _optimiser(settings: PolicyGradientSettings) -> optax.GradientTransformation:
    rate, number = settings.learning_rate, settings.iterations
    schedule = optax.warmup_cosine_decay_schedule(0.0, rate, number // 8, number, rate / 50)
    return optax.chain(optax.clip_by_global_norm(settings.gradient_limit), optax.adam(schedule, b2=0.98))


def single_precision(tree: Any) -> Any:
    """All numbers of a controller, or of a part of it, as arrays in single precision."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32) if eqx.is_array_like(leaf) else leaf, tree)
