"""Tables of numbers as CSV files: a header line and comma-separated columns, found by name; one is the time."""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from .checks import LARGEST
from .errors import SwingupError
from .files import read_bytes, write_atomically
from .text import quoted

Names = tuple[str, ...]
"""Columns that belong together."""

MINIMUM_ROWS = 3
"""The swing-up time looks at the rows between the first and the last."""

LARGEST_TABLE = 64_000_000
"""Bytes of a file: a minute at 1 kHz with 17 columns has 25 MB."""

UNITS = {
    "time": ("s", "sec", "second", "seconds"),
    "pos": ("rad", "radian", "radians"),
    "vel": ("rad/s", "rad/sec", "rads^-1", "rads-1"),
    "tau": ("N m", "N*m", "N.m", "N·m"),
}
"""Units that a header may name for columns that start so; capitals and spaces do not matter."""

SHORT_NAMES = {
    f"{short}{joint}": f"{long}{joint}"
    for short, long in (("q", "pos_meas"), ("dq", "vel_meas"), ("u", "tau_con"))
    for joint in (1, 2)
}
"""Short names of RealAIGym's columns, for those who name a file's columns."""

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
    path: str | Path, groups: Sequence[Sequence[Names]], optional: Names = (), columns: Sequence[str] = ()
) -> dict[str, np.ndarray]:
    """Read columns in float64, cut to the shortest.

    SI units as in ``time[s]``, spaces, and a byte order mark or ``#`` before the header are accepted.

    Args:
        path: the file.
        groups: what is read, in order: the first complete choice of each group; the first group is the time.
        optional: read as well if all of these are there.
        columns: names for a file that has others, or no header: ``NAME=TITLE``, ``NAME=3`` for the third column,
            or just names for the first columns in their order, with ``_`` for one that is not read.

    Raises:
        SwingupError: the file cannot be read, lacks its header or a column, has a column twice or in another unit,
            fewer than three complete rows, a cell that is not a finite number, a row wider than the header, or a
            time that does not increase; or ``columns`` names a column that the file lacks.
    """
    titles, rows = _read_cells(path, [group[0] for group in groups], headless=bool(columns))
    header = _renamed(path, [_name(title) for title in titles], columns)
    places = {name: header.index(name) for name in _choose_columns(path, header, groups, optional)}
    for name, place in places.items():
        _check_title(path, name, titles[place], header.count(name))
    # A trailing comma is harmless. A decimal comma makes one cell too many.
    for line, cells in rows:
        if any(cells[len(header) :]):
            raise SwingupError(f"{path}, line {line} has more cells than columns: write decimals with a point")
    # RealAIGym also cuts rows to the shortest column.
    rows = rows[: min(_filled(rows, place) for place in places.values())]
    if len(rows) < MINIMUM_ROWS:
        raise SwingupError(f"{path} has {len(rows)} complete rows: at least {MINIMUM_ROWS} are needed")
    table = np.array([[_number(path, row, *item) for item in places.items()] for row in rows])
    stalled = np.flatnonzero(np.diff(table[:, 0]) <= 0)
    if stalled.size:
        (before, after), line = table[stalled[0] :][:2, 0], rows[stalled[0] + 1][0]
        raise SwingupError(f"{path}, line {line}: time {after} comes after {before}: keep one run a file, in order")
    return dict(zip(places, table.T, strict=True))


def _read_cells(path: str | Path, expected: Sequence[Names], headless: bool) -> tuple[list[str], list[_Row]]:
    try:
        # This decoder drops a byte order mark.
        text = read_bytes(path, LARGEST_TABLE).decode("utf-8-sig")
    except FileNotFoundError as error:
        raise SwingupError(f"no such file: {path}") from error
    except OSError as error:
        raise SwingupError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise SwingupError(f"{path} is not text in UTF-8: export the trajectory as CSV") from error
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    rows = [(number, [cell.strip() for cell in line.split(",")]) for number, line in lines]
    if not rows or all(_is_number(cell) for cell in rows[0][1]):
        if rows and headless:
            return [""] * len(rows[0][1]), rows
        names = list(itertools.chain(*expected))
        raise SwingupError(
            f"{path} has no header: its first line must be {','.join(names)}, or name its columns in their order, "
            f"as in --columns {' '.join(names)}"
        )
    return rows[0][1], rows[1:]


def _renamed(path: str | Path, header: list[str], columns: Sequence[str]) -> list[str]:
    """The names of a file's columns, as its user gives them."""
    found = list(header)
    for number, word in enumerate(columns, start=1):
        name, equals, title = word.partition("=")
        title = title if equals else str(number)
        if title in header:
            place = header.index(title)
        elif title.isdecimal() and 1 <= int(title[:9]) <= len(header):
            place = int(title) - 1
        else:
            raise SwingupError(
                f"{path} has no column {quoted(title[:40])}: its {len(header)} columns are "
                f"{', '.join(filter(None, header)) or 'without names'}; write NAME=TITLE, NAME=3 for the third, or "
                "names in the columns' order"
            )
        ours = SHORT_NAMES.get(name, name)
        # A column that had the name so far is another one.
        found = ["" if each == ours else each for each in found]
        found[place] = ours
    return found


def _name(title: str) -> str:
    """The name in a column's title: "# time[s]" and "pos1 (rad)" name the columns time and pos1."""
    return re.split(r"[\[(]", title.lstrip("# "), maxsplit=1)[0].rstrip()


def _check_title(path: str | Path, name: str, title: str, count: int) -> None:
    """Refuse a column that comes twice, or whose title gives another unit than SI's."""
    if count > 1:
        raise SwingupError(f"{path} has {count} columns {name}: keep one of them")
    bracket = re.search(r"[\[(]([^\])]*)", title)
    unit = "" if bracket is None else _plain(bracket[1])
    accepted = next((units for start, units in UNITS.items() if name.startswith(start)), (unit,))
    if unit and unit not in map(_plain, accepted):
        raise SwingupError(f"{path} has {name} in {quoted(unit, 20)}: convert it to {accepted[0]}")


def _plain(unit: str) -> str:
    return re.sub(r"\s", "", unit).lower()


def _choose_columns(
    path: str | Path, header: list[str], groups: Sequence[Sequence[Names]], optional: Names
) -> list[str]:
    # Where no choice is complete, the error names the columns of the nearest one.
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
        raise SwingupError(f"{where}: {quoted(cell[:40])} is not a number: correct it")
    if not math.isfinite(float(cell)):
        raise SwingupError(f"{where}: {cell[:40]} is not finite: correct it or end the file before it")
    if abs(float(cell)) > LARGEST:
        raise SwingupError(f"{where}: {cell[:40]} is too large for a pendulum in SI units: correct it")
    return float(cell)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
