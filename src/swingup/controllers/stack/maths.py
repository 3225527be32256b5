"""What equations that are written once need of JAX."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp

from ...common.types import Flag
from ...dynamics.trigonometry import arctan, sine_cosine
from ...plant.equations import ArrayOps
from ..swingups.scalar_algebra import unpack

TreeT = TypeVar("TreeT")


def choose(condition: Flag, yes: Callable[[], TreeT], no: TreeT) -> TreeT:
    """What a function returns, or another pytree of the same structure, as compiled loops choose."""
    chosen: TreeT = jax.tree.map(lambda one, other: jnp.where(condition, one, other), yes(), no)
    return chosen


JAX = ArrayOps(
    xp=jnp,
    sine_cosine=sine_cosine,
    arctan=arctan,
    log1p=jnp.log1p,
    expm1=jnp.expm1,
    root=jnp.sqrt,
    minimum=jnp.minimum,
    maximum=jnp.maximum,
    finite=lambda values: jnp.isfinite(values).all(),
    where=jnp.where,
    place=lambda number: jnp.rint(number).astype(int),
    number=lambda value: value,
    numbers=unpack,
    vector=jnp.stack,
    window=lambda rows, start, size: jax.lax.dynamic_slice_in_dim(rows, start, size),
    choose=choose,
)
"""JAX's functions, in the precision of what they are given."""
