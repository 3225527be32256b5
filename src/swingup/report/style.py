"""The style of figures: colours, lines, names and legends. Matplotlib is imported only when a figure is drawn.

Nothing here uses pyplot, and global settings change only during a call.
"""

import io
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

import numpy as np

from ..common.errors import SwingupError
from ..common.text import one_line
from ..drawing import BASE, DRIVEN, GREEN, GUIDE, LINK_1

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

FIGURE_FORMATS = (".png", ".svg", ".pdf")

COLOURS = (LINK_1, DRIVEN, "#5aa9dd", "#f2b632", "#a3a09a")
"""Colours that colour-blind readers can tell apart. After the last, lines and bars change their pattern."""
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
"""Changes to matplotlib's defaults. A user's matplotlibrc has no effect."""


def styled() -> AbstractContextManager[None]:
    """A context in which figures have this style.

    Raises:
        SwingupError: matplotlib is not installed.
    """
    try:
        from matplotlib import style
    except ImportError as error:
        raise SwingupError("figures need matplotlib, which is missing: pip install swingup[plot]") from error
    return style.context(["default", STYLE])


def new_figure(width: float, height: float) -> "Figure":
    """An empty figure of a given size (inches), with matplotlib's constrained layout."""
    from matplotlib.figure import Figure

    return Figure((width, height), layout="constrained")


def render(figure: "Figure", suffix: str) -> bytes:
    """Render a figure as the bytes of a file; equal figures give equal bytes.

    Args:
        figure: the figure.
        suffix: one of :data:`FIGURE_FORMATS`.
    """
    metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(suffix)
    file = io.BytesIO()
    with styled():
        figure.savefig(file, format=suffix[1:], metadata=metadata)
    return file.getvalue()


def plain(name: str) -> str:
    """A name as matplotlib text: one printable line, in which dollars start no formula.

    A leading underscore would hide the entry from legends, so a space goes before it.
    """
    line = one_line(name)
    short = line if len(line) <= LONGEST_NAME else line[: LONGEST_NAME - 1] + "…"
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
"""The star fits into the ring: start and goal may coincide."""


def tick_angles(axis: "Axis") -> None:
    """Ticks at multiples of π/2, of π, or of several π: about six."""
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
    """A legend below the panels, in as few rows as fit by the estimated widths of its entries (inches)."""
    widths = [0.065 * len(text) + 0.5 for _, text in entries]
    columns = len(entries) if sum(widths) < figure.get_figwidth() else int(figure.get_figwidth() / max(widths))
    artists, texts = zip(*entries, strict=True)
    figure.legend(artists, texts, loc="outside lower center", ncols=max(1, columns))
