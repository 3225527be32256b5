"""Collecting a rollout from environments that the host steps: one compiled call for each step of all of them."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..areapo import train
from ..areapo.act import Decisions, decide, forget, update_statistics
from ..areapo.config import Config
from ..areapo.keys import iteration_keys
from ..areapo.networks import AbstractActor
from ..areapo.normalise import RunningStatistics
from ..areapo.state import LearnerState, Metrics, Rollout
from ..common.fetch import fetch
from ..common.types import Key
from .environments import Environments, HostStep


@dataclass
class EpisodeTally:
    """Returns of the finished episodes, and of those in progress."""

    running: np.ndarray
    """Sum of the rewards so far in each environment."""
    lengths: np.ndarray
    """Steps so far in each environment."""
    returns: list[float] = field(default_factory=list)
    finished: list[int] = field(default_factory=list)
    """Lengths of the episodes that ended."""

    def add(self, step: HostStep) -> None:
        """Count a step of all environments."""
        self.running += step.rewards
        self.lengths += step.counted
        for index in np.flatnonzero(step.ended):
            self.returns.append(float(self.running[index]))
            self.finished.append(int(self.lengths[index]))
            self.running[index], self.lengths[index] = 0.0, 0


def new_tally(num_envs: int) -> EpisodeTally:
    """A tally before the first step."""
    return EpisodeTally(np.zeros(num_envs), np.zeros(num_envs, np.int64))


def host_iteration(
    state: LearnerState, environments: Environments, tally: EpisodeTally, config: Config
) -> tuple[LearnerState, Metrics]:
    """One iteration, as :func:`swingup.areapo.train.iteration` of a compiled task."""
    keys = _keys(state.key)
    state, rollout = collect_on_host(state, environments, tally, keys.collect, config)
    return _update(state, rollout, keys, config)


def compile_iteration(state: LearnerState, config: Config, all_count: bool) -> None:
    """Compile the functions that an iteration calls, from shapes alone; no environment is stepped."""
    keys = _keys(state.key)
    observations = np.zeros(state.observations.shape, np.float32)
    memory: Any = None if state.memory is None else np.zeros(state.memory.shape, np.float32)
    noise = np.zeros(_noise.lower(state.actor, keys.collect, config).compile().out_info.shape[1:], np.float32)
    chosen = _decide.lower(state.actor, observations, noise, memory).compile().out_info
    clip = np.float32(config.observation_clip)
    flags = np.zeros(config.num_envs, np.bool_)
    for true_next in (None, observations):
        given = observations, true_next, noise, clip, memory, flags
        _advance.lower(state.actor, state.statistics, *given).compile()
    rewards = np.zeros(config.num_envs, np.float32)
    step = HostStep(observations, observations, rewards, flags, flags, flags)
    latents = np.zeros(chosen.latents.shape, chosen.latents.dtype)
    row = (observations, latents, rewards, observations, step)
    rollout = replace(_rollout([row] * config.num_steps, all_count), memory=memory)
    _update.lower(state, rollout, keys, config).compile()


def collect_on_host(
    state: LearnerState, environments: Environments, tally: EpisodeTally, key: Key, config: Config
) -> tuple[LearnerState, Rollout]:
    """Act for ``num_steps`` in every environment, as :func:`swingup.areapo.train.collect` does."""
    actor, statistics, seen = state.actor, state.statistics, np.asarray(state.observations)
    start: Any = None if state.memory is None else np.asarray(state.memory)
    memory = start
    noise = fetch(_noise(actor, key, config))
    chosen = fetch(_decide(actor, seen, noise[0], memory))
    # NumPy's types, as in compile_iteration: Python's numbers have other types for JAX and compile again.
    clip = np.float32(config.observation_clip)
    rows = []
    for index in range(1, config.num_steps + 1):
        step = environments.step(chosen.actions)
        tally.add(step)
        true_next = None if step.true_next is step.following else step.true_next
        forgets = step.ended | ~step.counted
        statistics, *answer = _advance(
            actor, statistics, step.following, true_next, noise[index], clip, chosen.memory, forgets
        )
        following, true_next, memory, following_chosen = fetch(answer)
        true_next = following if true_next is None else true_next
        rows.append((seen, chosen.latents, chosen.log_probs, true_next, step))
        seen, chosen = following, following_chosen
    # The last decision is dropped: the next rollout decides with its own key and the improved actor.
    after = replace(
        state,
        statistics=statistics,
        observations=jnp.asarray(seen),
        memory=None if memory is None else jnp.asarray(memory),
    )
    return after, replace(_rollout(rows, environments.all_count), memory=start)


def _rollout(rows: list[tuple[Any, ...]], all_count: bool) -> Rollout:
    """Stack the steps: (observations, latents, log_probs, next_observations, step) each."""
    seen, latents, log_probs, true_next, steps = zip(*rows, strict=True)
    return Rollout(
        observations=_stack(seen),
        latents=_stack(latents),
        log_probs=_stack(log_probs),
        rewards=_stack(step.rewards for step in steps),
        next_observations=_stack(true_next),
        terminated=_stack(step.terminated for step in steps),
        truncated=_stack(step.truncated for step in steps),
        counted=None if all_count else _stack(step.counted.astype(np.float32) for step in steps),
    )


def _stack(arrays: Iterable[np.ndarray]) -> Any:
    """One NumPy array, which compiled functions accept."""
    return np.stack(list(arrays))


@jax.jit
def _noise(actor: AbstractActor, key: Key, config: Config) -> Float[Array, "decisions k envs"]:
    """The noise of all decisions of a rollout: drawn at each step, it would take a quarter of the step's call."""
    each = jax.vmap(lambda index: actor.noise(jax.random.fold_in(key, index), (config.num_envs,)))
    return each(jnp.arange(config.num_steps + 1, dtype=jnp.uint32))


@jax.jit
def _decide(
    actor: AbstractActor,
    seen: Float[Array, "envs n"],
    noise: Float[Array, "k envs"],
    memory: Float[Array, "envs w"] | None,
) -> Decisions:
    return decide(actor, seen, noise, memory)


@jax.jit
def _advance(
    actor: AbstractActor,
    statistics: RunningStatistics,
    following: Float[Array, "envs n"],
    true_next: Float[Array, "envs n"] | None,
    noise: Float[Array, "k envs"],
    clip: float,
    memory: Float[Array, "envs w"] | None,
    forgets: Bool[Array, "envs"],
) -> tuple[
    RunningStatistics,
    Float[Array, "envs n"],
    Float[Array, "envs n"] | None,
    Float[Array, "envs w"] | None,
    Decisions,
]:
    """Update the statistics with a step's observations and sample the next actions; one call saves overhead.

    True next observations of None, where no episode ended, stay None: they are the following ones. A recurrent
    policy's memory is 0 where an episode starts. Without one, ``forgets`` has no effect.
    """
    statistics, normalise = update_statistics(statistics, following, clip)
    seen, seen_next = normalise(following), None if true_next is None else normalise(true_next)
    kept = forget(memory, forgets)
    return statistics, seen, seen_next, kept, decide(actor, seen, noise, kept)


_keys = jax.jit(iteration_keys)
_update = jax.jit(train.update)
