"""The learner's random keys. They are split only here, into names that are each used once."""

from typing import NamedTuple

import jax

from ..common.types import Key


class InitialKeys(NamedTuple):
    """The keys that initialise a learner."""

    actor: Key
    critic: Key
    reset: Key
    """For the first states of the environments."""
    state: Key
    """Kept in the state; every iteration's keys follow from it."""


class IterationKeys(NamedTuple):
    """The keys of one iteration."""

    collect: Key
    improve: Key
    following: Key
    """Kept in the state for the next iteration."""


class RolloutKeys(NamedTuple):
    """The keys of a compiled rollout; scanned, those of one step."""

    sample: Key
    """One a step: all environments draw their actions together."""
    step: Key
    """One for each environment at each step."""
    reset: Key
    """One for each environment at each step."""


def initial_keys(key: Key) -> InitialKeys:
    """The keys that a seed's key starts with."""
    return InitialKeys(*jax.random.split(key, 4))


def iteration_keys(key: Key) -> IterationKeys:
    """The keys of the iteration that starts with the key of the state."""
    return IterationKeys(*jax.random.split(key, 3))


def rollout_keys(key: Key, steps: int, envs: int) -> RolloutKeys:
    """The keys of a compiled rollout, split at once: in the loop over the steps each split costs as much."""
    sample, step, reset = jax.random.split(key, 3)
    each = (steps, envs)
    return RolloutKeys(jax.random.split(sample, steps), jax.random.split(step, each), jax.random.split(reset, each))
