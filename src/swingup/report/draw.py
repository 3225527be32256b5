"""Figures as files: one function draws any description with matplotlib, which is imported only then.

Nothing here uses pyplot, and global settings change only during a call.
"""

import io
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from ..common.errors import SwingupError, needing, one_line
from ..drawing import BASE, DRIVEN, GREEN, GUIDE, LINK_1, LINK_2
from .figure import BARS, DASHED, DOTS, LINE, PALE_BARS, RING, STAR, THIN, Curve, Figure, Panel

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure as Drawing
    from matplotlib.figure import SubFigure

FIGURE_FORMATS = (".png", ".svg", ".pdf")

THEME = {"ink": "black", "base": BASE, "goal": GREEN, "driven": DRIVEN, "link-1": LINK_1, "link-2": LINK_2}
"""The page has its own in ``style.css``, light and dark."""
SERIES = (DRIVEN, "#5aa9dd", LINK_1, "#f2b632", "#a3a09a")
"""Colours that colour-blind readers can tell apart. After the last, lines and bars change their pattern."""
DASHES = ("-", "--", ":")
HATCHES = ("", "////", "....")
MAX_NAME_LENGTH = 80  # With what is said behind it
NUMBERED_BAR_WIDTH = 0.15  # Bars of this width have room for their number

LOOKS: dict[str, dict[str, Any]] = {
    LINE: {},
    THIN: {"linewidth": 0.8, "alpha": 0.7},
    DASHED: {"linewidth": 0.9, "linestyle": "--"},
    DOTS: {"linestyle": "none", "marker": ".", "markersize": 3, "alpha": 0.6},
    RING: {"marker": "o", "markersize": 8.0, "markerfacecolor": "none", "markeredgewidth": 0.9},
    # The star fits into the ring: start and goal may coincide.
    STAR: {"marker": "*", "markersize": 6.5, "markeredgecolor": "white", "markeredgewidth": 0.5},
}


