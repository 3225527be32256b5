"""Tables of numbers from files, in SI units: columns found by name, or mapped by their user; one is the time."""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from .checks import LARGEST
from .clock import spread_evenly
from .columns import SHORT_NAMES, Column, parse_columns, suggest_columns, unit_size
from .errors import SwingupError
from .files import write_atomically
from .table_cells import Cells, is_number, read_cells
from .text import quoted

Names = tuple[str, ...]
"""Columns that belong together."""

MINIMUM_ROWS = 3
"""The swing-up time looks at the rows between the first and the last."""
UNIT = re.compile(r"[\[(](?!\d+[\])])([^\])]*)")
"""A unit in brackets at the end of a title; a number in them, as in q[0], belongs to the name."""
EPOCH = 1e6
"""A time beyond this (in its unit) counts from another day: the clock then starts at 0."""


@dataclass(frozen=True)
class Table:
    """Columns of a file."""

    values: dict[str, np.ndarray]
    """By name, in float64 and SI units; missing cells are NaN where they are allowed."""
    sources: Mapping[str, Column]
    """What of the file each column is."""
    unread: Sequence[str]
    """Titles of columns that nobody reads."""
    notes: tuple[str, ...] = ()
    """What was done to rows, one line each."""


def write_columns(path: str | Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns of one length atomically, with enough digits to read the same float64 back.

    Raises:
        SwingupError: the file cannot be written.
    """
    table = np.column_stack([np.asarray(column, np.float64) for column in columns.values()])
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in table.tolist())]
    write_atomically(path, ("\n".join(lines) + "\n").encode())


def read_table(
    path: str | Path,
    groups: Sequence[Sequence[Names]],
    optional: Names = (),
    columns: Sequence[str] = (),
    gaps: bool = False,
) -> Table:
    """Read columns in float64, cut to the shortest.

    A file is text (CSV and its relatives: separators, decimal commas, quotes and comments are found out), or an
    npz, npy or mat file with arrays. Units in a title, as in ``time[ms]``, are converted.

    Args:
        path: the file.
        groups: what is read, in order: the first complete choice of each group; the first group is the time.
        optional: read as well if all of these are there.
        columns: words that map columns (``columns.parse_columns``), for a file that has others, or no header.
        gaps: whether cells may be missing, and times may be in any order.

    Raises:
        SwingupError: the file cannot be read, lacks its header or a column, has a column twice or in an unknown
            unit, fewer than three complete rows, a cell that is not a finite number, a row wider than the header,
            or a time that does not increase; or ``columns`` names a column that the file lacks.
    """
    cells = read_cells(path)
    if cells.headless and not (columns and cells.rows):
        names = list(itertools.chain(*(group[0] for group in groups)))
        raise SwingupError(
            f"{path} has no header: its first line must be {','.join(names)}, or name its columns in their order, "
            f"as in --columns {' '.join(names)}"
        )
    header = [_name(title) for title in cells.titles]
    sources = _sources(path, header, groups, columns)
    chosen = _choose(path, header, sources, groups, optional)
    sources = {name: _with_unit(path, name, sources[name], cells, header) for name in chosen}
    places = {title: _place(title, header) for name in chosen for _, title in sources[name].terms}
    # A trailing comma is harmless. A decimal comma makes one cell too many.
    for line, row in cells.rows:
        if any(row[len(header) :]):
            raise SwingupError(f"{path}, line {line} has more cells than columns: write decimals with a point")
    # RealAIGym also cuts rows to the shortest column.
    rows = cells.rows[: min((_filled(cells.rows, place) for place in places.values()), default=0)]
    if len(rows) < MINIMUM_ROWS:
        raise SwingupError(f"{path} has {len(rows)} complete rows: at least {MINIMUM_ROWS} are needed")
    clock, notes = chosen[0], []
    if not gaps and (late := _without_velocities(rows, sources, places, cells.decimal)):
        notes.append(f"the first {late} rows have no velocity yet: they are left out")
        rows = rows[late:]
    values = {}
    for name in chosen:
        epoch = _epoch(rows[0], sources[name], places, cells.decimal) if name == clock else Decimal(0)
        column = sources[name]
        labels = [name] if len(column.terms) == 1 else [title for _, title in column.terms]
        parts = [
            sign * _numbers(path, rows, places[title], label, cells.decimal, gaps, epoch)
            for label, (sign, title) in zip(labels, column.terms, strict=True)
        ]
        if column.constant or not parts:
            parts.append(np.full(len(rows), column.constant))
        values[name] = sum(parts[1:], parts[0]) * column.size(name)
    if not gaps:
        values[clock], note = _increasing(path, values[clock], [line for line, _ in rows])
        notes += note
    unread = [title for title in header if title not in places and title]
    return Table(values, sources, unread, tuple(notes))


def _sources(
    path: object, header: list[str], groups: Sequence[Sequence[Names]], columns: Sequence[str]
) -> dict[str, Column]:
    """Every column that the file has, by name: as its user maps it, or by its title."""
    mapped = parse_columns(path, columns, header)
    # A title that the user maps to another name has that one alone, unless it is used for its own as well.
    taken = {title for column in mapped.values() for _, title in column.terms if len(column.terms) == 1}
    taken |= {header[int(title[1:]) - 1] for title in taken if re.fullmatch(r"#\d+", title)}
    found = {}
    for title in header:
        if title and title not in taken:
            name = SHORT_NAMES.get(title, title)
            # Beside q0, q1 is the elbow: short names count in pairs.
            ours = name not in header and (title == "t" or {title[:-1] + "1", title[:-1] + "2"} <= set(header))
            found[name if ours else title] = Column(((1, title),))
    found |= mapped
    # What is mapped of a pair goes before other names of the pair, which complete it.
    for group in groups:
        for names in group:
            if set(names) & set(mapped) and not set(names) <= set(found):
                others = next(
                    (other for other in group if set(other) - set(names) and set(other) <= set(found)), ()
                )
                for name, other in zip(names, others, strict=False):
                    found.setdefault(name, found[other])
    return found


def _name(title: str) -> str:
    """The name in a column's title: "# time[s]" and "pos1 (rad)" name the columns time and pos1."""
    return UNIT.split(title.lstrip("# "), maxsplit=1)[0].rstrip()


def _place(title: str, header: list[str]) -> int:
    return int(title[1:]) - 1 if title not in header else header.index(title)


def _with_unit(path: object, name: str, column: Column, cells: Cells, header: list[str]) -> Column:
    """The column with the unit of its title, where its user gives none.

    Raises:
        SwingupError: the title comes twice, or has an unknown unit.
    """
    titles = [title for _, title in column.terms]
    for title in titles:
        if header.count(title) > 1:
            raise SwingupError(f"{path} has {header.count(title)} columns {title}: keep one of them")
    bracket = UNIT.search(cells.titles[_place(titles[0], header)]) if titles else None
    if column.unit or bracket is None:
        return column
    try:
        size = unit_size(name, bracket[1])
    except SwingupError as error:
        raise SwingupError(f"{path} has {error}; convert it, or map it with --columns") from error
    return column if size == 1.0 else Column(column.terms, column.constant, bracket[1])


def _choose(
    path: object,
    header: list[str],
    sources: Mapping[str, Column],
    groups: Sequence[Sequence[Names]],
    optional: Names,
) -> list[str]:
    # Where no choice is complete, the error names the columns of the nearest one.
    best = [min(group, key=lambda names: len(set(names) - set(sources))) for group in groups]
    chosen = [name for names in best for name in names]
    missing = [name for name in chosen if name not in sources]
    if not missing:
        return chosen + (list(optional) if set(optional) <= set(sources) else [])
    used = {
        title for names in best if set(names) <= set(sources) for name in names for _, title in sources[name].terms
    }
    titles = [title for title in header if title and title not in used]
    absent = [name for group, names in zip(groups, best, strict=True) if not names for name in group[0]]
    wanted = [name for names in best if set(names) & set(missing) for name in names]
    # Where a column is not there at all, those of the others are no help.
    found = len(suggest_columns(titles, wanted)) == len(wanted)
    words = " ".join(map(quote_word, suggest_columns(titles, wanted + absent) if found else ()))
    remedy = f"write --columns {words}" if words else "map columns with --columns NAME=TITLE"
    have = quoted(", ".join(filter(None, header)), 200)
    raise SwingupError(
        f"{path} lacks {', '.join(missing)}: {remedy}{', if these are theirs' if words else ''}; it has {have}"
    )


def quote_word(word: str) -> str:
    """A word as a shell reads it."""
    return word if re.fullmatch(r"[\w=+\-:/.,°µ]+", word) else "'" + word.replace("'", "'\\''") + "'"


def _filled(rows: list[tuple[int, list[Any]]], place: int) -> int:
    """Length of a column without its trailing empty cells."""
    return max(
        (k + 1 for k, (_, cells) in enumerate(rows) if cells[place : place + 1] not in ([], [""])), default=0
    )


def _without_velocities(
    rows: list[tuple[int, list[Any]]], sources: Mapping[str, Column], places: Mapping[str, int], decimal: str
) -> int:
    """How many rows at the start have NaN for a velocity: a difference needs a row before."""
    speeds = [places[title] for name in sources if name.startswith("vel") for _, title in sources[name].terms]
    missing = (any(str(row[place]).lower() == "nan" for place in speeds if place < len(row)) for _, row in rows)
    count = sum(1 for _ in itertools.takewhile(bool, missing))
    return count if count <= 2 else 0


def _epoch(row: tuple[int, list[Any]], column: Column, places: Mapping[str, int], decimal: str) -> Decimal:
    """The first time, where it counts from another day."""
    alone = len(column.terms) == 1 and not column.constant
    cell = "".join(map(str, row[1][places[column.terms[0][1]] :][:1])) if alone else ""
    if not is_number(cell, decimal) or not EPOCH < abs(float(cell.replace(decimal, "."))) < math.inf:
        return Decimal(0)
    return Decimal(cell.replace(decimal, "."))


def _numbers(
    path: object, rows: list[tuple[int, list[Any]]], place: int, name: str, decimal: str, gaps: bool, epoch: Decimal
) -> np.ndarray:
    return np.array([_number(path, row, name, place, decimal, gaps, epoch) for row in rows])


def _number(
    path: object, row: tuple[int, list[Any]], name: str, place: int, decimal: str, gaps: bool, epoch: Decimal
) -> float:
    cell = row[1][place] if place < len(row[1]) else ""
    where = f"{path}, line {row[0]}, column {name}"
    if not is_number(cell, decimal):
        if gaps and cell.lower() in ("", "na", "n/a", "null", "none", "-"):
            return math.nan
        remedy = "write seconds" if name == "time" and ":" in cell else "correct it"
        raise SwingupError(f"{where}: {quoted(cell[:40])} is not a number: {remedy}")
    text = str(cell).replace(decimal, ".") if isinstance(cell, str) else cell
    value = float(text)
    if not math.isfinite(value):
        if gaps:
            return math.nan
        raise SwingupError(f"{where}: {str(cell)[:40]} is not finite: correct it or end the file before it")
    if epoch:
        # An exact difference: a double has too few digits for a time since 1970.
        value = float(Decimal(text) - epoch)
    if abs(value) > LARGEST and not (name.startswith("time") and gaps):
        raise SwingupError(f"{where}: {str(cell)[:40]} is too large for a pendulum in SI units: correct it")
    return value


def _increasing(path: object, time: np.ndarray, lines: list[int]) -> tuple[np.ndarray, list[str]]:
    """Times that increase; rows that share a rounded time are spread where their rate is even."""
    stalled = np.flatnonzero(np.diff(time) <= 0)
    if not stalled.size:
        return time, []
    even = spread_evenly(time)
    if even is None:
        (before, after), line = time[stalled[0] :][:2], lines[stalled[0] + 1]
        several = (
            "several rows share a time: write more of its digits" if before == after else "keep one run a file"
        )
        raise SwingupError(f"{path}, line {line}: time {after} comes after {before}: {several}, in order")
    return even, [shared_times(time, even)]


def shared_times(time: np.ndarray, even: np.ndarray) -> str:
    """What is said of times that were spread."""
    share = np.mean(np.diff(time) <= 0)
    return f"{share:.0%} of the rows share a rounded time: they are spread, {np.diff(even).mean():.4g} s apart"
