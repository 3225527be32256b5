"""Collecting a rollout from environments that the host steps: one compiled call for each step of all of them."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..areapo import algorithm
from ..areapo.config import Config
from ..areapo.keys import COLLECT
from ..areapo.metrics import Metrics
from ..areapo.networks import ActionSample, AnyActor, sample_actions
from ..areapo.state import LearnerState, Rollout
from ..areapo.statistics import RunningStatistics
from ..common.fetch import fetch
from ..common.types import Key
from .environments import Environments


def host_iteration(state: LearnerState, environments: Environments, config: Config) -> tuple[LearnerState, Metrics]:
    """One iteration, as :func:`swingup.areapo.algorithm.iteration` of a compiled task."""
    state, rollout = collect_on_host(state, environments, config)
    return _update(state, rollout, config)


def compile_iteration(state: LearnerState, config: Config, all_count: bool) -> None:
    """Compile the functions that an iteration calls, from shapes alone; no environment is stepped."""
    observations = np.zeros(state.observations.shape, np.float32)
    noise = np.zeros(_noise.lower(state.actor, state.key, config).compile().out_info.shape[1:], np.float32)
    chosen = _sample.lower(state.actor, observations, noise).compile().out_info
    for true_next in (None, observations):
        _advance.lower(state.actor, state.statistics, observations, true_next, noise).compile()
    flags, rewards = np.zeros(config.num_envs, np.bool_), np.zeros(config.num_envs, np.float32)
    latents = np.zeros(chosen.latents.shape, chosen.latents.dtype)
    row = (observations, latents, rewards, rewards, observations, flags, flags, flags)
    _update.lower(state, _rollout([row] * config.num_steps, all_count), config).compile()


def collect_on_host(
    state: LearnerState, environments: Environments, config: Config
) -> tuple[LearnerState, Rollout]:
    """Act for ``num_steps`` in every environment, as :func:`swingup.areapo.algorithm.collect` does."""
    actor, statistics, seen = state.actor, state.statistics, np.asarray(state.observations)
    noise = fetch(_noise(actor, state.key, config))
    chosen = fetch(_sample(actor, seen, noise[0]))
    rows = []
    for index in range(1, config.num_steps + 1):
        step = environments.step(chosen.actions)
        true_next = None if step.true_next is step.following else step.true_next
        statistics, *answer = _advance(actor, statistics, step.following, true_next, noise[index])
        following, true_next, following_chosen = fetch(answer)
        true_next = following if true_next is None else true_next
        ends = (step.terminated, step.truncated, step.counted)
        rows.append((seen, chosen.latents, chosen.log_probs, step.rewards, true_next, *ends))
        seen, chosen = following, following_chosen
    # The last decision is dropped: the next rollout decides with its own key and the improved actor.
    after = replace(state, statistics=statistics, observations=jnp.asarray(seen))
    return after, _rollout(rows, environments.all_count)


def _rollout(rows: list[tuple[Any, ...]], all_count: bool) -> Rollout:
    """Stack the steps, whose arrays are in the order of a rollout's fields; compiled functions take NumPy's."""
    columns: list[Any] = list(map(np.stack, zip(*rows, strict=True)))
    columns[-1] = None if all_count else columns[-1].astype(np.float32)
    return Rollout(*columns)


@jax.jit
def _noise(actor: AnyActor, key: Key, config: Config) -> Float[Array, "decisions k envs"]:
    """The noise of all decisions of a rollout: drawn at each step, it would take a quarter of the step's call."""
    keys = jax.random.split(jax.random.fold_in(key, COLLECT), config.num_steps + 1)
    return jax.vmap(lambda each: actor.noise(each, (config.num_envs,)))(keys)


@jax.jit
def _advance(
    actor: AnyActor,
    statistics: RunningStatistics,
    following: Float[Array, "envs n"],
    true_next: Float[Array, "envs n"] | None,
    noise: Float[Array, "k envs"],
) -> tuple[RunningStatistics, Float[Array, "envs n"], Float[Array, "envs n"] | None, ActionSample]:
    """Update the statistics with a step's observations and sample the next actions; one call saves overhead.

    True next observations of None, where no episode ended, stay None: they are the following ones.
    """
    statistics = statistics.update(following)
    normalise = statistics.stage()
    seen, seen_next = normalise(following), None if true_next is None else normalise(true_next)
    return statistics, seen, seen_next, sample_actions(actor, seen, noise)


_sample = jax.jit(sample_actions)
_update = jax.jit(algorithm.update)
