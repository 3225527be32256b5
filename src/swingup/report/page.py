"""One HTML file that needs no network: tables, interactive plots, players, and live pendulums.

:func:`render_page` is a pure function of what it shows. The page's template, styles and scripts lie in ``assets``.
A content security policy forbids the page to load anything. Foreign names and remarks become one printable line
each, and the template escapes them.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from ..benchmark.columns import COLUMNS
from ..benchmark.rollout import Trajectory
from ..benchmark.rules import CRITERIA
from ..common.errors import SwingupError
from ..common.text import one_line
from ..common.version import __version__
from ..export.javascript_backend.page import policy_data, policy_script
from ..loop.loop import LOOP_DT
from ..plant.plant import LEADERBOARD, NAMES, Plant
from ..plant.robots import get_robot
from ..policy.pendulum import PendulumPolicy
from .figure import Figure, PageData
from .figures import motion_panels, phase_figure, robustness_figure
from .inputs import Rows, check_trajectory
from .log_report import LogReport

if TYPE_CHECKING:
    from ..benchmark.leaderboard import Row, Table

SCRIPTS = ("figure.js", "physics.js", "pendulum.js", "player.js", "live.js", "main.js")
"""The page's scripts in the order of their dependencies."""

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


@dataclass(frozen=True)
class Show:
    """One controller's recorded swing-ups."""

    name: str
    clean: Trajectory | None
    """Without a disturbance; None if the controller failed."""
    disturbed: Trajectory | None
    """With the section's disturbance; None if the controller failed."""
    note: str | None = None
    """Why a trajectory is missing, or another remark."""


@dataclass(frozen=True)
class Section:
    """What the page shows about one robot."""

    robot: str
    plant: Plant
    """A torque limit of 0 makes a joint passive."""
    tables: Sequence["Table"]
    shows: Sequence[Show]
    disturbance: str
    """What disturbs the disturbed trajectories, in one sentence."""
    policy: PendulumPolicy | None = None
    """Drives the live pendulum; without a policy the page has no live pendulum."""
    policy_note: str | None = None
    """Which policy that is, in one sentence; None for nothing to say."""


def render_page(sections: Sequence[Section], title: str = "Swinging up double pendulums") -> str:
    """Render a page that shows one or both robots, as the text of one HTML file.

    Args:
        sections: one for each robot.
        title: heading of the page.

    Raises:
        SwingupError: Jinja is not installed, no section or two for one robot are given, a trajectory's arrays do
            not fit together, or the page's scripts cannot run a policy.
    """
    names = [section.robot for section in sections]
    if not names or len(set(names)) < len(names):
        raise SwingupError(f"a report of {', '.join(names) or 'no robot'}: give one section for each robot")
    data = PageData()
    encoded = [_encode(section, data) for section in sections]
    described = [_describe(*pair) for pair in zip(sections, encoded, strict=True)]
    return _render(data, {"sections": encoded}, title=one_line(title), sections=described)


def render_log_page(report: LogReport) -> str:
    """Render a report about logs as the text of one HTML file.

    Raises:
        SwingupError: Jinja is not installed.
    """
    data = PageData()
    parts = [{"figure": None} | data.encode(part) for part in report.parts]
    texts = {"title": one_line(report.title), "lead": one_line(report.lead, 1000)}
    notes = [one_line(note) for note in report.notes]
    return _render(data, {"figures": [part["figure"] for part in parts]}, parts=parts, notes=notes, **texts)


def _render(data: PageData, shown: dict[str, Any], **texts: Any) -> str:
    """Fill the template in."""
    scripts = "\n".join([policy_script(), *map(_asset, SCRIPTS)])
    return str(
        page_template().render(
            {"sections": [], "parts": [], "notes": [], "lead": "", **texts},
            version=__version__,
            style=_asset("style.css"),
            data=_json_for_script({"arrays": data.arrays, "sections": [], "figures": [], **shown}),
            scripts=scripts,
        )
    )


def page_template() -> Any:
    """The page's template.

    Raises:
        SwingupError: Jinja is not installed.
    """
    try:
        from jinja2 import Environment, StrictUndefined
    except ImportError as error:
        raise SwingupError("a report needs Jinja, which is missing: pip install swingup[report]") from error
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string(_asset("page.html"))


