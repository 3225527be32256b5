"""The learner's random keys. They are split only here, into names that are each used once."""

from typing import NamedTuple

import jax

from ..types import Key


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


class StepKeys(NamedTuple):
    """The keys of one step of a rollout."""

    sample: Key
    step: Key
    reset: Key


def initial_keys(key: Key) -> InitialKeys:
    """The keys that a seed's key starts with."""
    return InitialKeys(*jax.random.split(key, 4))


def iteration_keys(key: Key) -> IterationKeys:
    """The keys of the iteration that starts with the key of the state."""
    return IterationKeys(*jax.random.split(key, 3))


def step_keys(key: Key) -> StepKeys:
    """The keys of one step of a compiled rollout."""
    return StepKeys(*jax.random.split(key, 3))
