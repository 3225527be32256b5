"""Tables of numbers as CSV files: a header line and comma-separated columns, found by name; first the time."""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from .errors import SwingupError
from .files import write_atomically

Names = tuple[str, ...]
"""Columns that belong together."""

MINIMUM_ROWS = 3
"""The swing-up time looks at the rows between the first and the last."""

LARGEST = 1e9
"""Nothing in a trajectory in SI units comes near this; squares of larger numbers might overflow."""

_Row = tuple[int, list[str]]  # number of the line in the file, from 1, and its cells


def write_columns(path: str | Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns of one length atomically, with enough digits to read the same float64 back.

    Raises:
        SwingupError: the file cannot be written.
    """
    table = np.column_stack([np.asarray(column, np.float64) for column in columns.values()])
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in table.tolist())]
    write_atomically(path, ("\n".join(lines) + "\n").encode())


def read_columns(
    path: str | Path, groups: Sequence[Sequence[Names]], optional: Names = ()
) -> dict[str, np.ndarray]:
    """Read columns in float64, cut to the shortest.

    Units as in ``time[s]``, spaces, and a byte order mark or ``#`` before the header are accepted.

    Args:
        path: the file.
        groups: what is read, in order: the first complete choice of each group; the first group is the time.
        optional: read as well if all of these are there.

    Raises:
        SwingupError: the file cannot be read, lacks its header or a column, has fewer than three complete rows,
            a cell that is not a finite number, a row wider than the header, or a time that does not increase.
    """
    header, rows = _read_cells(path, [group[0] for group in groups])
    places = {name: header.index(name) for name in _choose_columns(path, header, groups, optional)}
    for line, cells in rows:
        if any(cells[len(header) :]):
            raise SwingupError(f"{path}, line {line} has more cells than columns: write decimals with a point")
    rows = rows[: min(_filled(rows, place) for place in places.values())]
    if len(rows) < MINIMUM_ROWS:
        raise SwingupError(f"{path} has {len(rows)} complete rows: at least {MINIMUM_ROWS} are needed")
    table = np.array([[_number(path, row, *item) for item in places.items()] for row in rows])
    stalled = np.flatnonzero(np.diff(table[:, 0]) <= 0)
    if stalled.size:
        (before, after), line = table[stalled[0] :][:2, 0], rows[stalled[0] + 1][0]
        raise SwingupError(f"{path}, line {line}: time {after} comes after {before}: keep one run a file, in order")
    return dict(zip(places, table.T, strict=True))


def _read_cells(path: str | Path, expected: Sequence[Names]) -> tuple[list[str], list[_Row]]:
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
        raise SwingupError(f"{path} has no header: its first line must be {','.join(itertools.chain(*expected))}")
    # "# time[s], pos1 [rad]" names the columns time and pos1.
    header = [re.sub(r"\s*[\[(].*", "", name.lstrip("# ")) for name in rows[0][1]]
    return header, rows[1:]


def _choose_columns(
    path: str | Path, header: list[str], groups: Sequence[Sequence[Names]], optional: Names
) -> list[str]:
    best = [min(group, key=lambda names: len(set(names) - set(header))) for group in groups]
    chosen = [name for names in best for name in names]
    missing = [name for name in chosen if name not in header]
    if missing:
        raise SwingupError(f"{path} lacks {', '.join(missing)}: name its comma-separated columns in the first line")
    return chosen + (list(optional) if set(optional) <= set(header) else [])


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
