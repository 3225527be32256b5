"""The page's interactive plots, made with Bokeh, which brings zoom, pan and hover.

Importing this file needs Bokeh. The page stores each trajectory once: here the sources of the time series and the
phase portraits are empty, and the page's ``plots.js`` fills them. The tags of glyphs name the style sheet's
variables for their colours, so that plots follow the page's light and dark themes.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, TypedDict

from bokeh.embed import json_item
from bokeh.layouts import gridplot
from bokeh.model import Model
from bokeh.models import ColumnDataSource, CrosshairTool, FixedTicker, HoverTool, Range1d
from bokeh.models.annotations import Span
from bokeh.models.renderers import DataRenderer, GlyphRenderer
from bokeh.plotting import figure
from bokeh.resources import Resources

from ..plant.plant import Plant

if TYPE_CHECKING:
    from ..benchmark.board_rows import Row

TOOLS = "pan,box_zoom,wheel_zoom,reset,save"
RUN_COLUMNS = ("t", "q1", "q2", "dq1", "dq2", "u1", "u2", "height")
RUNS: dict[str, dict[str, Any]] = {
    "clean": {"line_width": 2.2},
    "disturbed": {"line_width": 1.1, "line_alpha": 0.75},
}
"""Line styles of the two runs."""
SERIES_HEIGHT = 150
"""Height of one time series (pixels)."""
GROUP_WIDTH = 0.84
"""Width of all bars of one criterion, where criteria are 1 apart."""


class Curve(TypedDict):
    """One line of a plot: its column and the style sheet's variable of its colour."""

    column: str
    colour: str


def script() -> str:
    """The core of Bokeh's JavaScript, from the installed package."""
    return "\n".join(Resources(mode="inline", minified=True, components=["bokeh"], log_level="error").js_raw)


def motion_figures(parameters: Plant, driven: int, duration: float) -> dict[str, Any]:
    """Tip height, angles, velocities and torque over time, and a phase portrait of each joint, without data.

    Args:
        parameters: the plant.
        driven: index of the driven joint.
        duration: length of the time axis (s).
    """
    sources = _sources(RUN_COLUMNS)
    others = ColumnDataSource({"t": [], "height": []}, name="others")
    axis = Range1d(start=0.0, end=duration)
    cross = Span(dimension="height", line_dash="dotted", tags=["--muted"])
    reach = float(parameters.l1 + parameters.l2)
    torque = ("u1", "u2")[driven]
    joints: list[Curve] = [{"column": "q1", "colour": "--link-1"}, {"column": "q2", "colour": "--link-2"}]
    rates: list[Curve] = [{"column": "dq1", "colour": "--link-1"}, {"column": "dq2", "colour": "--link-2"}]
    rows = [
        _time_series("Tip height (m)", [{"column": "height", "colour": "--link-2"}], sources, axis),
        _time_series("Angles (rad)", joints, sources, axis),
        _time_series("Velocities (rad/s)", rates, sources, axis),
        _time_series("Torque (N m)", [{"column": torque, "colour": "--driven"}], sources, axis),
    ]
    grey = rows[0].multi_line("t", "height", source=others, line_alpha=0.45, level="underlay", line_width=1.2)
    grey.glyph.tags = ["--base"]
    rows[0].y_range = Range1d(start=-1.1 * reach, end=1.1 * reach)
    rows[0].add_layout(
        Span(location=0.9 * reach, dimension="width", line_dash="dashed", line_width=1.5, tags=["--goal"])
    )
    for row in rows:
        row.add_tools(CrosshairTool(overlay=cross, visible=False))  # one shared line
    rows[-1].xaxis.visible = True
    rows[-1].xaxis.axis_label = "Time (s)"
    rows[-1].height = SERIES_HEIGHT + 42  # room for the axis
    return {
        "series": embedded(
            gridplot([[row] for row in rows], sizing_mode="stretch_width", toolbar_location="above")
        ),
        "phase-1": embedded(_phase(1, "--link-1")),
        "phase-2": embedded(_phase(2, "--link-2")),
    }


