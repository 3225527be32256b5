"""Trajectories as CSV files in RealAIGym's format: a header line and comma-separated columns, found by name.

What the leaderboards score is read and written: time, positions, velocities and torques. Other columns, such as
feedback gains, are ignored.
"""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SwingupError
from ..files import write_atomically
from .rollout import Trajectory

COLUMNS = ("time", "pos_meas1", "pos_meas2", "vel_meas1", "vel_meas2", "tau_con1", "tau_con2")
"""Columns of a written file (s, rad, rad/s, N m)."""

MINIMUM_ROWS = 3
"""The swing-up time looks at the rows between the first and the last."""

_GROUPS = (
    (("time",),),
    (("pos_meas1", "pos_meas2"), ("pos1", "pos2")),
    (("vel_meas1", "vel_meas2"), ("vel1", "vel2")),
    (("tau_con1", "tau_con2"), ("tau1", "tau2")),
)
"""What is read, in order: the first complete choice of each group."""

_Row = tuple[int, list[str]]  # number of the line in the file, from 1, and its cells

LARGEST = 1e9
"""Nothing in a trajectory in SI units comes near this; squares of larger numbers might overflow."""


def save_trajectory(path: str | Path, trajectory: Trajectory) -> None:
    """Write a trajectory atomically, with enough digits to read the same float64 back.

    Raises:
        SwingupError: the file cannot be written.
    """
    parts = (trajectory.time, trajectory.x, trajectory.u)
    table = np.column_stack([np.asarray(part, np.float64) for part in parts])
    lines = [",".join(COLUMNS), *(",".join(map(repr, row)) for row in table.tolist())]
    write_atomically(path, ("\n".join(lines) + "\n").encode())


def load_trajectory(path: str | Path) -> Trajectory:
    """Read a trajectory as NumPy arrays in float64, cut to the shortest of its columns.

    Units as in ``time[s]``, spaces, and a byte order mark or ``#`` before the header are accepted.

    Raises:
        SwingupError: the file cannot be read, lacks its header or a column, has fewer than three complete rows,
            a cell that is not a finite number, a row wider than the header, or a time that does not increase.
    """
    header, rows = _read_table(path)
    places = {name: header.index(name) for name in _choose_columns(path, header)}
    for line, cells in rows:
        if any(cells[len(header) :]):
            raise SwingupError(f"{path}, line {line} has more cells than columns: write decimals with a point")
    rows = rows[: min(_filled(rows, place) for place in places.values())]
    if len(rows) < MINIMUM_ROWS:
        raise SwingupError(f"{path} has {len(rows)} complete rows: at least {MINIMUM_ROWS} are needed")
    table: Any = np.array([[_number(path, row, *item) for item in places.items()] for row in rows])
    stalled = np.flatnonzero(np.diff(table[:, 0]) <= 0)
    if stalled.size:
        (before, after), line = table[stalled[0] :][:2, 0], rows[stalled[0] + 1][0]
        raise SwingupError(f"{path}, line {line}: time {after} comes after {before}: keep one run a file, in order")
    return Trajectory(time=table[:, 0].copy(), x=table[:, 1:5].copy(), u=table[:, 5:].copy())


def _read_table(path: str | Path) -> tuple[list[str], list[_Row]]:
    try:
        text = Path(path).read_bytes().decode("utf-8-sig")
    except FileNotFoundError as error:
        raise SwingupError(f"no such file: {path}") from error
    except OSError as error:
        raise SwingupError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise SwingupError(f"{path} is not text in UTF-8: export the trajectory as CSV") from error
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    rows = [(number, [cell.strip() for cell in line.split(",")]) for number, line in lines]
    if not rows or all(_is_number(cell) for cell in rows[0][1]):
        raise SwingupError(f"{path} has no header: its first line must be {','.join(COLUMNS)}")
    # "# time[s], pos1 [rad]" names the columns time and pos1.
    header = [re.sub(r"\s*[\[(].*", "", name.lstrip("# ")) for name in rows[0][1]]
    return header, rows[1:]


def _choose_columns(path: str | Path, header: list[str]) -> list[str]:
    best = [min(group, key=lambda names: len(set(names) - set(header))) for group in _GROUPS]
    chosen = [name for names in best for name in names]
    missing = [name for name in chosen if name not in header]
    if missing:
        raise SwingupError(f"{path} lacks {', '.join(missing)}: name its comma-separated columns in the first line")
    return chosen


def _filled(rows: list[_Row], place: int) -> int:
    """Length of a column without its trailing empty cells."""
    return max((k + 1 for k, (_, cells) in enumerate(rows) if any(cells[place : place + 1])), default=0)


def _number(path: str | Path, row: _Row, name: str, place: int) -> float:
    cell = "".join(row[1][place : place + 1])
    where = f"{path}, line {row[0]}, column {name}"
    if not _is_number(cell):
        raise SwingupError(f"{where}: {cell[:40]!r} is not a number: correct it")
    if not math.isfinite(float(cell)):
        raise SwingupError(f"{where}: {cell[:40]} is not finite: correct it or end the file before it")
    if abs(float(cell)) > LARGEST:
        raise SwingupError(f"{where}: {cell[:40]} is no number of a pendulum in SI units: correct it")
    return float(cell)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
