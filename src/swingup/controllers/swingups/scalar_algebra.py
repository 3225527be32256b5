"""Small vectors and matrices as tuples of scalars: batched programs then consist of elementwise operations.

XLA's CPU backend computes a batch of 4 x 4 products one by one. Written out in scalars, a batch is one fused loop.
Zeros and ones that are known when tracing (Python floats) cost nothing.
"""

from collections.abc import Sequence
from typing import Any, TypeAlias

from ...plant.equations import Number

Vector: TypeAlias = tuple[Number, ...]
"""Entries."""

Matrix: TypeAlias = tuple[Vector, ...]
"""Rows; of a symmetric matrix only row i's entries from column i on."""


def unpack(array: Any) -> Vector:
    """The entries of an array along its last axis."""
    return tuple(array[..., i] for i in range(array.shape[-1]))


def times(a: Number, b: Number) -> Number:
    """A product in which a literal 0 or 1 is left out."""
    for factor, other in ((a, b), (b, a)):
        # Literals alone: a traced number may be NaN, which 0 must not hide.
        if isinstance(factor, float) and factor in (0.0, 1.0):
            return other if factor == 1.0 else 0.0
    return a * b


def plus(a: Number, b: Number) -> Number:
    """A sum in which a literal 0 is left out."""
    if isinstance(a, float) and a == 0.0:
        return b
    return a if isinstance(b, float) and b == 0.0 else a + b


def dot(a: Sequence[Number], b: Sequence[Number]) -> Number:
    """Σ a_i b_i."""
    total: Number = 0.0
    for left, right in zip(a, b, strict=True):
        total = plus(total, times(left, right))
    return total


def add_scaled(a: Sequence[Number], scale: Number, b: Sequence[Number]) -> Vector:
    """A + scale · b."""
    return tuple(plus(left, times(scale, right)) for left, right in zip(a, b, strict=True))


def entry(s: Matrix, i: int, j: int) -> Number:
    """Entry (i, j) of a symmetric matrix."""
    return s[i][j - i] if i <= j else s[j][i - j]


def symmetric_times(s: Matrix, v: Sequence[Number]) -> Vector:
    """S v of a symmetric matrix."""
    return tuple(dot([entry(s, i, j) for j in range(len(v))], v) for i in range(len(v)))


def diagonal(values: Sequence[Number]) -> Matrix:
    """A diagonal matrix as a symmetric one."""
    return tuple((value, *(0.0,) * (len(values) - 1 - i)) for i, value in enumerate(values))
