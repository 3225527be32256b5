"""The performance board: our controllers' rows beside the published ones."""

import csv
from dataclasses import dataclass
from importlib import resources

from ..physics.parameters import Robot
from .criteria import Criteria
from .evaluate import Evaluation

OURS = "ours"


@dataclass(frozen=True)
class Row:
    """One controller on a robot's performance board."""

    robot: str
    controller: str
    source: str
    """``ours`` if computed here, else where the row was published."""
    criteria: Criteria


def published_performance(robot: Robot) -> list[Row]:
    """The published rows (rules v2): the paper's tables and the public simulation leaderboard.

    The paper prints 0.0083 N m as the smoothness of the pendubot's iLQR MPC; only 0.083 gives its score.
    """
    text = (resources.files(__package__) / "published_performance.csv").read_text(encoding="utf-8")
    rows = []
    for entry in csv.DictReader(text.splitlines()):
        if entry["robot"] == robot.name:
            numbers = {name: float(entry[name]) for name in list(entry)[3:]}
            rows.append(Row(robot.name, entry["controller"], entry["source"], Criteria(success=True, **numbers)))
    return rows


def performance_board(robot: Robot, evaluations: list[Evaluation]) -> list[Row]:
    """All rows of a robot's board, best score first."""
    ours = [Row(robot.name, entry.controller, OURS, entry.criteria) for entry in evaluations]
    return sorted(ours + published_performance(robot), key=lambda row: -row.criteria.score)
