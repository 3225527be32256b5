"""Cells of a table from a file: text with any separator, NumPy's npz and npy, MATLAB's mat up to version 7."""

import codecs
import csv
import functools
import io
import itertools
import re
import zipfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from .columns import is_unit
from .errors import SwingupError
from .files import read_bytes
from .mat_file import read_mat

LARGEST_TABLE = 64_000_000
"""Bytes of a file: a minute at 1 kHz with 17 columns has 25 MB."""
SEPARATORS = (",", ";", "\t", " ", "|")
COMMENTS = ("#", "%", "//")
SAMPLE = 20
"""Lines that show the separator."""
UNIT = re.compile(r"[\[(](?!\d+[\])])([^\])]*)")
"""A unit in brackets at the end of a title; a number in them, as in q[0], belongs to the name."""
MOST_UNPACKED = 8 * LARGEST_TABLE


Row: TypeAlias = tuple[int, list[Any]]
"""Number of the line in the file, from 1, and its cells: texts, or numbers of an array."""


@dataclass(frozen=True)
class Cells:
    """A table before its columns are chosen."""

    titles: list[str]
    """Empty texts where there is no header."""
    rows: list[Row]
    decimal: str = "."

    @functools.cached_property
    def names(self) -> list[str]:
        """The names in the titles: "time[s]" and "pos1 (rad)" name the columns time and pos1.

        What brackets alone tell apart, as in "Position (elbow)", belongs to the name.
        """
        short = [UNIT.split(title, maxsplit=1)[0].rstrip() for title in self.titles]
        return [
            title if short.count(name) > 1 and not is_unit(_bracket(title)) else name
            for title, name in zip(self.titles, short, strict=True)
        ]

    def unit(self, title: str) -> str:
        """The unit in a column's title; empty without one."""
        place = self.place(title)
        return "" if self.names[place] == self.titles[place] else _bracket(self.titles[place])

    def place(self, title: str) -> int:
        """The place of a column, by its name or as #3."""
        return self.names.index(title) if title in self.names else int(title[1:]) - 1

    def column(self, title: str, rows: Sequence[Row]) -> list[Any]:
        """A column's cells of some rows; empty where a row ends before it."""
        place = self.place(title)
        return [cells[place] if place < len(cells) else "" for _, cells in rows]

    def plain(self, cell: Any) -> Any:
        """A cell with a decimal point."""
        return cell.replace(self.decimal, ".") if isinstance(cell, str) else cell


def _bracket(title: str) -> str:
    found = UNIT.search(title)
    return found[1] if found else ""


def read_cells(path: str | Path) -> Cells:
    """Read a file's cells, by its suffix."""
    content = read_bytes(path, LARGEST_TABLE)
    if Path(path).suffix.lower() in (".npz", ".npy", ".mat"):
        return _array_cells(path, content)
    return _text_cells(_decoded(path, content))


def is_number(cell: Any, decimal: str = ".") -> bool:
    """Whether a cell has a number, NaN and infinities included."""
    try:
        float(cell.replace(decimal, ".") if decimal != "." else cell)
    except ValueError:
        return False
    return True


def _decoded(path: str | Path, content: bytes) -> str:
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    for encoding in ("utf-16",) if wide else ("utf-8-sig", "latin-1"):
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        # JSON is text, and no table either.
        if not re.match(r"\s*(\{|\[\s*[\[{])", text) and not re.search(r"[\x00-\x08\x0e-\x1f]", text):
            return text
    raise SwingupError(f"{path} is not a table in text: export the log as CSV, npz or mat")


