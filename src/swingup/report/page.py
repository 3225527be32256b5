"""One HTML file that needs no network: tables, interactive plots, players, and live pendulums.

:func:`render_page` is a pure function of what it shows. The page's template, styles and scripts lie in ``assets``.
A content security policy forbids the page to load anything. The template puts foreign names and remarks into one
printable line each, and escapes them.
"""

import json
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from ..benchmark.columns import COLUMNS
from ..benchmark.leaderboard import OURS, Row, Table
from ..benchmark.recording import LEAST, checked_rows
from ..benchmark.rollout import Trajectory
from ..benchmark.rules import CRITERIA
from ..common import __version__
from ..common.errors import SwingupError, needing, one_line
from ..common.files import check_suffix, write_atomically
from ..export.javascript_backend.page import policy_data, policy_script
from ..loop.loop import LOOP_DT
from ..plant.plant import LEADERBOARD, NAMES
from ..plant.robots import get_robot
from .draw import FIGURE_FORMATS, draw, render
from .figure import Figure, encode
from .figures import LINKS, motion_panels, phase_figure, robustness_figure
from .log_report import LogReport
from .make import Section, Show

SCRIPTS = ("figure.js", "physics.js", "pendulum.js", "player.js", "live.js", "main.js")
"""The page's scripts in the order of their dependencies."""

PAGE_FORMATS = (".html", *FIGURE_FORMATS)

MOST_SERIES = 8
"""Most controllers in the robustness plot: ours first, then the best published ones."""


def render_page(sections: Sequence[Section], title: str = "Swinging up double pendulums") -> str:
    """Render a page that shows one or both robots, as the text of one HTML file."""
    names = [section.robot for section in sections]
    if not names or len(set(names)) < len(names):
        raise SwingupError(f"a report of {', '.join(names) or 'no robot'}: give one section for each robot")
    arrays: dict[str, int] = {}
    encoded = [_encode(section, arrays) for section in sections]
    return _render(arrays, {"sections": encoded}, title=title, sections=list(zip(sections, encoded, strict=True)))


def render_log_page(report: LogReport) -> str:
    """Render a report about logs as the text of one HTML file."""
    arrays: dict[str, int] = {}
    figures = [encode(part.figure, arrays) for part in report.parts]
    return _render(arrays, {"figures": figures}, **vars(report))


def save_log_report(report: LogReport, out: str | Path) -> None:
    """Write a report about logs whole or not at all: a page, or its figures as a picture, by the suffix."""
    suffix = check_suffix(out, PAGE_FORMATS)
    if suffix == ".html":
        content = render_log_page(report).encode()
    else:
        figures = {part.title: part.figure for part in report.parts if part.figure is not None}
        content = render(draw(figures, report.title), suffix)
    write_atomically(out, content)


def _render(arrays: Mapping[str, int], shown: dict[str, Any], **texts: Any) -> str:
    """Fill the template in."""
    content = json.dumps(
        {"arrays": list(arrays), "sections": [], "figures": [], **shown}, allow_nan=False, separators=(",", ":")
    )
    # Nothing in a script element may end it.
    for sign in "<\u2028\u2029":
        content = content.replace(sign, f"\\u{ord(sign):04x}")
    return str(
        page_template().render(
            {"sections": [], "parts": [], "notes": [], "lead": "", **texts},
            version=__version__,
            style=_asset("style.css"),
            data=content,
            scripts="\n".join([policy_script(), *map(_asset, SCRIPTS)]),
            columns=COLUMNS,
            leaderboards_plant=LEADERBOARD,
            robot_named=get_robot,
        )
    )


def page_template() -> Any:
    """The page's template."""
    with needing("Jinja", "report", "a report"):
        from jinja2 import Environment, StrictUndefined
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["line"] = one_line
    return environment.from_string(_asset("page.html"))


def _encode(section: Section, arrays: dict[str, int]) -> dict[str, Any]:
    """A section as data of the page's scripts."""
    runs = {show.name: found for show in section.shows if (found := _drawable(show))}
    entries = _series(section.tables)
    bars = {_label(row): {name: row.values[name] for name in CRITERIA} for row in entries}
    pale = [_label(row) for row in entries if row.source != OURS]
    return {
        "robot": section.robot,
        "driven": get_robot(section.robot).joint,
        "dt": LOOP_DT,
        "parameters": {name: float(getattr(section.plant, name)) for name in NAMES},
        "policy": None if section.policy is None else policy_data(section.policy),
        "shows": [_encode_show(section, name, runs, arrays) for name in runs],
        "robustness": encode(robustness_figure(bars, pale), arrays) if bars else None,
    }


def _drawable(show: Show) -> dict[str, Trajectory]:
    """The runs of a show, each up to its first row that is not finite in single precision, if it has three rows."""
    runs = {}
    for run, given in show.runs.items():
        with np.errstate(over="ignore"):
            finite = [np.isfinite(np.asarray(part, np.float32)) for part in (given.time, given.x, given.u)]
        kept = np.logical_and.accumulate(finite[0] & finite[1].all(axis=1) & finite[2].all(axis=1))
        if kept.sum() >= LEAST:
            runs[run] = checked_rows(given.take(kept), f"trajectory of {one_line(show.name)}")
    return runs


def _encode_show(
    section: Section, name: str, playable: Mapping[str, Mapping[str, Trajectory]], arrays: dict[str, int]
) -> dict[str, Any]:
    """A controller's runs for the player, and the figures that follow it."""
    runs, robot = playable[name], get_robot(section.robot)
    others = [each["undisturbed"] for key, each in playable.items() if key != name and "undisturbed" in each]
    rows = {
        run: encode({"time": each.time, "x": list(each.x.T), "u": list(each.u.T)}, arrays)
        for run, each in runs.items()
    }
    series = Figure(motion_panels(runs, robot, section.plant, others=others), shared=True)
    figures = {"series": series, "phases": phase_figure(runs, robot, LINKS)}
    return {"name": one_line(name), "runs": rows, "figures": encode(figures, arrays)}


def _label(row: Row) -> str:
    return one_line(row.controller if row.source == OURS else f"{row.controller} ({row.source})")


def _series(boards: Sequence[Table]) -> list[Row]:
    """Rows of the robustness plot, in the board's order; one row for each published controller."""
    rows = [row for board in boards if board.board == "robustness" for row in board.rows]
    measured = [row for row in rows if any(row.values[name] is not None for name in CRITERIA)]
    best = {(row.controller, row.source == OURS): row for row in reversed(measured)}
    first = sorted(best.values(), key=lambda row: (row.source != OURS, measured.index(row)))[:MOST_SERIES]
    return [row for row in measured if row in first]


def _asset(name: str) -> str:
    """The text of a file in ``assets``."""
    return (resources.files(__package__) / "assets" / name).read_text(encoding="utf-8")
