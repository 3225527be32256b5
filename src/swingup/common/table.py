"""Tables of numbers from files, in SI units: columns found by name, or mapped by their user; one is the time.

A file is text, whose separator, decimal sign, comments, header and units are found out, or holds arrays
(``array_files``) or ROS's messages (``bag_files``).
"""

import codecs
import csv
import itertools
import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from .array_files import ARRAY_FILES, read_arrays
from .bag_files import is_bag, read_bag
from .checks import LARGEST_NUMBER
from .columns import (
    SHORT,
    SHORT_NAMES,
    UNITS,
    MappedColumn,
    completed,
    is_unit,
    parse_columns,
    suggest_columns,
    unit_size,
)
from .errors import SwingupError, one_line, quoted
from .expressions import Expression
from .files import read_bytes, write_atomically

Names = tuple[str, ...]  # columns that belong together

SI_UNITS = ("", *(next(iter(units)) for units in UNITS.values()))
MINIMUM_ROWS = 3  # the swing-up time looks at the rows between the first and the last
EPOCH = 1e6  # A time beyond this (in its unit) counts from another day: the clock then starts at 0
NANOSECONDS = 1e17  # A time beyond this counts nanoseconds since 1970: in microseconds it would be 3,000 years
MINIMUM_STEPS = 20  # steps of a rounded time that show the rate of rows: after n of them it may be off by 1/n²
REPEATED_SHARE = 0.2  # share of rows that repeat a time from which times are rounded; fewer are faults
LARGEST_TABLE = 64_000_000  # bytes of a file: a minute at 1 kHz with 17 columns has 25 MB
SEPARATORS = (",", ";", "\t", " ", "|")
COMMENTS = ("#", "%", "//")
MISSING = ("", "na", "n/a", "#n/a", "null", "nil", "none", "-", "--", "?")
SAMPLE_ROWS = 20  # rows that show the separator
BRACKET = re.compile(r"[\[(](?!\d+[\])])([^\])]*)")
"""A unit in brackets at the end of a title; a number in them, as in q[0], belongs to the name."""


@dataclass(frozen=True)
class Table:
    """Columns of a file."""

    values: dict[str, np.ndarray]
    """By name, in float64 and SI units; missing cells are NaN where they are allowed."""
    sources: Mapping[str, MappedColumn]
    """What of the file each column is."""
    unread: Sequence[str]
    """Titles of columns that nobody reads."""


