"""Tables of numbers from files, in SI units: columns found by name, or mapped by their user; one is the time."""

import itertools
import math
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from .checks import LARGEST_NUMBER
from .columns import SHORT_NAMES, Column, parse_columns, suggest_columns, unit_size
from .errors import SwingupError, quoted
from .files import write_atomically
from .table_cells import Cells, Row, is_number, read_cells

Names = tuple[str, ...]
"""Columns that belong together."""

MINIMUM_ROWS = 3
"""The swing-up time looks at the rows between the first and the last."""
EPOCH = 1e6
"""A time beyond this (in its unit) counts from another day: the clock then starts at 0."""
LEAST_TIMES = 20
"""Steps of a rounded time that show the rate of rows: after n of them it may be off by 1/n²."""
LEAST_SHARE = 0.2
"""Share of rows that repeat a time from which times are rounded; fewer are faults."""


@dataclass(frozen=True)
class Table:
    """Columns of a file."""

    values: dict[str, np.ndarray]
    """By name, in float64 and SI units; missing cells are NaN where they are allowed."""
    sources: Mapping[str, Column]
    """What of the file each column is."""
    unread: Sequence[str]
    """Titles of columns that nobody reads."""


def write_columns(path: str | Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns of one length atomically, with enough digits to read the same float64 back."""
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
    """Read columns in float64: the first complete choice of each group, the time first.

    A file is text (CSV and its relatives: separators, decimal commas, quotes and comments are found out), or an
    npz, npy or mat file with arrays. Units in a title, as in ``time[ms]``, are converted. Optional columns are read
    if all are there. ``columns`` map names (``columns.parse_columns``). All are cut to the shortest; with ``gaps``
    cells may be missing instead, columns without any are as if not there, and times may be in any order.
    """
    cells = read_cells(path)
    if not any(cells.titles) and not (columns and cells.rows):
        names = list(itertools.chain(*(group[0] for group in groups)))
        raise SwingupError(
            f"{path} has no header: its first line must be {','.join(names)}, or name its columns in their order, "
            f"as in --columns {' '.join(names)}"
        )
    header = [name if not gaps or _filled(cells, f"#{place}") else "" for place, name in enumerate(cells.names, 1)]
    sources = _sources(path, header, groups, columns)
    chosen = _choose(path, header, sources, groups, optional)
    sources = {name: _with_unit(path, name, sources[name], cells) for name in chosen}
    titles = dict.fromkeys(title for column in sources.values() for _, title in column.terms)
    # A trailing comma is harmless. A decimal comma makes one cell too many.
    for line, row in cells.rows:
        if any(row[len(header) :]):
            raise SwingupError(f"{path}, line {line} has more cells than columns: write decimals with a point")
    # RealAIGym also cuts rows to the shortest column.
    rows = cells.rows if gaps else cells.rows[: min((_filled(cells, title) for title in titles), default=0)]
    if len(rows) < MINIMUM_ROWS:
        raise SwingupError(f"{path} has {len(rows)} complete rows: at least {MINIMUM_ROWS} are needed")
    if not gaps:
        rows = rows[_without_velocities(cells, rows, sources) :]
    clock, values = chosen[0], {}
    for name, column in sources.items():
        epoch = _epoch(cells, rows[:1], column) if name == clock else Decimal(0)
        parts = [np.full(len(rows), column.constant)] if column.constant or not column.terms else []
        for factor, title in column.terms:
            label = name if len(column.terms) == 1 or name == clock else title
            given = zip(rows, cells.column(title, rows), strict=True)
            numbers = [_number(f"{path}, line {row[0]}", cells, cell, label, gaps, epoch) for row, cell in given]
            parts.append(factor * np.array(numbers))
        # Without a first zero, to which -0.0 would be added.
        values[name] = sum(parts[1:], parts[0]) * unit_size(name, column.unit)
    if not gaps:
        values[clock] = _increasing(path, values[clock], [line for line, _ in rows])
    places = {cells.place(title) for title in titles}
    unread = [title for place, title in enumerate(header) if place not in places and title]
    return Table(values, sources, unread)


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


def _with_unit(path: object, name: str, column: Column, cells: Cells) -> Column:
    """The column with the unit of its title, where its user gives none."""
    titles = [title for _, title in column.terms]
    for title in titles:
        if (count := cells.names.count(title)) > 1:
            raise SwingupError(f"{path} has {count} columns {title}: keep one of them")
    units = list(dict.fromkeys(map(cells.unit, titles)))
    if column.unit or not any(units):
        return column
    try:
        if len(units) > 1:
            raise SwingupError(f"{name} from columns in {' and '.join(unit or 'no unit' for unit in units)}")
        size = unit_size(name, units[0])
    except SwingupError as error:
        raise SwingupError(f"{path} has {error}; convert it, or map it with --columns") from error
    return column if size == 1.0 else Column(column.terms, column.constant, units[0])


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
    # Where a column is not there at all, those of the others do not help.
    found = len(suggest_columns(titles, wanted)) == len(wanted)
    words = shlex.join(suggest_columns(titles, wanted + absent) if found else ())
    remedy = f"write --columns {words}" if words else "map columns with --columns NAME=TITLE"
    have = quoted(", ".join(filter(None, header)), 200)
    raise SwingupError(
        f"{path} lacks {', '.join(missing)}: {remedy}{', if these are theirs' if words else ''}; it has {have}"
    )


def _filled(cells: Cells, title: str) -> int:
    """Length of a column without its trailing empty cells."""
    return max((k + 1 for k, cell in enumerate(cells.column(title, cells.rows)) if cell != ""), default=0)


def _without_velocities(cells: Cells, rows: Sequence[Row], sources: Mapping[str, Column]) -> int:
    """How many rows at the start have NaN for a velocity: a difference needs a row before."""
    speeds = [title for name in sources if name.startswith("vel") for _, title in sources[name].terms]
    columns = [cells.column(title, rows[:3]) for title in speeds]
    missing = (any(str(cell).lower() == "nan" for cell in row) for row in zip(*columns, strict=True))
    count = sum(1 for _ in itertools.takewhile(bool, missing))
    return count if count <= 2 else 0


def _epoch(cells: Cells, rows: Sequence[Row], column: Column) -> Decimal:
    """The first time, where it counts from another day."""
    alone = len(column.terms) == 1 and not column.constant
    cell = cells.plain(cells.column(column.terms[0][1], rows)[0]) if alone else ""
    return Decimal(cell) if is_number(cell) and EPOCH < abs(float(cell)) < math.inf else Decimal(0)


def _number(where: str, cells: Cells, cell: Any, label: str, gaps: bool, epoch: Decimal) -> float:
    """A cell's number; NaN where it is missing and may be."""
    where, text = f"{where}, column {label}", cells.plain(cell)
    if not is_number(text):
        if gaps and cell.lower() in ("", "na", "n/a", "null", "none", "-"):
            return math.nan
        remedy = "write seconds" if label == "time" and ":" in cell else "correct it"
        raise SwingupError(f"{where}: {quoted(cell[:40])} is not a number: {remedy}")
    value = float(text)
    if not math.isfinite(value):
        if gaps:
            return math.nan
        raise SwingupError(f"{where}: {str(cell)[:40]} is not finite: correct it or end the file before it")
    if epoch:
        # An exact difference: a double has too few digits for a time since 1970.
        value = float(Decimal(text) - epoch)
    if abs(value) > LARGEST_NUMBER and not (label.startswith("time") and gaps):
        raise SwingupError(f"{where}: {str(cell)[:40]} is too large for a pendulum in SI units: correct it")
    return value


def _increasing(path: object, time: np.ndarray, lines: list[int]) -> np.ndarray:
    """Times that increase; rows that share a rounded time are spread where their rate is even."""
    stalled = np.flatnonzero(np.diff(time) <= 0)
    if not stalled.size:
        return time
    even = spread_evenly(time)
    if even is None:
        (before, after), line = time[stalled[0] :][:2], lines[stalled[0] + 1]
        several = (
            "several rows share a time: write more of its digits" if before == after else "keep one run a file"
        )
        raise SwingupError(f"{path}, line {line}: time {after} comes after {before}: {several}, in order")
    return even


def spread_evenly(time: Float[np.ndarray, "rows"]) -> Float[np.ndarray, "rows"] | None:
    """Even times for rows whose times were rounded so far that several share one; None if they are not that."""
    steps = np.diff(time)
    if np.count_nonzero(steps) < LEAST_TIMES or np.any(steps < 0) or np.mean(steps == 0) < LEAST_SHARE:
        return None
    rows, resolution = np.arange(len(time)), float(np.median(steps[steps > 0]))
    even = np.polyval(np.polyfit(rows, time, 1), rows)
    if np.abs(even - time).max() > 1.01 * resolution:
        return None
    return np.asarray(even - even[0] + time[0])
