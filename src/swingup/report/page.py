"""One HTML file that needs no network: tables, interactive plots, players, and live pendulums.

:func:`render_page` is a pure function of what it shows. The page's template, styles and scripts lie in ``assets``.
A content security policy forbids the page to load anything. The template puts foreign names and remarks into one
printable line each, and escapes them.
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from ..benchmark.board import AbstractBoard
from ..benchmark.disturbances import DisturbanceSettings, PushRules
from ..benchmark.judge import judge
from ..benchmark.leaderboard import DEFAULT_BOARDS, ENTRANTS, OURS, Row, Table, entrants_for, leaderboard
from ..benchmark.recording import MIN_ROWS, checked_rows
from ..benchmark.robustness_board import CRITERIA
from ..benchmark.rollout import Trajectory
from ..benchmark.runner import StageProgress
from ..benchmark.values import COLUMNS
from ..common import __version__
from ..common.errors import SwingupError, needing, one_line
from ..common.files import check_suffix, write_atomically
from ..controllers.registry import get_controller
from ..controllers.stack.policy import PolicyController, policy_of
from ..dynamics.integrate import stable_substeps
from ..export.javascript import policy_data, policy_script
from ..loop.domain import Domain
from ..loop.loop import LOOP_DT
from ..loop.resolve import resolve
from ..plant.plant import LEADERBOARD, NAMES, Plant, PlantLike, Robot, get_robot
from ..plant.units import scaled, scales_of
from ..policy.pendulum import PARTS, PendulumPolicy, policy_plant
from ..policy.shipped import AR_EAPO, DEFAULT, load_policy
from .draw import FIGURE_FORMATS, draw, render
from .figure import Figure, encode
from .figures import LINKS, motion_panels, phase_figure, robustness_figure
from .log_report import LogReport, Part

SHOWN_CONTROLLERS = (DEFAULT, *ENTRANTS)
"""Controllers whose swing-ups the page shows: the default one and the paper's."""
SHIPPED_CONTROLLERS = (DEFAULT, AR_EAPO)  # Shipped policies beside one that was trained just now
PUBLISHED_ROWS = (("AR-EAPO", "paper"), ("TVLQR", "paper"), ("History SAC", "board"))
"""Published rows beside it: the paper's method, its best baseline, and the best of the public leaderboard."""

LIVE_NOTE = (
    f"This policy is the network of {DEFAULT} alone, for this page's plant: its estimator, identifier and "
    "regulator, which run in Python and C only, are not in this page."
)
"""What the page says of the policy that drives the live pendulum."""

THINNING = 5  # Every fifth of the benchmark's 500 rows a second: a film of 100 rows a second still looks smooth
DISTURBANCE = DisturbanceSettings(velocity_noise=0.05, torque_noise=0.2, pushes=PushRules(amplitude=(0.5, 3.0)))
"""What disturbs the disturbed swing-ups (rad/s, N m): as many pushes as on the robustness board, up to 3 N m."""


@dataclass(frozen=True)
class Show:
    """One controller's recorded swing-ups."""

    name: str
    runs: Mapping[str, Trajectory]
    """``undisturbed``, and ``disturbed`` as the section says, without the runs in which the controller failed."""
    note: str | None = None  # Why a run is missing, or another remark


@dataclass(frozen=True)
class Section:
    """What the page shows about one robot."""

    robot: str
    plant: Plant  # A torque limit of 0 makes a joint passive
    tables: Sequence[Table]
    shows: Sequence[Show]
    disturbance: str  # What disturbs the disturbed trajectories, in one sentence
    policy: PendulumPolicy | None = None
    """Drives the live pendulum; without a policy the page has no live pendulum."""
    policy_note: str | None = None  # Which policy that is, in one sentence; None for nothing to say


def make_section(
    robot: Robot | str,
    controllers: Mapping[str, Any] | None = None,
    seed: int = 0,
    progress: StageProgress | None = None,
    entrants: Sequence[str] = SHOWN_CONTROLLERS,
    plant: PlantLike | Domain | None = None,
    boards: Sequence[AbstractBoard | str] = DEFAULT_BOARDS,
    recompute: bool = False,
) -> Section:
    """Score controllers on one robot, and simulate the swing-ups of the built-in ``entrants``: it takes minutes.

    ``progress`` is called with the name of a stage, the number of its finished parts, and of all. A stage is a row
    of a board or a controller's swing-ups; its name begins with the robot's. The plant is what the page shows, and
    the baselines are designed for. ``recompute`` is for rows that the package ships because they take minutes.
    """
    robot, found = get_robot(robot), LEADERBOARD if plant is None else resolve(plant).facts
    shown = entrants_for(robot, controllers or {}, entrants, found, plant is not None)

    def tell(stage: str, done: int, total: int) -> None:
        if progress is not None:
            progress(f"{robot.name}: {one_line(stage)}", done, total)

    tables = leaderboard(robot, controllers, boards, seed, recompute, progress=tell, plant=plant)
    # The shipped policy that sees its plant, here the page's plant, without the parts that a page cannot run.
    alone: dict[str, Any] = dict.fromkeys(PARTS)
    live = None
    with suppress(SwingupError):  # it cannot be told every plant
        live = load_policy(DEFAULT, robot, None if found == LEADERBOARD else found)
        live = replace(live, plant=policy_plant(found, robot), **alone)
    shows, driven = make_shows(shown, robot, seed, found, tell), found.driven(robot)
    note = None if live is None else LIVE_NOTE
    return Section(robot.name, driven, tables, shows, describe_disturbance(seed, driven), live, note)