def robustness_figure(rows: Sequence["Row"], labels: Sequence[str], criteria: dict[str, str]) -> dict[str, Any]:
    """Bars of the successes (%) in each criterion; the bars of row i are the renderer ``bars-i``.

    Args:
        rows: the controllers.
        labels: their names in the plot.
        criteria: headings of the criteria by their column.
    """
    plot = new_plot(height=320, toolbar_location="above", name="robustness")
    plot.x_range, plot.y_range = Range1d(start=-0.55, end=len(criteria) - 0.45), Range1d(start=0, end=106)
    width = GROUP_WIDTH / len(rows)
    for index, (row, label) in enumerate(zip(rows, labels, strict=True)):
        # Criteria that were not measured have no bar.
        shown = [(place, column) for place, column in enumerate(criteria) if row.values[column] is not None]
        source = ColumnDataSource(
            {
                "x": [place - GROUP_WIDTH / 2 + (index + 0.5) * width for place, _ in shown],
                "percent": [row.values[column] for _, column in shown],
                "criterion": [criteria[column].replace("\n", " ") for _, column in shown],
                "controller": [label] * len(shown),
            }
        )
        alpha = 1.0 if row.source == "ours" else 0.45
        bars = plot.vbar(
            "x", top="percent", width=0.92 * width, source=source, fill_alpha=alpha, name=f"bars-{index}"
        )
        bars.glyph.tags = [f"--series-{index}"]
    plot.add_tools(
        HoverTool(
            tooltips=[("controller", "@controller"), ("@criterion", "@percent{0.0} %")],
            attachment="horizontal",
            visible=False,
        )
    )
    plot.xaxis.ticker = FixedTicker(ticks=list(range(len(criteria))))
    plot.xaxis.major_label_overrides = dict(enumerate(criteria.values()))
    plot.xaxis.axis_label, plot.yaxis.axis_label = "Criterion", "Successes (%)"
    plot.xgrid.visible = False
    return embedded(plot)


def _time_series(
    label: str, curves: Sequence[Curve], sources: dict[str, ColumnDataSource], axis: Range1d
) -> figure:
    plot = new_plot(height=SERIES_HEIGHT, x_range=axis, min_border_left=62, tags=["time"])
    values = [(curve["column"], f"@{curve['column']}{{0.000}}") for curve in curves]
    sides: dict[str, Literal["left", "right"]] = {"disturbed": "left", "clean": "right"}
    for run, side in sides.items():
        lines: list[DataRenderer] = [_line(plot, "t", curve, sources[run], run) for curve in curves]
        tips = [("", "$name"), ("t", "@t{0.00} s"), *values]
        plot.add_tools(HoverTool(renderers=lines[:1], mode="vline", tooltips=tips, attachment=side, visible=False))
    plot.add_layout(
        Span(location=0.0, dimension="height", line_width=1.6, level="overlay", name="now", tags=["--driven"])
    )
    plot.xaxis.visible = False
    plot.yaxis.axis_label = label
    return plot


def _phase(joint: int, colour: str) -> figure:
    plot = new_plot(height=300, toolbar_location="above")
    # Each portrait has its own sources: Bokeh allows a source in one document only.
    sources, dots = _sources(RUN_COLUMNS), _sources(RUN_COLUMNS[1:5], "-now")
    q, rate = f"q{joint}", f"dq{joint}"
    lines: list[DataRenderer] = [
        _line(plot, q, {"column": rate, "colour": colour}, sources[run], run) for run in reversed(RUNS)
    ]
    for run, dot in dots.items():
        size = 10 if run == "clean" else 7
        now = plot.scatter(q, rate, source=dot, size=size, level="overlay", name=f"{run}, now")
        now.glyph.tags = ["--driven"]
    numbers = [("t", "@t{0.00} s"), (f"q{joint}", f"@{q}{{0.000}} rad"), (f"dq{joint}", f"@{rate}{{0.000}} rad/s")]
    plot.add_tools(HoverTool(renderers=lines, tooltips=[("", "$name"), *numbers], visible=False))
    plot.xaxis.axis_label, plot.yaxis.axis_label = f"q{joint} (rad)", f"dq{joint} (rad/s)"
    return plot


def _sources(columns: Sequence[str], suffix: str = "") -> dict[str, ColumnDataSource]:
    """An empty source for each run, which the page's scripts find by its name."""
    return {run: ColumnDataSource({name: [] for name in columns}, name=f"{run}{suffix}") for run in RUNS}


def _line(plot: figure, x: str, curve: Curve, source: ColumnDataSource, run: str) -> GlyphRenderer:
    line = plot.line(x, curve["column"], source=source, name=run, **RUNS[run])
    line.glyph.tags = [curve["colour"]]
    return line


def new_plot(**options: Any) -> figure:
    """An empty figure without frame and background: the page's style sheet provides both."""
    plot = figure(sizing_mode="stretch_width", tools=TOOLS, active_drag="box_zoom", **options)
    plot.background_fill_alpha = plot.border_fill_alpha = 0.0
    plot.outline_line_color = None
    plot.toolbar.logo = None
    plot.axis.minor_tick_line_color = None
    plot.axis.axis_label_text_font_style = "normal"
    return plot


def embedded(model: Model) -> dict[str, Any]:
    """A plot as data of the page's scripts."""
    return dict(json_item(model))
