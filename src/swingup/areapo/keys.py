"""Random keys and their purposes. A key is folded with each purpose once, and what comes out is used once.

``fold_in(key, i)`` is also the i-th key of ``split(key, n)``: a key that is folded is never split.
"""

from enum import IntEnum
from typing import NamedTuple

import jax

from ..common.types import Key

COLLECT, IMPROVE, NEXT = range(3)
"""Purposes of the key of an iteration; the last one gives the key of the next iteration."""


class Purpose(IntEnum):
    """The consumers of a seed, each with a root of its own."""

    TRAINING = 0
    EVALUATION = 1
    PREDICTION = 2
    FAULT_SEARCH = 3


class RolloutKeys(NamedTuple):
    """The keys of a compiled rollout; scanned, those of one step."""

    sample: Key
    """One a step: all environments draw their actions together."""
    step: Key
    """One for each environment at each step."""
    reset: Key
    """One for each environment at each step."""


def root_key(seed: int, purpose: Purpose) -> Key:
    """The key from which all randomness of a consumer follows."""
    return jax.random.fold_in(jax.random.key(seed), purpose)


def rollout_keys(key: Key, steps: int, envs: int) -> RolloutKeys:
    """The keys of a compiled rollout, split at once: in the loop over the steps each split costs as much."""
    sample, step, reset = jax.random.split(key, 3)
    each = (steps, envs)
    return RolloutKeys(jax.random.split(sample, steps), jax.random.split(step, each), jax.random.split(reset, each))
