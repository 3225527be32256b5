"""Random keys and their purposes. A key is folded with each purpose once, and what comes out is used once.

``fold_in(key, i)`` is also the i-th key of ``split(key, n)``: a key that is folded is never split.
"""

from enum import IntEnum

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


def root_key(seed: int, purpose: Purpose) -> Key:
    """The key from which all randomness of a consumer follows."""
    return jax.random.fold_in(jax.random.key(seed), purpose)
