"""A study's panels as interactive plots, made with Bokeh. Importing this file needs Bokeh."""

from typing import Any

import numpy as np
from bokeh.layouts import gridplot
from bokeh.models import ColumnDataSource, CrosshairTool, FixedTicker, HoverTool, Range1d
from bokeh.models.annotations import Span
from bokeh.plotting import figure

from ..common.text import one_line
from .figures import embedded, new_plot, script
from .study import BAND, DASHED, DOTS, LINE, STEPS, Curve, Panel, Part

__all__ = ["part_items", "script"]

SERIES_HEIGHT, PANEL_HEIGHT = 170, 300
"""Heights of panels over a time axis, and of others (pixels)."""
AXIS_HEIGHT = 42
WIDTHS = {LINE: 2.0, STEPS: 1.2, DASHED: 1.6}
"""Widths of lines (pixels); of others 1.2."""


def part_items(part: Part) -> list[dict[str, Any]]:
    """The plots of a part as data of the page's scripts: one over a time axis, or one for each panel."""
    if not part.panels:
        return []
    if not part.over_time:
        return [embedded(_plot(panel, height=PANEL_HEIGHT, toolbar_location="above")) for panel in part.panels]
    ends = [curve.x[[0, -1]] for panel in part.panels for curve in panel.curves if len(curve.x)]
    low, high = (float(np.nanmin(ends)), float(np.nanmax(ends))) if ends else (0.0, 1.0)
    axis = Range1d(start=low, end=high)
    cross = Span(dimension="height", line_dash="dotted", tags=["--muted"])
    plots = [_plot(panel, height=SERIES_HEIGHT, x_range=axis, min_border_left=62) for panel in part.panels]
    for plot in plots:
        plot.add_tools(CrosshairTool(overlay=cross, visible=False))
        plot.xaxis.visible = plot is plots[-1]
    plots[-1].height = SERIES_HEIGHT + AXIS_HEIGHT
    return [embedded(gridplot([[plot] for plot in plots], sizing_mode="stretch_width", toolbar_location="above"))]


def _plot(panel: Panel, **options: Any) -> figure:
    kind = {"y_axis_type": "log"} if panel.logarithmic else {}
    plot = new_plot(**options, **kind)
    for curve in panel.curves:
        _draw(plot, curve)
    plot.add_tools(
        HoverTool(tooltips=[("", "$name"), (panel.x, "$x{0.000}"), (panel.y, "$y{0.0000}")], visible=False)
    )
    plot.xaxis.axis_label, plot.yaxis.axis_label = panel.x, panel.y
    if panel.ticks:
        plot.xaxis.ticker = FixedTicker(ticks=list(range(len(panel.ticks))))
        plot.xaxis.major_label_overrides = {place: one_line(name) for place, name in enumerate(panel.ticks)}
    return plot


def _draw(plot: figure, curve: Curve) -> None:
    colour = f"--series-{curve.colour}" if isinstance(curve.colour, int) else "--ink"
    name = one_line(curve.name)
    columns = {"x": _small(curve.x), "y": _small(curve.y)}
    if curve.upper is not None:
        columns["upper"] = _small(curve.upper)
    source = ColumnDataSource(columns)
    made: Any
    if curve.look == BAND:
        made = plot.varea("x", "y", "upper", source=source, fill_alpha=0.18, name=name)
    elif curve.look == DOTS:
        made = plot.scatter("x", "y", source=source, size=5, fill_alpha=0.55, line_alpha=0.0, name=name)
    elif curve.look == STEPS:
        made = plot.step("x", "y", source=source, mode="after", line_width=WIDTHS[STEPS], name=name)
    else:
        dash = "dashed" if curve.look == DASHED else "solid"
        made = plot.line("x", "y", source=source, line_width=WIDTHS.get(curve.look, 1.2), line_dash=dash, name=name)
    made.glyph.tags = [colour]


def _small(values: np.ndarray) -> np.ndarray:
    """Single precision: half of the page's size, and finer than a screen."""
    return np.asarray(values, np.float32)
