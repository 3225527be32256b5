"""How figures look: their style, colours, names and legends, with matplotlib, which is imported only when used.

Figures are objects of their own: pyplot is never used, and global settings change no longer than a call lasts.
"""

import io
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

import numpy as np

from ..drawing import BASE, DRIVEN, GREEN, GUIDE, LINK_1
from ..errors import SwingupError

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

FIGURE_FORMATS = (".png", ".svg", ".pdf")

COLOURS = (LINK_1, DRIVEN, "#5aa9dd", "#f2b632", "#a3a09a")
"""Colour-blind readers can tell them apart, too; after the last, lines and bars change their pattern."""
DASHES = ("-", "--", ":")
HATCHES = ("", "////", "....")
LONGEST_NAME = 40

STYLE = {
    "figure.dpi": 200,
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.edgecolor": BASE,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": GUIDE,
    "grid.linewidth": 0.4,
    "xtick.color": BASE,
    "ytick.color": BASE,
    "xtick.labelcolor": "black",
    "ytick.labelcolor": "black",
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "hatch.linewidth": 0.6,
    "hatch.color": "white",
    "svg.hashsalt": "swingup",
    "pdf.fonttype": 42,
}
"""On top of matplotlib's own defaults, whatever a user's matplotlibrc says."""


def styled() -> AbstractContextManager[None]:
    """A context in which figures take this look.

    Raises:
        SwingupError: matplotlib is not installed.
    """
    try:
        from matplotlib import style
    except ImportError as error:
        raise SwingupError("figures need matplotlib, which is missing: pip install swingup[plot]") from error
    return style.context(["default", STYLE])


def new_figure(width: float, height: float) -> "Figure":
    """An empty figure of some size (inches) that lays itself out."""
    from matplotlib.figure import Figure

    return Figure((width, height), layout="constrained")


def render(figure: "Figure", suffix: str) -> bytes:
    """A figure as the bytes of a file, the same for the same figure.

    Args:
        figure: what to render.
        suffix: one of :data:`FIGURE_FORMATS`.
    """
    metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(suffix)
    file = io.BytesIO()
    with styled():
        figure.savefig(file, format=suffix[1:], metadata=metadata)
    return file.getvalue()


def plain(name: str) -> str:
    """A name that matplotlib shows unchanged: dollars start no formula, an underscore hides no entry."""
    short = name if len(name) <= LONGEST_NAME else name[: LONGEST_NAME - 1] + "…"
    return (" " if short.startswith("_") else "") + short.replace("$", r"\$")


def line_look(k: int) -> dict[str, Any]:
    """Colour and dashes of the k-th line."""
    return {"color": COLOURS[k % len(COLOURS)], "linestyle": DASHES[k // len(COLOURS) % len(DASHES)]}


def bar_look(k: int) -> dict[str, Any]:
    """Colour and hatching of the k-th bars."""
    return {"color": COLOURS[k % len(COLOURS)], "hatch": HATCHES[k // len(COLOURS) % len(HATCHES)]}


RING: dict[str, Any] = {
    "marker": "o", "markersize": 8.0, "markerfacecolor": "none", "markeredgecolor": "black", "markeredgewidth": 0.9,
    "linestyle": "none", "zorder": 3, "label": "_start",
}  # fmt: skip
STAR: dict[str, Any] = {
    "marker": "*", "markersize": 6.5, "markerfacecolor": GREEN, "markeredgecolor": "white", "markeredgewidth": 0.5,
    "linestyle": "none", "zorder": 3, "label": "_goal",
}  # fmt: skip
"""The star fits into the ring, for where start and goal coincide."""


def tick_angles(axis: "Axis") -> None:
    """Ticks at multiples of π/2, π or more, few enough to read."""
    from matplotlib.ticker import FuncFormatter, MultipleLocator

    low, high = axis.get_view_interval()
    turns = (high - low) / np.pi
    step = 0.5 if turns < 2 else max(1, int(np.ceil(turns / 6)))

    def name(angle: float, _: object) -> str:
        halves = round(2 * angle / np.pi)
        count, half = (halves, "/2") if halves % 2 else (halves // 2, "")
        return f"{'−' * (count < 0)}{abs(count) if abs(count) != 1 else ''}π{half}" if count else "0"

    axis.set_major_locator(MultipleLocator(step * np.pi))
    axis.set_major_formatter(FuncFormatter(name))


def legend_below(figure: "Figure", entries: Sequence[tuple["Artist", str]]) -> None:
    """A legend in as few rows as fit, from rough widths of its entries (inches)."""
    widths = [0.065 * len(text) + 0.5 for _, text in entries]
    columns = len(entries) if sum(widths) < figure.get_figwidth() else int(figure.get_figwidth() / max(widths))
    artists, texts = zip(*entries, strict=True)
    figure.legend(artists, texts, loc="outside lower center", ncols=max(1, columns))
