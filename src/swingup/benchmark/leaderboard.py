"""The boards: our controllers' rows, computed here, beside the published ones."""

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

from ..control.registry import get_controller, has_estimator
from ..errors import SwingupError
from ..physics.parameters import Robot, get_robot
from ..policy.shipped import AR_EAPO, GLOBAL, REFINED
from .columns import BOARDS, PERFORMANCE
from .evaluate import evaluate
from .robustness import robustness
from .rules import DEFAULT_RULES, PERFORMANCE_RULES, ROBUSTNESS_RULES, UPTIME_RULES
from .uptime import uptime

OURS = "ours"
ENTRANTS = (AR_EAPO, "tvlqr", "ilqr-riccati", "ilqr-mpc")
"""The paper's controllers, by our names."""
FURTHER = (REFINED, "tvlqr-score")
"""Further controllers of ours that enter every board beside the paper's."""
ALONE = " --no-estimator"
"""Ends the name of a shipped policy that enters a second time, without the estimator that it ships with."""

SHIPPED_ROBUSTNESS = ("ilqr-mpc",)
"""Controllers whose robustness takes many minutes: the package ships what its command printed."""


@dataclass(frozen=True)
class Row:
    """One controller on a board."""

    controller: str
    source: str
    """``ours`` if computed by this package, ``paper``, or ``board`` for the public leaderboard."""
    values: Mapping[str, float | None]
    """By the board's columns; None where there is nothing to measure."""
    remark: str | None = None
    """Why a row has failed, or how it was made."""


_Maker = Callable[[Any, Robot, str], Row]