def _encode(section: Section, data: PageData) -> dict[str, Any]:
    """A section as data of the page's scripts."""
    found = {
        show.name: {
            run: rows
            for run, given in (("undisturbed", show.clean), ("disturbed", show.disturbed))
            if given is not None and (rows := _drawable(show.name, given)) is not None
        }
        for show in section.shows
    }
    playable = {name: runs for name, runs in found.items() if runs}
    entries = _series(section.tables)
    bars = {_label(row): {name: row.values[name] for name in CRITERIA} for row in entries}
    pale = [_label(row) for row in entries if row.source != "ours"]
    return {
        "robot": section.robot,
        "driven": get_robot(section.robot).joint,
        "dt": LOOP_DT,
        "parameters": {name: float(getattr(section.plant, name)) for name in NAMES},
        "policy": None if section.policy is None else policy_data(section.policy),
        "shows": [_encode_show(section, name, playable, data) for name in playable],
        "robustness": data.encode(robustness_figure(bars, pale)) if bars else None,
    }


def _drawable(name: str, trajectory: Trajectory) -> Rows | None:
    """Rows up to the first that is not finite in single precision; None if less than three are left."""
    parts = [np.asarray(part, np.float64) for part in (trajectory.time, trajectory.x, trajectory.u)]
    with np.errstate(over="ignore"):
        flat = [part.astype(np.float32).reshape(len(part), -1) for part in parts]
    finite = [np.asarray(np.isfinite(part).all(axis=1)) for part in flat]
    rows = min(len(part) if np.all(part) else int(np.argmin(part)) for part in finite)
    if len({len(part) for part in parts}) == 1 and rows < 3:
        return None
    return check_trajectory(f"trajectory of {one_line(name)}", Rows(*(part[:rows] for part in parts)))


def _encode_show(
    section: Section, name: str, playable: dict[str, dict[str, Rows]], data: PageData
) -> dict[str, Any]:
    """A controller's runs for the player, and the figures that follow it."""
    runs, robot = playable[name], get_robot(section.robot)
    others = [each["undisturbed"] for key, each in playable.items() if key != name and "undisturbed" in each]
    colours = ("link-1", "link-2")
    rows = {
        run: {
            "time": data.array(each.time),
            "x": [data.array(x) for x in each.x.T],
            "u": [data.array(u) for u in each.u.T],
        }
        for run, each in runs.items()
    }
    series = Figure(motion_panels(runs, robot, section.plant, others=others), shared=True)
    figures = {"series": data.encode(series), "phases": data.encode(phase_figure(runs, robot, colours))}
    return {"name": one_line(name), "runs": rows, "figures": figures}


def _describe(section: Section, encoded: dict[str, Any]) -> dict[str, Any]:
    """A section as text for the template."""
    joint = get_robot(section.robot).joint
    return {
        "robot": section.robot,
        "driven": JOINT_NAMES[joint],
        "limit": f"{section.plant.limit(joint):.3g}",
        "plant": one_line(str(section.plant)),
        "disturbance": one_line(section.disturbance),
        "live": section.policy is not None,
        "policy_note": None if section.policy_note is None else one_line(section.policy_note),
        "shows": [show["name"] for show in encoded["shows"]],
        "notes": [(one_line(show.name), one_line(show.note)) for show in section.shows if show.note],
        "tables": [_table(board) for board in section.tables],
        "robustness": encoded["robustness"] is not None,
    }


def _table(board: "Table") -> dict[str, Any]:
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
    return {
        "measure": board.board,
        "title": TITLES.get(board.board, board.board),
        "heads": [(COLUMNS[name].label, COLUMNS[name].unit) for name in board.columns],
        "rows": rows,
        "note": NOTES.get(board.board, "") + f"{seed}{plant}",
    }


def _share(value: float | None) -> float:
    """Length of the bar behind a score (%)."""
    return 0.0 if value is None or not np.isfinite(value) else round(100 * min(1.0, max(0.0, value)), 1)


def _label(row: "Row") -> str:
    return one_line(row.controller if row.source == "ours" else f"{row.controller} ({row.source})")


def _series(boards: Sequence["Table"]) -> list["Row"]:
    """Rows of the robustness plot, in the board's order; one row for each published controller."""
    board = next((board for board in boards if board.board == "robustness"), None)
    measured = (
        [row for row in board.rows if any(row.values[name] is not None for name in CRITERIA)] if board else []
    )
    ours = [row for row in measured if row.source == "ours"][:MOST_SERIES]
    published = {row.controller: row for row in reversed(measured) if row.source != "ours"}
    best = [row for row in measured if row is published.get(row.controller)][: MOST_SERIES - len(ours)]
    return [row for row in measured if any(row is chosen for chosen in (*ours, *best))]


def _json_for_script(data: Any) -> str:
    """JSON for a script element: nothing in it can end the element."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _asset(name: str) -> str:
    """The text of a file in ``assets``."""
    return (resources.files(__package__) / "assets" / name).read_text(encoding="utf-8")
