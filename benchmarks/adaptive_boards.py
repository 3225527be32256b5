"""Every board of one controller beside others, by the boards' own functions, for `adaptive.py`."""

import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from swingup.benchmark.evaluate import evaluate
from swingup.benchmark.interval import Interval
from swingup.benchmark.robustness import robustness
from swingup.benchmark.sim2real import sim2real
from swingup.benchmark.trials import trials
from swingup.benchmark.uptime import uptime
from swingup.loop.domain import SESSIONS

Measured = tuple[float, Interval | None]
"""A mean, and its 95 % interval if the board has runs that differ."""
Measure = Callable[[Any, str, str], Measured]
"""Of a controller on a robot, with a name for messages."""


def measure_score(controller: Any, robot: str, name: str) -> Measured:
    """The score of the performance board, whose only run has nothing random."""
    return evaluate(controller, robot, name).criteria.score, None


def measure_robustness(controller: Any, robot: str, name: str, seeds: int) -> Measured:
    """The overall robustness."""
    found = robustness(controller, robot, name, seeds=seeds)
    assert found.overall is not None
    return found.overall, found.intervals["overall"]


def measure_uptime(controller: Any, robot: str, name: str, rules: str, seeds: int) -> Measured:
    """The share of time that the tip is up under throws."""
    found = uptime(controller, robot, name, rules, seeds=seeds)
    return found.uptime, found.interval


def measure_swingups(controller: Any, robot: str, name: str, domain: str, seeds: int, seed: int = 0) -> Measured:
    """The share of successes on a simulated robot."""
    found = sim2real(controller, robot, name, domain, seed, seeds)
    return found.successes / seeds, found.interval


def measure_trials(controller: Any, robot: str, name: str, rules: str, seeds: int) -> Measured:
    """The mean score of trials by a real robot's rules."""
    found = trials(controller, robot, name, rules, seeds=seeds)
    return found.score, found.interval


BOARDS: dict[str, Measure] = {
    "score": measure_score,
    "robustness, 5 seeds": partial(measure_robustness, seeds=5),
    "uptime `v3`, 10 seeds": partial(measure_uptime, rules="v3", seeds=10),
    "uptime `icra-real`, 100 draws": partial(measure_uptime, rules="icra-real", seeds=100),
    "score `iros-real`, 100 draws": partial(measure_trials, rules="iros-real", seeds=100),
    # Training and its choices drew none of these.
    "swing-ups on `recorded`, 200 draws": partial(measure_swingups, domain="recorded", seed=10000, seeds=200),
    **{
        f"swing-ups on `session-{name}`, 20 seeds": partial(measure_swingups, domain=f"session-{name}", seeds=20)
        for name in SESSIONS
    },
}


def board_rows(controllers: Mapping[str, Any], robot: str) -> list[dict[str, Any]]:
    """A row for each board and controller; each is also told on the error stream, since all take minutes."""
    rows = []
    for board, measure in BOARDS.items():
        for name, controller in controllers.items():
            mean, interval = measure(controller, robot, name)
            rows.append({"board": board, "controller": name, "mean": mean, "interval": interval})
            print(f"{board}, {name}: {_cell(rows[-1])}", file=sys.stderr, flush=True)
    return rows


def board_lines(rows: list[dict[str, Any]]) -> list[list[str]]:
    """A line for each board with a cell for each controller."""
    names = dict.fromkeys(row["controller"] for row in rows)
    cells = {(row["board"], row["controller"]): _cell(row) for row in rows}
    return [
        [board, *(cells[board, name] for name in names)] for board in dict.fromkeys(row["board"] for row in rows)
    ]


def _cell(row: dict[str, Any]) -> str:
    mean = f"{row['mean']:.3f}"
    return mean if row["interval"] is None else "{} ({:.3f} to {:.3f})".format(mean, *row["interval"])