def write_columns(path: str | Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns of one length atomically, with enough digits to read the same float64 back."""
    table = np.column_stack([np.asarray(column, np.float64) for column in columns.values()])
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in table.tolist())]
    write_atomically(path, ("\n".join(lines) + "\n").encode())


def read_table(
    path: str | Path, groups: Sequence[Sequence[Names]], columns: Sequence[str] = (), gaps: bool = False
) -> Table:
    """Read columns in float64: the first complete choice of each group, the time first.

    Units in a title, as in ``time[ms]``, are converted. ``columns`` map names (``parse_columns``). Columns are
    cut to the shortest; with ``gaps`` cells may be missing instead, columns without any are as if not there, and
    times may be in any order.
    """
    cells = _read_cells(path)
    if not any(cells.names) and not (columns and cells.lines):
        names = list(itertools.chain(*(group[0] for group in groups)))
        raise SwingupError(
            f"{path} has no header: its first line must be {','.join(names)}, or name its columns in their order, "
            f"as in --columns {' '.join(names)}"
        )
    if not cells.lines:
        raise SwingupError(f"{path} has titles and no rows of numbers below them")
    titles = [
        name if not gaps or _filled(column) else "" for name, column in zip(cells.names, cells.columns, strict=True)
    ]
    mapped = parse_columns(path, columns, titles)
    known = dict.fromkeys(name for group in groups for names in group for name in names)
    if unknown := [name for name in mapped if name not in known]:
        shown = ", ".join(SHORT.get(name, name) for name in known)
        raise SwingupError(
            f"{path}: --columns maps {quoted(unknown[0])}, which nobody reads: the names are {shown}"
        )
    sources = _find_sources(titles, groups, mapped)
    chosen = _choose(path, cells, titles, sources, groups, columns)
    _check_read(path, mapped, chosen, groups)
    sources = {name: _with_unit(path, name, sources[name], cells) for name in chosen}
    used = {cells.place(title) for column in sources.values() for title in column.expression.titles}
    if cells.surplus:
        # A trailing comma is harmless. A decimal comma makes one cell too many.
        raise SwingupError(
            f"{path}, line {cells.surplus} has more cells than the {len(titles)} titles: write decimals "
            "with a point, and a title for each column"
        )
    # RealAIGym also cuts rows to the shortest column.
    count = len(cells.lines) if gaps else min((_filled(cells.columns[place]) for place in used), default=0)
    if count < MINIMUM_ROWS:
        raise SwingupError(f"{path} has {count} complete rows: at least {MINIMUM_ROWS} are needed")
    cells = cells.rows(0 if gaps else _without_velocities(cells, sources), count)
    values = {name: _values(path, name, column, cells, name == chosen[0], gaps) for name, column in sources.items()}
    if not gaps:
        values[chosen[0]] = _increasing(path, values[chosen[0]], cells.lines)
    return Table(values, sources, [title for place, title in enumerate(titles) if place not in used and title])


@dataclass(frozen=True)
class _Cells:
    """A file's table before its columns are chosen."""

    names: list[str]  # of the columns, without units; empty where there is no header
    units: list[str]  # as the titles have them in brackets, or empty
    columns: list[list[Any]]  # texts, or an array's numbers; empty texts where a row ends early
    lines: Sequence[int]  # number of each row's line in the file, from 1
    surplus: int = 0  # the first line with more cells than there are columns; 0 if there is none
    unread: str = ""  # what of the file is not read, with a remedy

    def place(self, title: str) -> int:
        """The place of a column, by its name or as #3."""
        return self.names.index(title) if title in self.names else int(title[1:]) - 1

    def rows(self, first: int, end: int) -> "_Cells":
        return replace(self, columns=[each[first:end] for each in self.columns], lines=self.lines[first:end])


def _with_titles(titles: Sequence[str], columns: list[list[Any]], lines: Sequence[int], surplus: int = 0) -> _Cells:
    """Cells below titles: "time[s]" and "pos1 (rad)" name the columns time and pos1.

    What brackets alone tell apart, as in "Position (elbow)", belongs to the name.
    """
    names = [BRACKET.split(title, maxsplit=1)[0].rstrip() for title in titles]
    units = [found[1] if (found := BRACKET.search(title)) else "" for title in titles]
    counts = Counter(names)
    for place, (title, name) in enumerate(zip(titles, names, strict=True)):
        if counts[name] > 1 and not is_unit(units[place]):
            names[place], units[place] = title, ""
    return _Cells(names, units, columns, lines, surplus)


def _number(cell: Any) -> float | None:
    """A cell's number, which may be NaN or infinite; None if it has none."""
    try:
        return float(cell)
    except ValueError:
        return None


def _decimal(cell: Any) -> Decimal:
    """A cell's number to its last digit; NumPy's longest floats are neither texts nor Python's numbers."""
    try:
        return Decimal(cell if isinstance(cell, str | float) else str(cell))
    except ArithmeticError:  # an exponent that a float ends with 0 or infinity
        return Decimal(float(cell))


def _filled(column: Sequence[Any]) -> int:
    """Length of a column without its trailing empty cells."""
    return next((len(column) - k for k, cell in enumerate(reversed(column)) if cell != ""), 0)


# The columns that are read.


def _find_sources(
    titles: list[str], groups: Sequence[Sequence[Names]], mapped: Mapping[str, MappedColumn]
) -> dict[str, MappedColumn]:
    """Every column that the file has, by name: as its user maps it, or by its title."""
    # A title that the user maps to another name has that one alone, unless it is used for its own as well.
    single = [terms[0][1] for column in mapped.values() if len(terms := column.expression.terms) == 1]
    taken = {title for title in single if isinstance(title, str)}
    taken |= {titles[int(title[1:]) - 1] for title in taken if re.fullmatch(r"#\d+", title)}
    found = {}
    for title in titles:
        if title and title not in taken:
            name = SHORT_NAMES.get(title, title)
            # Beside q0, q1 is the elbow: short names count in pairs.
            ours = name not in titles and (title == "t" or {title[:-1] + "1", title[:-1] + "2"} <= set(titles))
            found[name if ours else title] = MappedColumn(Expression(((1, title),)))
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


def _check_read(
    path: object, mapped: Collection[str], chosen: Sequence[str], groups: Sequence[Sequence[Names]]
) -> None:
    """Refuse names that the user maps in vain: another choice of their group is read."""
    for name in mapped:
        if name not in chosen:
            pair = next(names for group in groups for names in group if name in names)
            others = [SHORT.get(each, each) for each in pair if each not in mapped]
            remedy = "leave it out"
            if others:
                # Without the rate of either joint, angles' differences are read.
                lacking = remedy if name.startswith("vel") else f"{others[0]}=0"
                remedy = f"map {others[0]} as well, or {lacking} if that joint has none"
            raise SwingupError(f"{path}: --columns maps {SHORT.get(name, name)}, which is not read: {remedy}")


def _labels(cells: "_Cells") -> dict[str, str]:
    """Names of joints by title, where the rows say them: name0 is that of position0, as in ROS's joint states."""
    found = dict[str, str]()
    for title, column in zip(cells.names, cells.columns, strict=True):
        parts = re.fullmatch(r"(.*)name(\D?\d+\D?)", title)
        if parts and len(texts := {str(cell) for cell in column}) == 1 and _number(text := texts.pop()) is None:
            ours = (each for each in cells.names if each.startswith(parts[1]) and each.endswith(parts[2]))
            found |= dict.fromkeys(ours, text)
    return found


def _choose(
    path: object,
    cells: "_Cells",
    titles: list[str],
    sources: Mapping[str, MappedColumn],
    groups: Sequence[Sequence[Names]],
    given: Sequence[str],
) -> list[str]:
    """The names that are read; where no choice is complete, the error names the nearest one's columns."""
    best = [min(group, key=lambda names: len(set(names) - set(sources))) for group in groups]
    chosen = [name for names in best for name in names]
    missing = [name for name in chosen if name not in sources]
    if not missing:
        return chosen
    complete = [name for names in best if set(names) <= set(sources) for name in names]
    used = {title for name in complete for title in sources[name].expression.titles}
    free = [title for title in titles if title and title not in used]
    # Other people's titles suggest the names of a group's first choice.
    wanted = [
        name for group, names in zip(groups, best, strict=True) if set(names) & set(missing) for name in group[0]
    ]
    absent = [name for group, names in zip(groups, best, strict=True) if not names for name in group[0]]
    # Where a column is not there at all, those of the others do not help.
    labels = _labels(cells)
    found = len(suggest_columns(free, wanted, labels)) == len(wanted)
    words = completed(suggest_columns(free, wanted + absent, labels), given) if found else ""
    remedy = (
        f"write --columns {words}, if these are theirs"
        if words
        else "map columns with --columns NAME=TITLE, or q1=x#3 of a matrix x, and rows without a time as time=0.02"
    )
    have = one_line(", ".join(filter(None, titles)), 200)
    raise SwingupError(f"{path} lacks {', '.join(missing)}: {remedy}; it has {have}{cells.unread}")


def _with_unit(path: object, name: str, column: MappedColumn, cells: _Cells) -> MappedColumn:
    """The column with the unit of its title, where its user gives none."""
    for title in column.expression.titles:
        if (count := cells.names.count(title)) > 1:
            raise SwingupError(f"{path} has {count} columns {title}: keep one of them")
    found = dict.fromkeys(cells.units[cells.place(title)] for title in column.expression.titles)
    # A factor may be a gain, as of rad in N m, and a function's result has a unit of its own.
    units = [unit for unit in found if column.expression.is_plain or unit not in SI_UNITS]
    if name == "time" and not column.unit and abs(_epoch(cells, column)) >= NANOSECONDS:
        return replace(column, unit="ns")
    if column.unit or not any(units):
        return column
    try:
        if len(units) > 1:
            raise SwingupError(f"{name} from columns in {' and '.join(unit or 'no unit' for unit in units)}")
        size = unit_size(name, units[0])
    except SwingupError as error:
        raise SwingupError(f"{path} has {error}; convert it, or map it with --columns") from error
    return column if size == 1.0 else replace(column, unit=units[0])


# Their numbers.


def _values(
    path: object, name: str, column: MappedColumn, cells: _Cells, is_time: bool, gaps: bool
) -> Float[np.ndarray, "rows"]:
    """A column's numbers in SI units."""
    epoch = _epoch(cells, column) if is_time else Decimal(0)

    def read(title: str) -> np.ndarray:
        label, numbers = name if len(column.expression.titles) == 1 or is_time else title, []
        for line, cell in zip(cells.lines, cells.columns[cells.place(title)], strict=True):
            try:
                numbers.append(_checked(cell, label == "time", gaps, epoch))
            except SwingupError as error:
                raise SwingupError(f"{path}, line {line}, column {label}: {error}") from error
        return np.array(numbers)

    values = column.expression.evaluate(read, len(cells.lines)) * unit_size(name, column.unit)
    if is_time and not column.expression.terms:  # a period
        values = values * np.arange(len(values))
    if not is_time and (largest := float(np.max(np.abs(np.nan_to_num(values)), initial=0.0))) > LARGEST_NUMBER:
        raise SwingupError(
            f"{path}: {column.word(name)} reaches {largest:.3g} in SI units, too large for a pendulum: correct its "
            "factor or unit"
        )
    return values


def _epoch(cells: _Cells, column: MappedColumn) -> Decimal:
    """The first time, where it counts from another day."""
    titles = column.expression.titles
    if not titles or column.expression != Expression(((column.expression.terms[0][0], titles[0]),)):
        return Decimal(0)
    cell = cells.columns[cells.place(titles[0])][0]
    number = _number(cell)
    return _decimal(cell) if number is not None and EPOCH < abs(number) < math.inf else Decimal(0)


def _checked(cell: Any, is_time: bool, gaps: bool, epoch: Decimal) -> float:
    """A cell's number; NaN where it is missing and may be."""
    value = _number(cell)
    if value is None:
        if gaps and cell.lower() in MISSING:
            return math.nan
        remedy = "write seconds" if is_time and ":" in cell else "correct it"
        raise SwingupError(f"{quoted(cell[:40])} is not a number: {remedy}")
    if not math.isfinite(value):
        if gaps:
            return math.nan
        raise SwingupError(f"{str(cell)[:40]} is not finite: correct it or end the file before it")
    if epoch:
        # An exact difference: a double has too few digits for a time since 1970.
        value = float(_decimal(cell) - epoch)
    if abs(value) > LARGEST_NUMBER and not (is_time and gaps):
        raise SwingupError(f"{str(cell)[:40]} is too large for a pendulum in SI units: correct it")
    return value


def _without_velocities(cells: _Cells, sources: Mapping[str, MappedColumn]) -> int:
    """How many rows at the start have NaN for a velocity: a difference needs a row before."""
    speeds = [title for name in sources if name.startswith("vel") for title in sources[name].expression.titles]
    columns = [cells.columns[cells.place(title)][:MINIMUM_ROWS] for title in speeds]
    missing = [any(str(cell).lower() == "nan" for cell in row) for row in zip(*columns, strict=True)]
    count = [*missing, False].index(False)
    return count if count < MINIMUM_ROWS else 0


def _increasing(path: object, time: np.ndarray, lines: Sequence[int]) -> np.ndarray:
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
    if np.count_nonzero(steps) < MINIMUM_STEPS or np.any(steps < 0) or np.mean(steps == 0) < REPEATED_SHARE:
        return None
    rows, resolution = np.arange(len(time)), float(np.median(steps[steps > 0]))
    even = np.polyval(np.polyfit(rows, time, 1), rows)
    if np.abs(even - time).max() > 1.01 * resolution:
        return None
    return np.asarray(even - even[0] + time[0])


# Cells of text.


def _read_cells(path: str | Path) -> _Cells:
    if is_bag(path):
        bag = read_bag(path)
        # A simulated clock begins at 0: its nanoseconds do not show that they are some.
        titles = [f"{title} [ns]" if title == "time" else title for title in bag]
        return _with_titles(titles, list(bag.values()), range(1, len(bag["time"]) + 1))
    content = read_bytes(path, LARGEST_TABLE)
    if Path(path).suffix.lower() in ARRAY_FILES:
        arrays, unread = read_arrays(path, content)
        count = max(map(len, arrays.values()))
        # Integers stay integers: a float would lose digits of a time in nanoseconds.
        columns = [column.tolist() + [""] * (count - len(column)) for column in arrays.values()]
        return replace(_with_titles(list(arrays), columns, range(1, count + 1)), unread=unread)
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    for encoding in ("utf-16",) if wide else ("utf-8-sig", "latin-1"):
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        # JSON is text, and no table either.
        if not re.match(r"\s*(\{|\[\s*[\[{])", text) and not re.search(r"[\x00-\x08\x0e-\x1f]", text):
            return _text_cells(text)
    raise SwingupError(f"{path} is not a table in text: export the log as CSV, npz or mat")


def _text_cells(text: str) -> _Cells:
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    separator, decimal = _find_separator([line for _, line in lines if not line.lstrip().startswith(COMMENTS)])
    split = [[cell.replace(decimal, ".") for cell in _split(line, separator)] for _, line in lines]
    # Facts of the recording may stand above the table, whose rows are as wide as most in the second half.
    widths = Counter(map(len, split[len(split) // 2 :])).most_common(1)

    def is_row(cells: list[str]) -> bool:
        numbers = sum(_number(cell) is not None for cell in cells)
        return len(cells) >= widths[0][0] and any(cells) and 2 * numbers >= sum(map(bool, cells))

    first = next((k for k, cells in enumerate(split) if is_row(cells)), len(split))
    rows = [
        (number, cells)
        for (number, line), cells in zip(lines[first:], split[first:], strict=True)
        if not line.lstrip(' "').startswith(COMMENTS)
    ]
    width = len(rows[0][1]) if rows else 0
    titles = _find_titles([line for _, line in lines[:first]], separator, width) or [""] * width
    columns = [[cells[place] if place < len(cells) else "" for _, cells in rows] for place in range(len(titles))]
    surplus = next((number for number, cells in rows if any(cells[len(titles) :])), 0)
    return _with_titles(titles, columns, [number for number, _ in rows], surplus)


def _find_separator(lines: list[str]) -> tuple[str, str]:
    """The separator and the decimal sign with which the most cells are numbers."""
    sample = lines[len(lines) // 2 :][:SAMPLE_ROWS]

    def numbers(pair: tuple[str, str]) -> int:
        rows = [_split(line, pair[0]) for line in sample]
        return sum(_number(cell.replace(pair[1], ".")) is not None for row in rows if len(row) > 1 for cell in row)

    # A decimal comma may stand between commas where numbers are in quotes.
    quotes = any('"' in line for line in sample)
    pairs = [(each, decimal) for decimal in ".," for each in SEPARATORS if each != decimal or quotes]
    return max(pairs, key=numbers)


def _find_titles(lines: list[str], separator: str, width: int) -> list[str]:
    """Titles of so many columns from the lines above the numbers; empty if there are none.

    Comments may stand above the header, the header may be a comment itself, and units may stand below it.
    """
    found = []
    for line in lines:
        text = re.sub(r'^\s*("?)\s*(?:#|%|//)\s*', r"\1", line)
        # The header's separator may be another one than the numbers'.
        ways = [_split(text, each) for each in (separator, *SEPARATORS)]
        found.append(next((cells for cells in ways if len(cells) == width), ways[0]))
    head = [cells for cells in found if len(cells) > 1]
    head = [cells for cells in head if len(cells) == width] or head[-1:]
    if len(head) < 2:
        return head[0] if head else []
    units = [re.sub(r"[\[\]()]|^-$", "", title) for title in head[-1]]
    # Some units, as volts, may be of columns that nobody reads.
    if 2 * sum(is_unit(unit) for unit in units if unit) <= sum(map(bool, units)):
        return head[-1]
    return [f"{title} [{unit}]" if unit else title for title, unit in zip(head[-2], units, strict=True)]


def _split(line: str, separator: str) -> list[str]:
    if '"' in line:
        line = line.strip()
        try:
            cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
        except csv.Error:  # a quote that does not end before a field's largest size
            cells = line.split(separator)
    else:
        cells = line.split() if separator == " " else line.split(separator)
    return [cell.strip() for cell in cells]
