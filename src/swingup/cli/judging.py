"""The commands ``evaluate``, ``score`` and ``leaderboard``."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..benchmark import evaluate as judge
from ..benchmark.criteria import Criteria
from ..benchmark.evaluate import Evaluation
from ..benchmark.leaderboard import OURS, Row, performance_board
from ..benchmark.trajectory_file import load_trajectory, save_trajectory
from ..control.controller import AbstractController
from ..control.learned import load_policy
from ..control.zoo import SHIPPED, shipped_policy
from ..errors import SwingupError
from ..physics.parameters import ROBOTS, Robot, get_robot

COLUMNS = {
    "swingup_time": ("Swing-up time [s]", "Time\n[s]", ".2f"),
    "energy": ("Energy [J]", "Energy\n[J]", ".2f"),
    "torque_cost": ("Torque cost [N²m²]", "Torque\ncost", ".2f"),
    "torque_smoothness": ("Torque smoothness [Nm]", "Smooth-\nness", ".4f"),
    "velocity_cost": ("Velocity cost [m²/s²]", "Velocity\ncost", ".2f"),
    "score": ("RealAI score", "RealAI\nscore", ".3f"),
}
"""The paper's criteria: name with unit, heading of a table's column, format."""


def evaluate(robot: str, controller: str, rules: str, as_json: bool, save: str | None) -> int:
    """Judge a controller by name or policy file."""
    chosen = get_robot(robot)
    result = judge.evaluate(_controller(controller, chosen), chosen, controller, rules)
    if save is not None:
        save_trajectory(save, result.trajectory)
    _print_evaluation(result, rules, as_json)
    return 0


def score(trajectory: str, robot: str, rules: str, as_json: bool) -> int:
    """Judge a trajectory file."""
    chosen = get_robot(robot)
    rows = load_trajectory(trajectory)
    result = Evaluation(chosen.name, Path(trajectory).stem, judge.score(rows, chosen, rules), rows)
    _print_evaluation(result, rules, as_json)
    return 0


def leaderboard(robot: str, as_json: bool) -> int:
    """Print the performance boards of one robot or of all."""
    robots = list(ROBOTS.values()) if robot == "all" else [get_robot(robot)]
    boards = []
    for chosen in robots:
        result = judge.evaluate(shipped_policy(chosen)[0], chosen, SHIPPED)
        boards.append(performance_board(chosen, [result]))
    if as_json:
        print(json.dumps([_flat(row) for board in boards for row in board], indent=2))
        return 0
    for chosen, board in zip(robots, boards, strict=True):
        _print_board(chosen, board)
    return 0


def _controller(name: str, robot: Robot) -> AbstractController[Any]:
    if name == SHIPPED:
        return shipped_policy(robot)[0]
    if not name.endswith(".npz") and not Path(name).exists():
        raise SwingupError(f"unknown controller {name!r}: use {SHIPPED} or the path of a policy file (.npz)")
    return load_policy(name, robot)[0]


def _flat(row: Row) -> dict[str, Any]:
    return {"robot": row.robot, "controller": row.controller, "source": row.source, **asdict(row.criteria)}


def _print_evaluation(result: Evaluation, rules: str, as_json: bool) -> None:
    if as_json:
        print(json.dumps(result.as_dict()))
        return
    print(f"{result.robot}, {result.controller} (rules {rules})")
    print(f"  {'Swing-up':<24}{'success' if result.criteria.success else 'failure':>10}")
    for name, (label, _, _) in COLUMNS.items():
        print(f"  {label:<24}{_cell(result.criteria, name):>10}")


def _print_board(robot: Robot, board: list[Row]) -> None:
    title = f"Performance scores of the {robot.name} (rules v2)"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("Controller", no_wrap=True)
    table.add_column("Source")
    for _, heading, _ in COLUMNS.values():
        table.add_column(escape(heading), justify="right")
    for row in board:
        cells = [_cell(row.criteria, name) for name in COLUMNS]
        table.add_row(row.controller, row.source, *cells, style="bold" if row.source == OURS else "")
    Console().print(table)


def _cell(criteria: Criteria, name: str) -> str:
    value = getattr(criteria, name)
    return "-" if value is None else format(value, COLUMNS[name][2])
