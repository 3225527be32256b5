"""The time of a call in JAX, such that single precision keeps it: whole seconds, and the rest.

A float32 resolves 2 ms only up to some hours, and no period at all of a clock that counts from 1970. A difference
of two split times is right to 1e-7 s for 68 years. In double precision, as the judge runs, a plain number will do.
"""

import math
from typing import Any, NamedTuple, TypeAlias

import jax.numpy as jnp
import numpy as np

from ...common.types import Count, Flag, Scalar


class Time(NamedTuple):
    """A time (s): ``seconds`` + ``rest``."""

    seconds: Count | np.ndarray
    rest: Scalar | np.ndarray

    def __sub__(self, before: "Time") -> Scalar:
        """The time (s) since ``before``."""
        return jnp.asarray((self.seconds - before.seconds) + (self.rest - before.rest))

    def like(self, other: "Time") -> "Time":
        """In another's types: a compiled loop keeps the types of its carry."""
        return Time(*(jnp.asarray(mine, jnp.result_type(its)) for mine, its in zip(self, other, strict=True)))


TimeLike: TypeAlias = Any
"""A number (s) or a :class:`Time`; not named as such, since most controllers need to know numbers alone."""


def split_time(t: float) -> Time:
    """A time (s) for calls of a controller in JAX outside 64-bit mode."""
    whole = math.floor(t) if math.isfinite(t) else 0
    # Arrays, since a compiled call would be compiled anew for each Python float.
    return Time(np.asarray(whole, np.int32), np.asarray(t - whole))


def as_time(t: TimeLike) -> Time:
    """A time that is perhaps split already."""
    return t if isinstance(t, Time) else Time(np.zeros((), np.int32), jnp.asarray(t))


def never() -> Time:
    """Before all times: what a controller remembers before its first call."""
    return Time(jnp.zeros((), jnp.int32), jnp.array(-jnp.inf))


def since_first_call(t: TimeLike, first: Time) -> tuple[Time, Scalar]:
    """The time of the first call, perhaps this one, at which trajectories begin, and the time since then (s)."""
    now = as_time(t).like(first)
    # As a value, since a compiled loop has no first call of its own.
    none: Flag = jnp.isneginf(first.rest)
    begun = Time(*(jnp.where(none, mine, its) for mine, its in zip(now, first, strict=True)))
    return begun, now - begun
