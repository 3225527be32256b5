"""A study as one HTML file that needs no network, in the style of the report.

Names from files become one printable line each, and the template escapes them.
"""

from typing import Any

from ..common.text import one_line
from ..common.version import __version__
from .page import asset, json_for_script, page_tools
from .study import Curve, Part, Study, Table

SCRIPTS = ("pendulum.js", "plots.js", "study.js")


def render_study(study: Study) -> str:
    """Render a study as the text of one HTML file.

    Raises:
        SwingupError: Bokeh is not installed.
    """
    _, template = page_tools("study.html")
    from . import study_figures as figures

    plots = [figures.part_items(part) for part in study.parts]
    return str(
        template.render(
            title=one_line(study.title),
            lead=one_line(study.lead, 1000),
            version=__version__,
            parts=[_describe(part, len(items)) for part, items in zip(study.parts, plots, strict=True)],
            notes=[one_line(note) for note in study.notes],
            style=asset("style.css"),
            data=json_for_script({"plots": plots}),
            bokeh=figures.script(),
            scripts="\n".join(map(asset, SCRIPTS)),
        )
    )


def _describe(part: Part, plots: int) -> dict[str, Any]:
    """A part as text for the template."""
    curves = {curve.name: curve for panel in part.panels for curve in panel.curves if curve.name}
    return {
        "title": one_line(part.title),
        "note": one_line(part.note, 1000),
        "tables": [_table(table) for table in part.tables],
        "key": [(one_line(name), variable(curve), curve.look) for name, curve in curves.items()],
        "plots": plots,
        "over_time": part.over_time,
    }


def _table(table: Table) -> dict[str, Any]:
    return {
        "heads": [one_line(head) for head in table.heads],
        "rows": [[one_line(cell) for cell in row] for row in table.rows],
    }


def variable(curve: Curve) -> str:
    """The style sheet's variable of a curve's colour."""
    return f"--series-{curve.colour}" if isinstance(curve.colour, int) else "--ink"
