"""One HTML file that needs no network: tables, interactive plots, players, and live pendulums.

:func:`render_page` is a pure function of its sections. The page's own styles and scripts lie in ``assets``; Bokeh's
JavaScript comes from the installed package. A content security policy forbids the page to load anything. Foreign
names and remarks become one printable line each, and the template escapes them.
"""

import json
from collections.abc import Sequence
from importlib import resources
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from ..benchmark.columns import COLUMNS
from ..benchmark.rules import CRITERIA
from ..common.errors import SwingupError
from ..common.text import one_line
from ..common.version import __version__
from ..export.javascript_backend.page import policy_script
from ..plant.plant import LEADERBOARD
from ..plant.robots import get_robot
from .content import Section, Show, encode_section

if TYPE_CHECKING:
    from ..benchmark.board_rows import Row
    from ..benchmark.leaderboard import Board

__all__ = ["Section", "Show", "render_page"]

SCRIPTS = ("physics.js", "pendulum.js", "player.js", "live.js", "plots.js")
"""The page's scripts in the order of their dependencies; ``main.js`` follows."""

JOINT_NAMES = ("the shoulder", "the elbow")

TITLES = {"performance": "Performance", "robustness": "Robustness", "uptime": "Global policy"}

NOTES = {
    "performance": "One undisturbed swing-up of 10 s from hanging at rest. The RealAI score is "
    "1 − ⅕ Σ tanh(π c / n) over the five costs c with their norms n: 1 is best, and a run that does not end "
    "upright scores 0.",
    "robustness": "Percentage of simulations that end upright; the overall score is the mean of the six.",
    "uptime": "Share of 60 s with the tip above the line, while the pendulum is thrown 15 times.",
}

MOST_SERIES = 8
"""Most controllers in the robustness plot: ours first, then the best published ones."""


def render_page(sections: Sequence[Section], title: str = "Swinging up double pendulums") -> str:
    """Render a page that shows one or both robots, as the text of one HTML file.

    Args:
        sections: one for each robot.
        title: heading of the page.

    Raises:
        SwingupError: Bokeh is not installed, no section or two for one robot are given, a trajectory's arrays do
            not fit together, or the page's scripts cannot run a policy.
    """
    names = [section.robot for section in sections]
    if not names or len(set(names)) < len(names):
        raise SwingupError(f"a report of {', '.join(names) or 'no robot'}: give one section for each robot")
    figures, template = page_tools("page.html")
    encoded = [_encode(figures, section) for section in sections]
    scripts = [policy_script(), *map(asset, SCRIPTS)]
    return str(
        template.render(
            title=one_line(title),
            version=__version__,
            sections=[_describe(*pair) for pair in zip(sections, encoded, strict=True)],
            style=asset("style.css"),
            data=json_for_script({"sections": encoded}),
            bokeh=figures.script(),
            scripts="\n".join([*scripts, asset("main.js")]),
        )
    )


def page_tools(name: str) -> tuple[ModuleType, Any]:
    """The figures and a page's template in ``assets``; their libraries come with the extra ``report``.

    Raises:
        SwingupError: Bokeh or Jinja is not installed.
    """
    try:
        from jinja2 import Environment, StrictUndefined

        from . import figures
    except ImportError as error:
        raise SwingupError("a report needs Bokeh, which is missing: pip install swingup[report]") from error
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return figures, environment.from_string(asset(name))


def _encode(figures: ModuleType, section: Section) -> dict[str, Any]:
    """A section as data of the page's scripts."""
    encoded = encode_section(section)
    # The player cannot show a run without a finite row.
    encoded["shows"] = [show for show in encoded["shows"] if show["clean"] or show["disturbed"]]
    runs = [run for show in section.shows for run in (show.clean, show.disturbed) if run is not None]
    times = np.concatenate([np.zeros(1), *(np.asarray(run.time, np.float64) for run in runs)])
    plots: dict[str, Any] = {}
    if encoded["shows"]:
        plots |= figures.motion_figures(
            section.parameters, encoded["driven"], float(times[np.isfinite(times)].max())
        )
    rows = _series(section.boards)
    if rows:
        criteria = {name: COLUMNS[name].label.replace(" ", "\n", 1) for name in CRITERIA}
        plots["robustness"] = figures.robustness_figure(rows, [_label(row) for row in rows], criteria)
    return encoded | {"plots": plots}


def _describe(section: Section, encoded: dict[str, Any]) -> dict[str, Any]:
    """A section as text for the template."""
    return {
        "robot": section.robot,
        "driven": JOINT_NAMES[get_robot(section.robot).joint],
        "disturbance": one_line(section.disturbance),
        "live": section.policy is not None,
        "policy_note": None if section.policy_note is None else one_line(section.policy_note),
        "shows": [show["name"] for show in encoded["shows"]],
        "notes": [(one_line(show.name), one_line(show.note)) for show in section.shows if show.note],
        "boards": [_table(board) for board in section.boards],
        "series": [(_label(row), row.source == "ours") for row in _series(section.boards)],
    }


def _table(board: "Board") -> dict[str, Any]:
    """A board as text."""
    rows = [
        {
            "name": one_line(row.controller),
            "source": one_line(row.source),
            "ours": row.source == "ours",
            "remark": None if row.remark is None else one_line(row.remark),
            "cells": [COLUMNS[name].show(row.values[name]) for name in board.columns],
            "share": _share(row.values.get(board.columns[-1])),
        }
        for row in board.rows
    ]
    seed = "" if board.seed is None else f" Seed {board.seed}."
    plant = "" if board.plant == LEADERBOARD else f" Plant {one_line(str(board.plant))}."
    note = NOTES.get(board.measure, "") + f" Rules {board.rules}.{seed}{plant}"
    title = TITLES.get(board.measure, board.measure)
    return {
        "measure": board.measure,
        "title": title,
        "heads": [(name, COLUMNS[name].label, COLUMNS[name].unit) for name in board.columns],
        "rows": rows,
        "note": note,
    }


def _share(value: float | None) -> float:
    """Length of the bar behind a score (%)."""
    return 0.0 if value is None or not np.isfinite(value) else round(100 * min(1.0, max(0.0, value)), 1)


def _label(row: "Row") -> str:
    return one_line(row.controller if row.source == "ours" else f"{row.controller} ({row.source})")


def _series(boards: Sequence["Board"]) -> list["Row"]:
    """Rows of the robustness plot, in the board's order; one row for each published controller."""
    board = next((board for board in boards if board.measure == "robustness"), None)
    measured = (
        [row for row in board.rows if any(row.values[name] is not None for name in CRITERIA)] if board else []
    )
    ours = [row for row in measured if row.source == "ours"][:MOST_SERIES]
    published = {row.controller: row for row in reversed(measured) if row.source != "ours"}
    best = [row for row in measured if row is published.get(row.controller)][: MOST_SERIES - len(ours)]
    return [row for row in measured if any(row is chosen for chosen in (*ours, *best))]


def json_for_script(data: Any) -> str:
    """JSON for a script element: nothing in it can end the element."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def asset(name: str) -> str:
    """The text of a file in ``assets``."""
    return (resources.files(__package__) / "assets" / name).read_text(encoding="utf-8")
