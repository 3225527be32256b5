"""Random orders of a rollout's frames."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from ..common.types import Key

WORD = 32
"""Bits of a number that is sorted."""
LEAST_RANDOM = 12
"""Random bits of such a number that shuffle well enough."""


def shuffled(key: Key, epochs: int, size: int) -> Int[Array, "epochs size"]:
    """The numbers from 0 to size - 1, in a random order for each epoch.

    Random bits are sorted that have a frame's number in their last bits: XLA's CPU backend sorts one array of
    integers seven times faster than numbers by other numbers, as ``argsort`` does. Where random bits tie, frames
    keep their order; this matters only where a minibatch ends, and ties are few.
    """
    bits = jax.random.bits(key, (epochs, size))
    last = (size - 1).bit_length()
    if WORD - last < LEAST_RANDOM:
        return jnp.argsort(bits, axis=-1)
    mask = jnp.uint32(2**last - 1)
    tagged = (bits & ~mask) | jnp.arange(size, dtype=jnp.uint32)
    return (jnp.sort(tagged, axis=-1) & mask).astype(jnp.int32)
