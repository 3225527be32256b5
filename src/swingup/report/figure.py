"""A figure as data, once: panels with axes, curves and marks.

``assets/figure.js`` draws it in a page, ``draw.py`` in a file; neither knows what the figure shows.
"""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ..common.errors import one_line

LINE, THIN, DASHED, DOTS, BARS, PALE_BARS, RING, STAR = (
    "line", "thin", "dashed", "dots", "bars", "pale bars", "ring", "star",
)  # fmt: skip
"""How a curve is drawn."""


@dataclass(frozen=True)
class Curve:
    """Points over a panel's axes, joined or not; a row of NaN interrupts a line."""

    name: str  # In the legend, which has each name once; empty for no entry
    x: Float[np.ndarray, "rows"]
    y: Float[np.ndarray, "rows"]
    colour: str | int = "ink"  # A colour of the theme, or the number of a series
    look: str = LINE
    steps: bool = False  # Whether a line holds its value until the next row
    interval: Float[np.ndarray, "rows 2"] | None = None
    """Lower and upper ends: a band around a line, error bars on bars."""
    width: float = 0.0  # Width of a bar in units of x
    time: Float[np.ndarray, "rows"] | None = None
    """When each row was (s), where x is something else: a page marks the player's time on the curve."""


@dataclass(frozen=True)
class Mark:
    """A straight dashed line across a panel: level, or upright."""

    name: str
    at: float
    colour: str = "goal"
    upright: bool = False


@dataclass(frozen=True)
class Panel:
    """Curves over two axes, whose labels have units."""

    x: str
    y: str
    curves: Sequence[Curve]
    marks: Sequence[Mark] = ()
    title: str = ""
    x_range: tuple[float, float] | None = None  # None for all that the curves need
    y_range: tuple[float, float] | None = None
    ticks: Sequence[str] = ()  # Names of x = 0, 1, 2, ...; empty for numbers
    angles: str = ""  # Axes with angles, which have ticks at multiples of π: x, y or neither
    logarithmic: bool = False  # Whether the vertical axis is


@dataclass(frozen=True)
class Figure:
    """Panels, row by row."""

    panels: Sequence[Panel]
    columns: int = 1
    shared: bool = False
    """Whether the panels of a column have one horizontal axis."""


def encode(thing: Any, arrays: dict[str, int]) -> Any:
    """A description as JSON values: objects of what its parts say, foreign names in one printable line each.

    An array becomes its place in ``arrays``, where several curves that have it share one: base64 of little-endian
    numbers in single precision, which are finer than a screen.
    """
    if is_dataclass(thing):
        thing = {field.name: getattr(thing, field.name) for field in fields(thing)}
    if isinstance(thing, Mapping):
        return {name: encode(value, arrays) for name, value in thing.items() if value is not None}
    if isinstance(thing, np.ndarray):
        with np.errstate(over="ignore"):  # what is too large becomes infinite, and is not drawn
            numbers = np.ascontiguousarray(thing, "<f4")
        return arrays.setdefault(base64.b64encode(numbers.tobytes()).decode("ascii"), len(arrays))
    if isinstance(thing, str):
        return one_line(thing)
    return [encode(each, arrays) for each in thing] if isinstance(thing, Sequence) else thing
