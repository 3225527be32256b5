"""The space of a task's observations or actions, in NumPy and, as a pytree, in JAX."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..common.checks import one_of, whole_number
from ..common.errors import SwingupError, quoted

BOX, DISCRETE, MULTI_DISCRETE = KINDS = ("box", "discrete", "multi_discrete")
DTYPES = ("float16", "float32", "float64", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
LARGEST_SIZE = 1_000_000  # Most entries of a space that a file describes


@dataclass(frozen=True, eq=False)
class Space:
    """A box, or one or several choices, as Gymnasium's ``Box``, ``Discrete`` and ``MultiDiscrete``.

    A call makes the environment's actions of a policy's: numbers in [-1, 1] are scaled to the bounds of a box, and
    choices count from the first.
    """

    shape: tuple[int, ...]  # Shape of an observation or an action; () for one choice
    dtype: str
    choices: tuple[int, ...] = ()  # Number of alternatives of each entry; empty for a box
    low: Any = None
    """Bounds of a box in its shape, or None without finite ones; of choices, the number of the first."""
    high: Any = None

    @property
    def size(self) -> int:
        """Number of entries."""
        return math.prod(self.shape)

    @property
    def kind(self) -> str:
        """``box``, ``discrete`` (one choice) or ``multi_discrete``."""
        return BOX if not self.choices else MULTI_DISCRETE if self.shape else DISCRETE

    def __call__(self, actions: Any) -> Any:
        """Actions of the environment for a policy's (..., m), with the same leading axes."""
        shaped = actions.reshape(*actions.shape[:-1], *self.shape)
        if self.choices:
            return (shaped + self.low).astype(self.dtype)
        wide = np.promote_types(self.low.dtype, np.float32)  # A difference of float16 may overflow
        scaled = self.low + 0.5 * (shaped + 1.0) * (self.high.astype(wide) - self.low.astype(wide))
        # Rounding may carry it beyond a bound.
        return scaled.clip(self.low, self.high).astype(self.dtype)

    def describe(self) -> dict[str, Any]:
        """The entries of a policy file, as JSON values."""
        low, high = (None if bound is None else np.asarray(bound).tolist() for bound in (self.low, self.high))
        if not self.choices:
            return {"type": BOX, "shape": list(self.shape), "low": low, "high": high, "dtype": self.dtype}
        count = np.reshape(self.choices, self.shape).tolist()
        return {"type": self.kind, "nvec" if self.shape else "n": count, "start": low, "dtype": self.dtype}

    def batch(self, values: Any) -> tuple[np.ndarray, bool]:
        """One observation, or several along a leading axis, as rows (b, n); true if it was one.

        They are rounded to the space's type first, as in training; a whole number's has to have them already.

        Raises:
            SwingupError: they are not numbers of that type, not finite, or have another shape.
        """
        try:
            given = np.asarray(values)
        except ValueError:  # a ragged list
            given = np.empty(0, object)
        if given.dtype.kind not in "biuf":
            raise SwingupError(f"observation is not an array of numbers: pass one of shape {self.shape}")
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused below
            found = given.astype(self.dtype)
        single = found.shape == self.shape
        if not single and found.shape[1:] != self.shape:
            raise SwingupError(
                f"observation has shape {found.shape}: pass {self.shape}, or one axis more in front for several"
            )
        if not (finite := np.isfinite(given) & np.isfinite(found)).all():
            raise SwingupError(f"observation holds {given[~finite][0]}: pass finite numbers")
        if found.dtype.kind != "f" and (other := found != given).any():
            raise SwingupError(
                f"observation holds {given[other][0]}, which is no {self.dtype}: scale it as in training"
            )
        return found.reshape(1 if single else len(found), self.size), single


def box(shape: tuple[int, ...], low: Any = None, high: Any = None, dtype: str = "float32") -> Space:
    """A box; a bound is one number or an array of the shape, and bounds that are not all finite count as none."""
    if low is None or high is None:
        return Space(shape, dtype)
    with np.errstate(over="ignore"):  # an overflow is an infinity
        low, high = (np.broadcast_to(np.asarray(bound).astype(dtype), shape) for bound in (low, high))
    finite = bool(np.isfinite(low).all() and np.isfinite(high).all())
    return Space(shape, dtype, low=low, high=high) if finite else Space(shape, dtype)


def discrete(choices: Any, start: Any = 0, dtype: str = "int64") -> Space:
    """Choices of a shape, () for one, that count from ``start``."""
    counts = np.asarray(choices)
    first = np.broadcast_to(np.asarray(start), counts.shape)
    return Space(counts.shape, dtype, tuple(map(int, counts.ravel())), first, first)


def read_space(name: str, entry: Any) -> Space:
    """The space that a policy file's entry of this name describes.

    Raises:
        SwingupError: the entry is not one of ``Space.describe``.
    """
    if not isinstance(entry, Mapping):
        raise SwingupError(f"{name} = {quoted(entry)} is not a space: see docs/policy-format.md")
    kind = one_of(f"{name}'s type", entry.get("type"), KINDS)
    dtype = one_of(f"{name}'s dtype", entry.get("dtype", "float32" if kind == BOX else "int64"), DTYPES)
    if kind != BOX:
        counts = _numbers(f"{name}'s counts", entry.get("n" if kind == DISCRETE else "nvec"), "iu")
        start = _numbers(f"{name}'s start", entry.get("start", 0), "iu")
        if start.shape not in ((), counts.shape) or counts.min() < 1 or (counts.ndim == 0) != (kind == DISCRETE):
            raise SwingupError(f"{name} has counts {quoted(counts.tolist())} from {quoted(start.tolist())}")
        if any(np.any(each.astype(dtype) != each) for each in (start, start + counts - 1)):
            raise SwingupError(f"{name} has choices that its dtype {dtype} does not hold")
        return discrete(counts, start, dtype)
    sizes = entry.get("shape")
    if not isinstance(sizes, list):
        raise SwingupError(f"{name}'s shape {quoted(sizes)} is not a list of sizes")
    shape = tuple(whole_number(f"{name}'s shape", each, 1, LARGEST_SIZE) for each in sizes)
    whole_number(f"{name}'s size", math.prod(shape), 1, LARGEST_SIZE)
    if entry.get("low") is None or entry.get("high") is None:
        return box(shape, dtype=dtype)
    low, high = (_numbers(f"{name}'s {bound}", entry[bound], "iuf") for bound in ("low", "high"))
    if not low.shape == high.shape == shape:
        raise SwingupError(f"{name} has bounds of shapes {low.shape} and {high.shape}, not {shape}")
    if np.any(low > high):
        raise SwingupError(f"{name} has a low bound above its high one")
    return box(shape, low, high, dtype)


def _numbers(what: str, value: Any, kinds: str) -> np.ndarray:
    try:
        found = np.asarray(value)
    except ValueError:  # a ragged list
        found = np.empty(0)
    if found.dtype.kind not in kinds or not 0 < found.size <= LARGEST_SIZE or not np.isfinite(found).all():
        raise SwingupError(f"{what} {quoted(value)} must be {'whole' if kinds == 'iu' else 'finite'} numbers")
    return found
