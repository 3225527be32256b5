"""The tables of boards: rows of our controllers, judged now, beside the published ones."""

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import resources
from typing import Any

from ..common.checks import check_seeds
from ..common.errors import SwingupError
from ..controllers.baselines.baselines import BASELINES
from ..controllers.registry import Controller, controller_on, has_estimator
from ..loop.domain import Domain
from ..loop.resolve import resolve
from ..plant.plant import LEADERBOARD, Plant, PlantLike, Robot, get_robot
from ..policy.shipped import ADAPTIVE, AR_EAPO, GLOBAL
from .board import AbstractBoard, Setting
from .boards import BOARDS, PERFORMANCE, get_board
from .judge import PASSIVE_TORQUE, judge, make_setting
from .runner import StageProgress
from .uptime_board import UptimeBoard

OURS = "ours"
ON_ROBOT = "robot"

ENTRANTS = (AR_EAPO, "tvlqr", "ilqr-riccati", "ilqr-mpc")  # The paper's controllers, by our names
FURTHER_ENTRANTS = (ADAPTIVE, "tvlqr-score")
"""Further controllers of ours that enter every board beside the paper's."""
THROW_ENTRANTS = (GLOBAL,)  # Those that enter only the boards with throws
WITHOUT_ESTIMATOR = " --no-estimator"
"""Ends the name of a shipped policy that enters a second time, without its estimator."""

DEFAULT_BOARDS = ("performance", "robustness")  # The boards of IROS 2024 in simulation, which the paper has
SHIPPED_ROBUSTNESS = ("ilqr-mpc",)
"""Controllers whose robustness takes many minutes: the package ships the output of the command."""


@dataclass(frozen=True)
class Row:
    """One controller in a table."""

    controller: str
    source: str
    """``ours`` if computed by this package, ``paper``, ``board`` for the public leaderboard of simulations, or
    ``robot`` for that of runs on the real robot."""
    values: Mapping[str, float | None]
    """By the board's columns; None where nothing could be measured."""
    remark: str | None = None
    """Why a row has failed, or how it was made."""


@dataclass(frozen=True)
class Table:
    """The controllers on one board, best first."""

    robot: str
    board: str
    columns: tuple[str, ...]
    """Names of the board's values, the score last."""
    seed: int | None
    """The first seed; None where nothing is random."""
    rows: tuple[Row, ...]
    plant: Plant = LEADERBOARD
    note: str | None = None
    """What the board says of itself."""

    def as_dicts(self) -> list[dict[str, Any]]:
        """One flat object a row, ready for JSON."""
        head = {"robot": self.robot, "board": self.board, "seed": self.seed} | self.plant.summary(self.robot)
        names = ("controller", "source", "remark")
        return [head | {name: getattr(row, name) for name in names} | dict(row.values) for row in self.rows]


def leaderboard(
    robot: Robot | str,
    controllers: Mapping[str, Any] | None = None,
    boards: Sequence[AbstractBoard | str] = DEFAULT_BOARDS,
    seed: int = 0,
    recompute: bool = False,
    entrants: Sequence[str] | None = None,
    progress: StageProgress | None = None,
    plant: PlantLike | Domain | None = None,
) -> list[Table]:
    """The tables of some boards, with our rows computed now.

    Args:
        robot: which joint is driven.
        controllers: controllers by name, in JAX or plain Python, that enter beside ours.
        boards: boards or their names.
        seed: of noise, pushes, throws and plants.
        recompute: also compute the rows that the package ships because they take minutes.
        entrants: names of the built-in controllers that enter; None for those of each board.
        progress: called before each row and while it is computed.
        plant: what the controllers are judged on, and the baselines designed for: a plant, its name or its file.
            None for the leaderboards' plant, whose tables alone have published and shipped rows.

    Raises:
        SwingupError: there is no such robot, board or plant, the seed is out of range, or a board draws plants and
            got one. The row of a controller that fails says so.
    """
    robot, seed = get_robot(robot), check_seeds(seed, 1)[0]
    found, tables = LEADERBOARD if plant is None else resolve(plant).facts, []
    for board in map(get_board, boards):
        # Published and shipped rows are those of the board as it is.
        usual = found == LEADERBOARD and BOARDS.get(board.name) == board
        if board.domain is not None and plant is not None:
            raise SwingupError(f"the board {board.name} draws plants from a domain: leave the plant {found} out")
        setting = make_setting(robot, board, found if board.domain is None else None)
        names = default_entrants(board) if entrants is None else entrants
        entered = entrants_for(robot, controllers or {}, names, setting.plant, plant is not None, alone=True)
        rows = published_rows(robot, board.name) if usual else []
        for name, controller in entered.items():
            if board.name == "robustness" and name in SHIPPED_ROBUSTNESS and usual and not recompute:
                rows.append(shipped_robustness(robot, name))
            else:
                rows.append(_row(board, setting, seed, name, controller, progress or (lambda *_: None)))
        ranked = tuple(sorted(rows, key=lambda row: -(row.values["score"] or 0.0)))
        first = seed if board.is_random(setting) else None
        tables.append(Table(robot.name, board.name, board.columns, first, ranked, setting.plant, board.note))
    return tables