def draw(figures: Figure | Mapping[str, Figure], title: str = "") -> "Drawing":
    """Draw a figure, or several below each other."""
    given = {"": figures} if isinstance(figures, Figure) else figures
    if not any(panel.curves for figure in given.values() for panel in figure.panels):
        raise SwingupError("nothing to draw: no panel has data")
    # Room for each figure's rows, their titles and the axes (inches).
    rows = [(-(-len(figure.panels) // figure.columns), figure.shared) for figure in given.values()]
    heights = [0.5 + (1.2 if n > 3 else 1.7) * n if shared else 0.3 + 2.6 * n for n, shared in rows]
    columns = max(figure.columns for figure in given.values())
    with styled():
        drawing = new_figure(max(5.6, 1.2 + 2.9 * columns), sum(heights) + 0.4)
        if title:
            drawing.suptitle(plain(title), fontsize=11)
        entries: dict[str, Artist] = {}
        places = drawing.subfigures(len(given), 1, height_ratios=heights, squeeze=False)[:, 0]
        for place, (heading, figure) in zip(places, given.items(), strict=True):
            _draw_figure(place, figure, heading, entries)
        if entries:
            legend_below(drawing, [(artist, plain(name)) for name, artist in entries.items()])
    return drawing


def _draw_figure(place: "SubFigure", figure: Figure, heading: str, entries: dict[str, "Artist"]) -> None:
    count, columns = len(figure.panels), figure.columns
    share: dict[str, Any] = {"sharex": "col", "sharey": "row"} if figure.shared else {}
    grid = place.subplots(-(-count // columns), columns, squeeze=False, **share)
    axes = list(grid.ravel())
    for each, panel in zip(axes, figure.panels, strict=False):
        _draw_panel(each, panel, entries)
        if figure.shared:
            each.label_outer()
    for each, panel in zip(axes, figure.panels, strict=False):
        for letter in panel.angles:  # after all curves, which may share the axis
            tick_angles(getattr(each, f"{letter}axis"))
    for each in axes[count:]:
        each.set_axis_off()
    if heading:
        axes[0].set_title(plain(heading), loc="left", fontweight="bold")
    place.align_ylabels(axes)


def _draw_panel(axes: "Axes", panel: Panel, entries: dict[str, "Artist"]) -> None:
    for curve in panel.curves:
        artist = _draw_curve(axes, curve)
        if curve.name:
            entries.setdefault(curve.name, artist)
    for mark in panel.marks:
        line = axes.axvline if mark.upright else axes.axhline
        artist = line(
            mark.at, label=plain(mark.name), color=THEME[mark.colour], linewidth=0.8, linestyle="--", zorder=1
        )
        entries.setdefault(mark.name, artist)
    axes.set(xlabel=panel.x, ylabel=panel.y, title=plain(panel.title))
    if panel.x_range is not None:
        axes.set_xlim(panel.x_range)
    if panel.y_range is not None:
        axes.set_ylim(panel.y_range)
    if panel.logarithmic:
        axes.set_yscale("log")
    if panel.ticks:
        axes.set_xticks(range(len(panel.ticks)), [plain(name).replace(" ", "\n", 1) for name in panel.ticks])
        axes.tick_params(axis="x", length=0)
        axes.grid(visible=False, axis="x")


def _draw_curve(axes: "Axes", curve: Curve) -> "Artist":
    if isinstance(curve.colour, str):
        look: dict[str, Any] = {"color": THEME[curve.colour]}
    else:
        look = line_look(curve.colour)
    if curve.look in (BARS, PALE_BARS):
        return _draw_bars(axes, curve, look["color"])
    look |= LOOKS[curve.look] | ({"drawstyle": "steps-post"} if curve.steps else {})
    if curve.look in (RING, STAR):
        look = {"markerfacecolor": look["color"]} | look | {"linestyle": "none", "zorder": 3}
    (line,) = axes.plot(curve.x, curve.y, label=plain(curve.name), **look)
    if curve.interval is not None:
        axes.fill_between(curve.x, *curve.interval.T, color=look["color"], alpha=0.18, linewidth=0)
    return line


def _draw_bars(axes: "Axes", curve: Curve, colour: str) -> "Artist":
    """Bars, error bars where an interval has a width, and numbers where there is room."""
    hatch = "" if isinstance(curve.colour, str) else HATCHES[curve.colour // len(SERIES) % len(HATCHES)]
    look: dict[str, Any] = {"color": colour, "hatch": hatch, "alpha": 1.0 if curve.look == BARS else 0.45}
    bars = axes.bar(curve.x, curve.y, width=curve.width, label=plain(curve.name), **look)
    tops = curve.y
    if curve.interval is not None:
        low, high = curve.interval.T
        wide, tops = high > low, np.fmax(curve.y, high)
        reach = np.maximum(0.0, [curve.y - low, high - curve.y])[:, wide]
        for colour, line, cap in (("white", 2.2, 2.8), ("black", 0.8, 2.0)):
            ends: dict[str, Any] = {"ecolor": colour, "elinewidth": line, "capthick": line, "capsize": cap}
            axes.errorbar(curve.x[wide], curve.y[wide], reach, fmt="none", **ends)
    if curve.width >= NUMBERED_BAR_WIDTH:
        above: Any = {"xytext": (0, 1.5), "textcoords": "offset points", "ha": "center", "fontsize": 7}
        for x, y, top in zip(curve.x, curve.y, tops, strict=True):
            axes.annotate(f"{y:.0f}", (x, top), **above)
    return next(iter(bars), axes.patch)


def styled() -> AbstractContextManager[None]:
    """A context in which figures have this style."""
    with needing("matplotlib", "plot", "a figure"):
        from matplotlib import style
    # A user's matplotlibrc has no effect.
    sheet = str(resources.files(__package__) / "assets" / "figure.mplstyle")
    colours = {"axes.edgecolor": BASE, "xtick.color": BASE, "ytick.color": BASE, "grid.color": GUIDE}
    return style.context(["default", sheet, colours])


def new_figure(width: float, height: float) -> "Drawing":
    """An empty figure of a given size (inches), with matplotlib's constrained layout."""
    from matplotlib.figure import Figure as Drawing

    return Drawing((width, height), layout="constrained")


def render(drawing: "Drawing", suffix: str) -> bytes:
    """Render a figure as the bytes of a file; equal figures give equal bytes."""
    metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(suffix)
    file = io.BytesIO()
    with styled():
        drawing.savefig(file, format=suffix[1:], metadata=metadata)
    return file.getvalue()


def plain(name: str) -> str:
    """A name as matplotlib text: one printable line, in which dollars start no formula.

    A leading underscore would hide the entry from legends, so a space goes before it.
    """
    short = one_line(name, MAX_NAME_LENGTH)
    return (" " if short.startswith("_") else "") + short.replace("$", r"\$")


def line_look(k: int) -> dict[str, Any]:
    """Colour and dashes of the k-th line."""
    return {"color": SERIES[k % len(SERIES)], "linestyle": DASHES[k // len(SERIES) % len(DASHES)]}


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


def legend_below(drawing: "Drawing", entries: Sequence[tuple["Artist", str]]) -> None:
    """A legend below the panels, in as few rows as fit by the estimated widths of its entries (inches)."""
    widths = [0.065 * len(text) + 0.5 for _, text in entries]
    columns = len(entries) if sum(widths) < drawing.get_figwidth() else int(drawing.get_figwidth() / max(widths))
    artists, texts = zip(*entries, strict=True)
    drawing.legend(artists, texts, loc="outside lower center", ncols=max(1, columns))
