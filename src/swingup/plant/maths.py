"""What equations that are written once need of a kind of number: arrays of NumPy or JAX, and single numbers.

NumPy's single numbers are Python's floats, which are faster than arrays for a dozen of them. JAX's are arrays
without axes. The equations use operators on both; of a branch both sides must be computable.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from .equations import Number, Pair

TURN = 2 * math.pi


class Maths(NamedTuple):
    """The functions of a kind of number."""

    xp: Any
    """For arrays: the module ``numpy`` or ``jax.numpy``."""
    sine_cosine: Callable[[Number], Pair]
    arctan: Callable[[Number], Number]
    log1p: Callable[[Number], Number]
    expm1: Callable[[Number], Number]
    root: Callable[[Number], Number]
    minimum: Callable[[Number, Number], Number]
    """The smaller of two numbers."""
    maximum: Callable[[Number, Number], Number]
    finite: Callable[[Any], Any]
    """Whether all numbers of an array are finite."""
    where: Callable[[Any, Number, Number], Number]
    place: Callable[[Number], Any]
    """The nearest whole number, as a place in an array."""
    number: Callable[[Any], Number]
    """The number of an array without axes."""
    numbers: Callable[[Any], tuple[Number, ...]]
    """The numbers of a vector."""
    vector: Callable[[Any], Any]
    """The vector of some numbers."""
    window: Callable[[Any, Any, int], Any]
    """Rows of an array from a place that is found at run time: so many."""
    choose: Callable[[Any, Callable[[], Any], Any], Any]
    """What a function returns where a condition holds, else the last argument: arrays, numbers, or tuples of them.

    NumPy calls the function only where it must, JAX always.
    """

    def clip(self, value: Number, least: Number, most: Number) -> Number:
        """A number within bounds; NaN stays."""
        return self.minimum(self.maximum(value, least), most)

    def nearest(self, angles: Any) -> Any:
        """Differences of angles (rad), less full turns; small ones keep all digits."""
        # Less than half a turn rounds to no turn: nothing is subtracted, where a modulus would add and take π.
        return angles - TURN * self.xp.rint(angles / TURN)


def sine_cosine(angle: float) -> tuple[float, float]:
    """(sin, cos) of an angle (rad); NaN where it is not finite, for which math.sin raises an error."""
    return (math.sin(angle), math.cos(angle)) if math.isfinite(angle) else (math.nan, math.nan)


def finite(values: np.ndarray) -> bool:
    """Whether all numbers of an array are finite."""
    if values.ndim == 1:
        return all(map(math.isfinite, values.tolist()))
    # 0 times what is not finite is NaN; of a matrix a product is faster than a test of each number.
    return bool(np.vdot(values, 0.0 * values) == 0.0)


NUMPY = Maths(
    xp=np,
    sine_cosine=sine_cosine,
    arctan=math.atan,
    log1p=math.log1p,
    expm1=math.expm1,
    root=math.sqrt,
    minimum=min,
    maximum=max,
    finite=finite,
    where=lambda condition, yes, no: yes if condition else no,
    place=round,
    # Python's floats: a product of NumPy's scalars takes three times as long.
    number=float,
    numbers=lambda values: tuple(values.tolist()),
    vector=np.array,
    window=lambda rows, start, size: rows[start : start + size],
    choose=lambda condition, yes, no: yes() if condition else no,
)
"""NumPy's functions, for arrays in double precision and Python's floats."""

ARRAYS = NUMPY._replace(
    sine_cosine=lambda angle: (np.sin(angle), np.cos(angle)), arctan=np.arctan, log1p=np.log1p, where=np.where
)
"""The same for equations whose single numbers are arrays: many at once."""