def default_entrants(board: AbstractBoard) -> tuple[str, ...]:
    """Names of the built-in controllers on a board."""
    if not isinstance(board, UptimeBoard):
        return (*ENTRANTS, *FURTHER_ENTRANTS)
    if board.cell is None:
        return (*ENTRANTS, *FURTHER_ENTRANTS, *THROW_ENTRANTS)
    return tuple(name for name in ENTRANTS if name in BASELINES)  # the shipped policies were made for C.1


def entrants_for(
    robot: Robot,
    others: Mapping[str, Any],
    names: Sequence[str] = ENTRANTS,
    plant: Plant = LEADERBOARD,
    given: bool = False,
    alone: bool = False,
) -> dict[str, Any]:
    """Built-in controllers on a plant, given or not (:func:`controller_on`), and others by name.

    One that cannot be told the plant enters as it ships. With ``alone`` those with an estimator also without it.
    """
    # Before controllers are made, which takes seconds.
    taken = sorted({*others} & {*names, *(f"{name}{WITHOUT_ESTIMATOR}" for name in names)})
    if taken:
        raise SwingupError(f"controller {taken[0]!r} is on the board already: give yours another name")

    def enter(name: str, estimator: bool | None = None) -> Controller:
        try:
            return controller_on(name, robot, plant, estimator, given)
        except SwingupError:
            return controller_on(name, robot, plant, estimator, given=False)

    ours = {name: enter(name) for name in names}
    twice = [name for name in names if alone and has_estimator(ours[name])]
    return ours | {f"{name}{WITHOUT_ESTIMATOR}": enter(name, False) for name in twice} | dict(others)


def published_rows(robot: Robot, board: str) -> list[Row]:
    """The published rows of a board, if any: the paper's tables and the public leaderboards.

    The paper prints 0.0083 N m as the smoothness of the pendubot's iLQR MPC; only 0.083 gives its score.
    """
    file = resources.files(__package__) / f"published_{board}.csv"
    if not file.is_file():
        return []
    entries = csv.DictReader(file.read_text(encoding="utf-8").splitlines())
    return [
        Row(each["controller"], each["source"], {name: float(each[name]) for name in BOARDS[board].columns})
        for each in entries
        if each["robot"] == robot.name
    ]


def paper_score(robot: Robot) -> float:
    """The score of the paper's policy on the performance board."""
    rows = published_rows(robot, PERFORMANCE.name)
    return next(row.values["score"] or 0.0 for row in rows if (row.controller, row.source) == ("AR-EAPO", "paper"))


def shipped_robustness(robot: Robot, name: str) -> Row:
    """The row of a result of ``swingup evaluate --board robustness --json`` that the package ships."""
    file = resources.files("swingup") / "zoo" / f"{robot.name}-{name}-robustness.json"
    try:
        result = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise SwingupError(f"the package lacks {file}: use --recompute, or install it anew") from error
    made = f"seed {result['seeds'][0]}, version {result['version']}, {result['command']}"
    values = {column: result[column] for column in BOARDS["robustness"].columns}
    return Row(name, OURS, values, f"shipped: {made}; --recompute repeats it")


def _row(
    board: AbstractBoard, setting: Setting, seed: int, name: str, controller: Any, progress: StageProgress
) -> Row:
    tell = partial(progress, f"{name}, {board.name}")
    # Told at once: compilation comes before the first finished simulation.
    tell(0, 1)
    plant = setting.plant if board.domain is None else None
    try:
        result = judge(controller, setting.robot, board, seed=seed, name=name, plant=plant, progress=tell)
    except SwingupError as error:
        # One controller's failure must not cost the others their rows.
        return Row(name, OURS, {**dict.fromkeys(board.columns), "score": 0.0}, str(error))
    remark = None
    if result.faults:
        remark = f"{len(result.faults)} simulations without an answer; the first: {result.faults[0].fault}"
    elif len(result.runs) == 1 and result.runs[0].criteria and not result.successes:
        remark = "no swing-up"
    elif passive := [each for each in result.warnings if each.startswith(PASSIVE_TORQUE)]:
        remark = passive[0]
    return Row(name, OURS, result.values, remark)
