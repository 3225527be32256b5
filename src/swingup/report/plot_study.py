"""A study's panels as one figure: parts below each other, tables and notes left to the page."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..errors import SwingupError
from .study import BAND, DASHED, DOTS, MEASURED, STEPS, Curve, Panel, Part, Study
from .style import COLOURS, legend_below, new_figure, plain, styled

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 8.5
SERIES_HEIGHT, PANEL_HEIGHT = 1.15, 2.4
"""Sizes of the figure and of its panels (inches)."""
SIDE_BY_SIDE = 2
SERIES = (COLOURS[1], COLOURS[2], "#4f9d69", "#b58a1b")
"""Colours of the numbered curves."""


def plot_study(study: Study) -> "Figure":
    """Draw the panels of all parts.

    Raises:
        SwingupError: there is no panel, or matplotlib is not installed.
    """
    rows = [row for part in study.parts for row in _rows(part)]
    if not rows:
        raise SwingupError("nothing to draw: no stretch of the log is long enough")
    heights = [height for _, height, _ in rows]
    with styled():
        figure = new_figure(WIDTH, sum(heights) + 0.8)
        figure.suptitle(plain(study.title), fontsize=11)
        entries: dict[str, Artist] = {}
        parts = figure.subfigures(len(rows), 1, height_ratios=heights, squeeze=False)[:, 0]
        for place, (panels, _, title) in zip(parts, rows, strict=True):
            axes = place.subplots(1, len(panels), squeeze=False)[0]
            for each, panel in zip(axes, panels, strict=True):
                _draw(each, panel, entries)
            if title:
                axes[0].set_title(title, loc="left", fontweight="bold")
        legend_below(figure, [(artist, name) for name, artist in entries.items()])
    return figure


def _rows(part: Part) -> list[tuple[Sequence[Panel], float, str]]:
    """Panels side by side, their height, and a title in the first row."""
    panels = list(part.panels)
    across, height = (1, SERIES_HEIGHT) if part.over_time else (SIDE_BY_SIDE, PANEL_HEIGHT)
    groups = [panels[first : first + across] for first in range(0, len(panels), across)]
    # Room for the title, and for the axis below the last row.
    extra = [0.25 * (k == 0) + 0.3 * (part.over_time and k == len(groups) - 1) for k in range(len(groups))]
    return [
        (group, height + more, part.title if k == 0 else "")
        for k, (group, more) in enumerate(zip(groups, extra, strict=True))
    ]


def _draw(axes: "Axes", panel: Panel, entries: dict[str, "Artist"]) -> None:
    for curve in panel.curves:
        artist = _curve(axes, curve)
        if curve.name:
            entries.setdefault(plain(curve.name), artist)
    if panel.logarithmic:
        axes.set_yscale("log")
    if panel.ticks:
        axes.set_xticks(range(len(panel.ticks)), [plain(name) for name in panel.ticks])
    axes.set(xlabel=panel.x, ylabel=panel.y)


def _curve(axes: "Axes", curve: Curve) -> "Artist":
    colour = "black" if curve.colour == MEASURED else SERIES[int(curve.colour) % len(SERIES)]
    if curve.look == BAND:
        assert curve.upper is not None
        return axes.fill_between(curve.x, curve.y, curve.upper, color=colour, alpha=0.18, linewidth=0)
    if curve.look == DOTS:
        return axes.plot(curve.x, curve.y, ".", color=colour, markersize=3, alpha=0.6)[0]
    look: dict[str, Any] = {"drawstyle": "steps-post"} if curve.look == STEPS else {}
    dash = "--" if curve.look == DASHED else "-"
    return axes.plot(curve.x, curve.y, dash, color=colour, linewidth=0.9, **look)[0]
