"""Every board of one controller beside others, by the boards' own functions, for `adaptive.py`."""

import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from swingup.benchmark.judge import judge
from swingup.benchmark.values import Interval
from swingup.loop.resolve import SESSIONS

Measured = tuple[float, Interval | None]
"""A mean, and its 95 % interval if the board has runs that differ."""
Measure = Callable[[Any, str, str], Measured]
"""Of a controller on a robot, with a name for messages."""


def measure(
    controller: Any, robot: str, name: str, board: str, seeds: int = 1, seed: int = 0, domain: str | None = None
) -> Measured:
    """The score of a board; on a simulated robot with a domain of its own the share of successes."""
    found = judge(controller, robot, board, seeds, seed=seed, name=name, domain=domain)
    if board == "sim2real":
        return found.successes / seeds, found.success_interval
    assert found.score is not None
    return found.score, found.interval


BOARDS: dict[str, Measure] = {
    "score": partial(measure, board="performance"),
    "robustness, 5 seeds": partial(measure, board="robustness", seeds=5),
    "uptime, 10 seeds": partial(measure, board="uptime", seeds=10),
    "uptime `icra-real`, 100 draws": partial(measure, board="icra-real", seeds=100),
    "score `iros-real`, 100 draws": partial(measure, board="iros-real", seeds=100),
    # Training and its choices drew none of these.
    "swing-ups on `recorded`, 200 draws": partial(
        measure, board="sim2real", domain="recorded", seed=10000, seeds=200
    ),
    **{
        f"swing-ups on `session-{name}`, 20 seeds": partial(
            measure, board="sim2real", domain=f"session-{name}", seeds=20
        )
        for name in SESSIONS
    },
}


def board_rows(controllers: Mapping[str, Any], robot: str) -> list[dict[str, Any]]:
    """A row for each board and controller; each is also told on the error stream, since all take minutes."""
    rows = []
    for board, measured in BOARDS.items():
        for name, controller in controllers.items():
            mean, interval = measured(controller, robot, name)
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
