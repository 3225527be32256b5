"""A study's panels as one figure: parts below each other, tables and notes left to the page."""

from typing import TYPE_CHECKING, Any

from ..common.errors import SwingupError
from .study import BAND, DASHED, DOTS, MEASURED, STEPS, Curve, Panel, Part, Study
from .style import COLOURS, legend_below, new_figure, plain, styled

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

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
    parts = [part for part in study.parts if part.panels]
    if not parts:
        raise SwingupError("nothing to draw: no stretch of the log is long enough")
    heights = [_height(part) for part in parts]
    with styled():
        figure = new_figure(WIDTH, sum(heights) + 0.8)
        figure.suptitle(plain(study.title), fontsize=11)
        entries: dict[str, Artist] = {}
        places = figure.subfigures(len(parts), 1, height_ratios=heights, squeeze=False)[:, 0]
        for place, part in zip(places, parts, strict=True):
            _draw_part(place, part, entries)
        legend_below(figure, [(artist, name) for name, artist in entries.items()])
    return figure


def _height(part: Part) -> float:
    """Room for the panels, their title, and the time axis."""
    if part.over_time:
        return SERIES_HEIGHT * len(part.panels) + 0.5
    return PANEL_HEIGHT * -(-len(part.panels) // SIDE_BY_SIDE) + 0.25


def _draw_part(place: "SubFigure", part: Part, entries: dict[str, "Artist"]) -> None:
    count = len(part.panels)
    columns = 1 if part.over_time else min(count, SIDE_BY_SIDE)
    grid = place.subplots(-(-count // columns), columns, squeeze=False, sharex=part.over_time)
    axes = list(grid.ravel())
    for each, panel in zip(axes[:count], part.panels, strict=True):
        _draw(each, panel, entries)
        if part.over_time and each is not axes[count - 1]:
            each.set_xlabel("")
    for each in axes[count:]:
        each.set_axis_off()
    axes[0].set_title(plain(part.title), loc="left", fontweight="bold")
    place.align_ylabels(axes)


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