@dataclass(frozen=True)
class Board:
    """One table of controllers, best first."""

    robot: str
    measure: str
    """``performance``, ``robustness`` (criteria in %, overall from 0 to 1) or ``uptime``."""
    rules: str
    seed: int | None
    """Of the noise, pushes or throws; None where nothing is random."""
    rows: tuple[Row, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the criteria, the score last."""
        return BOARDS[self.measure]

    def as_dicts(self) -> list[dict[str, Any]]:
        """One flat object a row, ready for JSON."""
        head = {"robot": self.robot, "measure": self.measure, "rules": self.rules, "seed": self.seed}
        names = ("controller", "source", "remark")
        return [head | {name: getattr(row, name) for name in names} | dict(row.values) for row in self.rows]


def leaderboard(
    robot: Robot | str,
    controllers: Mapping[str, Any] | None = None,
    rules: str = DEFAULT_RULES,
    seed: int = 0,
    recompute: bool = False,
) -> list[Board]:
    """Every board of a version of the rules, with our rows computed now.

    Args:
        robot: which joint is driven.
        controllers: controllers by name, in JAX or plain Python, that enter beside ours.
        rules: ``v2`` (performance and robustness), ``hardware`` (performance) or ``v3`` (uptime).
        seed: of noise, pushes and throws.
        recompute: compute the rows that are shipped because they take long as well.

    Raises:
        SwingupError: there is no such robot or there are no such rules. A controller that fails gets a row that
            says so.
    """
    robot = get_robot(robot)
    makers = _makers(rules, seed, recompute)
    anywhere = (GLOBAL,) if rules in UPTIME_RULES else ()
    entrants = entrants_for(robot, controllers or {}, (*FURTHER, *anywhere), alone=True)
    return [
        _board(robot, measure, rules, None if measure == "performance" else seed, entrants, make_row)
        for measure, make_row in makers.items()
    ]


def entrants_for(
    robot: Robot, others: Mapping[str, Any], extra: Sequence[str] = (), alone: bool = False
) -> dict[str, Any]:
    """The paper's controllers and others, by name.

    Args:
        robot: which joint is driven.
        others: controllers of the user.
        extra: names of built-in controllers that enter beside the paper's.
        alone: whether what ships with an estimator enters a second time without it.

    Raises:
        SwingupError: another controller has a name of ours.
    """
    names = (*ENTRANTS, *extra)
    ours = {name: get_controller(name, robot) for name in names}
    twice = [name for name in names if alone and has_estimator(ours[name])]
    ours |= {f"{name}{ALONE}": get_controller(name, robot, estimator=False) for name in twice}
    taken = sorted(set(others) & set(ours))
    if taken:
        raise SwingupError(f"controller {taken[0]!r} is on the board already: give yours another name")
    return ours | dict(others)


def _makers(rules: str, seed: int, recompute: bool) -> dict[str, _Maker]:
    """What fills a row of each board of a version of the rules."""

    def performance(controller: Any, robot: Robot, name: str) -> Row:
        criteria = evaluate(controller, robot, name, rules).criteria
        remark = None if criteria.success else "no swing-up"
        return Row(name, OURS, {column: getattr(criteria, column) for column in PERFORMANCE}, remark)

    def resilience(controller: Any, robot: Robot, name: str) -> Row:
        if name in SHIPPED_ROBUSTNESS and not recompute:
            return shipped_robustness(robot, name)
        result = robustness(controller, robot, name, rules, seed)
        faults = result.faults
        remark = f"{len(faults)} simulations without an answer; the first: {faults[0].fault}" if faults else None
        return Row(name, OURS, {**result.percent, "overall": result.overall}, remark)

    def thrown(controller: Any, robot: Robot, name: str) -> Row:
        result = uptime(controller, robot, name, rules, seed)
        return Row(name, OURS, {"uptime": result.uptime}, result.faults[0])

    known: dict[str, tuple[Mapping[str, Any], _Maker]] = {
        "performance": (PERFORMANCE_RULES, performance),
        "robustness": (ROBUSTNESS_RULES, resilience),
        "uptime": (UPTIME_RULES, thrown),
    }
    makers = {measure: maker for measure, (versions, maker) in known.items() if rules in versions}
    if not makers:
        names = dict.fromkeys(name for versions, _ in known.values() for name in versions)
        raise SwingupError(f"unknown rules {rules!r}: use one of {', '.join(names)}")
    return makers


def published_rows(robot: Robot, measure: str, rules: str) -> list[Row]:
    """The published rows of a board: the paper's tables and the public leaderboards.

    The paper prints 0.0083 N m as the smoothness of the pendubot's iLQR MPC; only 0.083 gives its score.
    """
    if rules != {"uptime": "v3"}.get(measure, "v2"):
        return []
    text = (resources.files(__package__) / f"published_{measure}.csv").read_text(encoding="utf-8")
    entries = [entry for entry in csv.DictReader(text.splitlines()) if entry["robot"] == robot.name]
    columns = BOARDS[measure]
    return [
        Row(each["controller"], each["source"], {name: float(each[name]) for name in columns}) for each in entries
    ]


def shipped_robustness(robot: Robot, name: str) -> Row:
    """The row of a result of ``swingup robustness --json`` that the package ships."""
    file = resources.files("swingup") / "zoo" / f"{robot.name}-{name}-robustness.json"
    try:
        result = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise SwingupError(f"the package lacks {file}: use --recompute, or install it anew") from error
    remark = (
        f"shipped: seed {result['seed']}, version {result['version']}, {result['command']}; --recompute repeats it"
    )
    return Row(name, OURS, {column: result[column] for column in BOARDS["robustness"]}, remark)


def _board(
    robot: Robot, measure: str, rules: str, seed: int | None, entrants: Mapping[str, Any], make_row: _Maker
) -> Board:
    rows, score = published_rows(robot, measure, rules), BOARDS[measure][-1]
    for name, controller in entrants.items():
        try:
            rows.append(make_row(controller, robot, name))
        except SwingupError as error:
            rows.append(Row(name, OURS, {**dict.fromkeys(BOARDS[measure]), score: 0.0}, str(error)))
    return Board(robot.name, measure, rules, seed, tuple(sorted(rows, key=lambda row: -(row.values[score] or 0.0))))
