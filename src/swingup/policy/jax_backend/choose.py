"""One of two memories, as compiled loops choose."""

from typing import TypeVar

import jax
import jax.numpy as jnp

from ...types import Flag

TreeT = TypeVar("TreeT")


def choose(condition: Flag, yes: TreeT, no: TreeT) -> TreeT:
    """The one pytree or the other, of the same structure."""
    chosen: TreeT = jax.tree.map(lambda one, other: jnp.where(condition, one, other), yes, no)
    return chosen
