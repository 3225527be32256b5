"""What a page about a log shows: tables and panels of curves, which a page in HTML and a figure both draw."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

LINE, THIN, STEPS, DOTS, BAND, DASHED = "line", "thin", "steps", "dots", "band", "dashed"
"""How a curve is drawn; a step holds until the next row, and a band has a lower and an upper end."""

MEASURED = "log"
"""Colour of what was measured; the others are numbered from 0."""


@dataclass(frozen=True)
class Curve:
    """One curve of a panel. A row of NaN interrupts it."""

    name: str
    x: Float[np.ndarray, "rows"]
    y: Float[np.ndarray, "rows"]
    """Of a band: its lower end."""
    colour: str | int
    look: str = LINE
    upper: Float[np.ndarray, "rows"] | None = None
    """Of a band alone: its upper end."""


@dataclass(frozen=True)
class Panel:
    """Curves over one axis."""

    x: str
    """Label of the axis, with its unit."""
    y: str
    curves: Sequence[Curve]
    ticks: Sequence[str] = ()
    """Names of x = 0, 1, 2, ...; empty for numbers."""
    logarithmic: bool = False
    """Whether the vertical axis is."""


@dataclass(frozen=True)
class Table:
    """Rows of text under headings; the first column names the rows."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Part:
    """A part of a study under one heading."""

    title: str
    note: str
    tables: Sequence[Table] = ()
    panels: Sequence[Panel] = ()
    over_time: bool = False
    """Whether the panels stand below each other over one time axis; otherwise side by side."""


@dataclass(frozen=True)
class Study:
    """A page's content."""

    title: str
    lead: str
    parts: Sequence[Part]
    notes: Sequence[str] = ()
    """What a reader should know, one line each."""


def shown(value: float | None, digits: int = 3) -> str:
    """A number in a table; a dash where there is none."""
    return "–" if value is None or not np.isfinite(value) else f"{value:.{digits}g}"