def _text_cells(text: str) -> Cells:
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    separator, decimal = _separator([line for _, line in lines if not line.lstrip().startswith(COMMENTS)])
    split = [(number, _split(line, separator)) for number, line in lines]
    # Facts of the recording may stand above the table.
    usual = Counter(len(cells) for _, cells in split[len(split) // 2 :]).most_common(1)

    def numeric(cells: list[str]) -> bool:
        enough = 2 * sum(is_number(cell, decimal) for cell in cells) >= max(sum(map(bool, cells)), 1)
        return enough and any(cells) and len(cells) >= usual[0][0]

    first = next((k for k, (_, cells) in enumerate(split) if numeric(cells)), len(split))
    rows = [
        row
        for row, (_, line) in zip(split[first:], lines[first:], strict=True)
        if not line.lstrip(' "').startswith(COMMENTS)
    ]
    width = len(rows[0][1]) if rows else 0
    # Comments may stand above the header, the header may be a comment itself, and units may stand below it.
    head = [cells for _, line in lines[:first] if len(cells := _titles(line, separator, width)) > 1]
    head = [cells for cells in head if len(cells) == width] or head[-1:]
    if not head:
        return Cells([""] * width, rows, decimal)
    titles = head[-1]
    units = [re.sub(r"[\[\]()]|^-$", "", title) for title in titles]
    # A line of units below the header; some, as volts, may be of columns that nobody reads.
    if len(head) > 1 and 2 * sum(is_unit(unit) for unit in units if unit) > sum(map(bool, units)):
        titles = [f"{title} [{unit}]" if unit else title for title, unit in zip(head[-2], units, strict=True)]
    return Cells(titles, rows, decimal)


def _separator(lines: list[str]) -> tuple[str, str]:
    """The separator and the decimal sign with which the most cells are numbers."""
    sample = lines[len(lines) // 2 :][:SAMPLE]

    def numbers(pair: tuple[str, str]) -> int:
        rows = [_split(line, pair[0]) for line in sample]
        return sum(sum(is_number(cell, pair[1]) for cell in row) for row in rows if len(row) > 1)

    # A decimal comma may stand between commas where numbers are in quotes.
    quotes = any('"' in line for line in sample)
    pairs = [(each, decimal) for decimal in ".," for each in SEPARATORS if each != decimal or quotes]
    return max(pairs, key=numbers)


def _titles(line: str, separator: str, width: int) -> list[str]:
    """The titles of a header, whose separator may be another one, and which a comment's sign may begin."""
    line = re.sub(r'^\s*("?)\s*(?:#|%|//)\s*', r"\1", line)
    ways = [_split(line, each) for each in (separator, *SEPARATORS)]
    return next((cells for cells in ways if len(cells) == width), ways[0])


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


def _array_cells(path: str | Path, content: bytes) -> Cells:
    try:
        mat = Path(path).suffix.lower() == ".mat"
        found = read_mat(content, MOST_UNPACKED) if mat else _read_numpy(path, io.BytesIO(content))
        arrays = _named(list(_columns((), found)))
    except NotImplementedError as error:
        raise SwingupError(f"{path} is a mat file of version 7.3: save it with -v7") from error
    except SwingupError:
        raise
    except Exception as error:  # readers of foreign files raise anything
        raise SwingupError(
            f"cannot read {path}: it is damaged, or not the kind of file that its name says (mat: of -v6 or -v7)"
        ) from error
    if not arrays:
        raise SwingupError(f"{path} has no array of numbers: save time, angles and torques as arrays")
    length = Counter(map(len, arrays.values())).most_common(1)[0][0]
    # Torques may have one row less than the states between which they act.
    chosen = {title: column for title, column in arrays.items() if abs(len(column) - length) <= 1}
    # Integers stay integers: a float would lose digits of a time in nanoseconds.
    columns = (column.tolist() for column in chosen.values())
    rows = map(list, itertools.zip_longest(*columns, fillvalue=""))
    return Cells(list(chosen), list(enumerate(rows, start=1)))


def _read_numpy(path: str | Path, stream: io.BytesIO) -> Any:
    if zipfile.is_zipfile(stream):
        _bound(sum(each.file_size for each in zipfile.ZipFile(stream).infolist()))
    stream.seek(0)
    try:
        found = np.load(stream, allow_pickle=False)
        return {name: found[name] for name in found.files} if hasattr(found, "files") else found
    except ValueError as error:
        if "Object arrays" not in str(error):
            raise
        raise SwingupError(f"{path} has Python's objects, which are not read: save arrays of numbers") from error


def _bound(size: int) -> None:
    if size > MOST_UNPACKED:
        raise SwingupError(f"an array file with {size / 1e6:.0f} MB: it is another kind of file")


def _named(columns: list[tuple[tuple[str, ...], np.ndarray]]) -> dict[str, np.ndarray]:
    """Columns by the last of their names, with as many of those before as tell them apart: q1, or meas.q1."""
    names = [""] * len(columns)
    for depth in range(1, 1 + max((len(path) for path, _ in columns), default=0)):
        counts = Counter(names)
        names = [
            ".".join(path[-depth:]) if counts[name] > 1 or depth == 1 else name
            for name, (path, _) in zip(names, columns, strict=True)
        ]
    return dict(zip(names, (column for _, column in columns), strict=True))


def _columns(path: tuple[str, ...], found: Any) -> Iterator[tuple[tuple[str, ...], np.ndarray]]:
    """Columns of arrays and of structures of arrays; those of a matrix are numbered from 1."""
    if isinstance(found, dict):
        for name, each in found.items():
            yield from _columns((*path, str(name)), each)
        return
    array = np.asarray(found)
    if array.dtype.names:
        yield from _columns(path, {name: array[name] for name in array.dtype.names})
    elif array.dtype.kind in "fiu" and array.size > 1 and array.ndim in (1, 2):
        table = np.atleast_2d(array)
        table = table.T if table.shape[0] < table.shape[1] else table
        *within, title = path or ("",)
        for place, column in enumerate(table.T, start=1):
            yield (*within, title if table.shape[1] == 1 else f"{title}{place}"), column
