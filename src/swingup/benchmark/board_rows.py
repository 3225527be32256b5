"""Rows of the boards: what they hold, and those that are published or shipped."""

import csv
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources

from ..common.errors import SwingupError
from ..plant.robots import Robot
from .columns import BOARDS

OURS = "ours"
ON_ROBOT = "robot"


@dataclass(frozen=True)
class Row:
    """One controller on a board."""

    controller: str
    source: str
    """``ours`` if computed by this package, ``paper``, ``board`` for the public leaderboard of simulations, or
    ``robot`` for that of runs on the real robot."""
    values: Mapping[str, float | None]
    """By the board's columns; None where nothing could be measured."""
    remark: str | None = None
    """Why a row has failed, or how it was made."""


def published_rows(robot: Robot, measure: str, rules: str) -> list[Row]:
    """The published rows of a board: the paper's tables and the public leaderboards.

    The paper prints 0.0083 N m as the smoothness of the pendubot's iLQR MPC; only 0.083 gives its score.
    """
    text = (resources.files(__package__) / f"published_{measure}.csv").read_text(encoding="utf-8")
    entries = [entry for entry in csv.DictReader(text.splitlines()) if entry["robot"] == robot.name]
    columns = BOARDS[measure]
    return [
        Row(each["controller"], each["source"], {name: float(each[name]) for name in columns})
        for each in entries
        # Most boards were published for one version of the rules only.
        if rules == each.get("rules", {"uptime": "v3"}.get(measure, "v2"))
    ]


def paper_score(robot: Robot) -> float:
    """The score of the paper's policy on the performance board."""
    rows = published_rows(robot, "performance", "v2")
    return next(row.values["score"] or 0.0 for row in rows if (row.controller, row.source) == ("AR-EAPO", "paper"))


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