def trained_section(
    robot: Robot, policies: Mapping[str, PolicyController], progress: StageProgress = lambda *_: None
) -> Section:
    """Score a policy that was trained just now beside known ones, and simulate their swing-ups.

    The first policy drives the live pendulum and enters the board.
    """
    name, policy = next(iter(policies.items()))
    shipped = {each: get_controller(each, robot) for each in SHIPPED_CONTROLLERS}
    # Not as the boards' own entrants, which enter a second time without their estimators.
    (table,) = leaderboard(robot, {name: policy, **shipped}, ("performance",), entrants=(), progress=progress)
    rows = tuple(row for row in table.rows if row.source == OURS or (row.controller, row.source) in PUBLISHED_ROWS)
    tables, plant = [replace(table, rows=rows)], LEADERBOARD.driven(robot)
    shows = make_shows({**policies, **shipped}, robot, 0, LEADERBOARD, progress)
    return Section(robot.name, plant, tables, shows, describe_disturbance(0), policy_of(policy))


def make_shows(
    controllers: Mapping[str, Any], robot: Robot, seed: int, plant: Plant, tell: StageProgress
) -> list[Show]:
    """Simulate several controllers, one after another."""
    shows: list[Show] = []
    for name, controller in controllers.items():
        tell(f"swing-ups of {name}", len(shows), len(controllers))
        shows.append(make_show(name, controller, robot, seed, plant))
    tell("finished", len(shows), len(controllers))
    return shows


def make_show(name: str, controller: Any, robot: Robot, seed: int, plant: Plant = LEADERBOARD) -> Show:
    """Simulate one controller without and with a disturbance; a failed run becomes a note."""
    runs: dict[str, Trajectory] = {}
    notes: dict[str, None] = {}
    disturbed = scaled(DISTURBANCE, scales_of(plant.driven(robot)))
    for run, disturbance in {"undisturbed": None, "disturbed": disturbed}.items():
        try:
            found = judge(controller, robot, seed=seed, name=name, disturbance=disturbance, plant=plant).trajectory
        except SwingupError as error:
            notes[str(error)] = None
        else:
            assert found is not None
            runs[run] = found.take(slice(None, None, THINNING))
    return Show(name, runs, "; ".join(notes) or None)


def describe_disturbance(seed: int, plant: Plant = LEADERBOARD) -> str:
    """The disturbance of the page's disturbed swing-ups in one sentence."""
    found = scaled(DISTURBANCE, scales_of(plant))
    assert found.pushes is not None
    low, high = found.pushes.amplitude
    return (
        f"Disturbed means Gaussian noise on the measured velocities ({found.velocity_noise:.3g} rad/s) and on the "
        f"torque ({found.torque_noise:.3g} N m), and {found.pushes.pushes} random pushes of {low:.3g} to "
        f"{high:.3g} N m on the driven joint (seed {seed}), the same for each controller."
    )


SCRIPTS = ("figure.js", "physics.js", "pendulum.js", "player.js", "live.js", "main.js")
"""The page's scripts in the order of their dependencies."""

PAGE_FORMATS = (".html", *FIGURE_FORMATS)

MAX_SERIES = 8  # Maximum number of controllers in the robustness plot: ours first, then the best published ones


def render_page(
    sections: Sequence[Section], title: str = "Swinging up double pendulums", parts: Sequence[Part] = ()
) -> str:
    """Render a page that shows one or both robots and other parts below them, as the text of one HTML file."""
    names = [section.robot for section in sections]
    if not names or len(set(names)) < len(names):
        raise SwingupError(f"a report of {', '.join(names) or 'no robot'}: give one section for each robot")
    arrays: dict[str, int] = {}
    encoded = [_encode(section, arrays) for section in sections]
    return _render(arrays, encoded, parts, title=title, sections=list(zip(sections, encoded, strict=True)))


def render_log_page(report: LogReport) -> str:
    """Render a report about logs or runs as the text of one HTML file."""
    return _render({}, [], **vars(report))


def save_log_report(report: LogReport, out: str | Path) -> None:
    """Write a report about logs or runs whole or not at all: a page, or its figures as a picture, by the suffix."""
    suffix = check_suffix(out, PAGE_FORMATS)
    if suffix == ".html":
        content = render_log_page(report).encode()
    else:
        figures = {part.title: part.figure for part in report.parts if part.figure is not None}
        content = render(draw(figures, report.title), suffix)
    write_atomically(out, content)


def _render(arrays: dict[str, int], shown: Sequence[Any], parts: Sequence[Part], **texts: Any) -> str:
    figures = [encode(part.figure, arrays) for part in parts]
    found = {"arrays": list(arrays), "sections": shown, "figures": figures}
    content = json.dumps(found, allow_nan=False, separators=(",", ":"))
    # Nothing in a script element may end it.
    for sign in "<\u2028\u2029":
        content = content.replace(sign, f"\\u{ord(sign):04x}")
    return str(
        page_template().render(
            {"sections": [], "parts": parts, "notes": [], "lead": "", "pendulums": True, **texts},
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
        "substeps": stable_substeps(section.plant, LOOP_DT),
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
        if kept.sum() >= MIN_ROWS:
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
    first = sorted(best.values(), key=lambda row: (row.source != OURS, measured.index(row)))[:MAX_SERIES]
    return [row for row in measured if row in first]


def _asset(name: str) -> str:
    return (resources.files(__package__) / "assets" / name).read_text(encoding="utf-8")
