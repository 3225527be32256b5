"""Columns of numbers in files of arrays: NumPy's npz and npy, and MATLAB's mat of level 5 (-v6 and -v7).

Of MATLAB's values, arrays and structures of arrays are read. SciPy's ``loadmat`` is not used: version 1.17 ends the
process with a segmentation fault on one in fifty damaged files, and unpacks without a bound. Source: MathWorks,
MAT-File Format.
"""

import io
import math
import struct
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .errors import SwingupError

ARRAY_FILES = (".npz", ".npy", ".mat")
LARGEST_ARRAYS = 512_000_000  # bytes of a file's arrays, once they are unpacked

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_MATRIX, _COMPRESSED = 14, 15
_STRUCTURE, _OBJECT, _OPAQUE, _NUMBERS = 2, 3, 17, range(6, 16)
_MAXIMUM_DEPTH = 8
"""Codes of MATLAB's types, elements and classes, and the depth of structures within one another."""


def read_arrays(path: str | Path, content: bytes) -> tuple[dict[str, np.ndarray], str]:
    """Columns of one length by name, and what is not read, with a remedy.

    The length is the greatest that three columns or more have, a time and two angles, or else the commonest; a
    column may have one row less or more.
    """
    mat = Path(path).suffix.lower() == ".mat"
    try:
        found = _read_mat(content) if mat else _read_numpy(io.BytesIO(content))
        arrays, objects = _named(list(_columns(found))), list(_objects("", found))
    except SwingupError as error:
        raise SwingupError(f"{path} {error}") from error
    except Exception as error:  # readers of foreign files raise anything
        raise SwingupError(
            f"cannot read {path}: it is damaged, or not the kind of file that its name says (mat: of -v6 or -v7)"
        ) from error
    unread = "".join(
        f"; its {name} is MATLAB's {kind}, not read: {_plain_line(name, kind)}" for name, kind in objects
    )
    unread += "".join(
        f"; its {'.'.join(place)}, {each.dtype} of shape {each.shape}, is not read: save real numbers, 1 or 2 axes"
        for place, each in _leaves((), found)
        if each.dtype.kind in "fiuc" and each.size > 1 and not _is_table(each)
    )
    if not arrays:
        raise SwingupError(f"{path} has no array of numbers: save time, angles and torques as arrays{unread}")
    counts = Counter(map(len, arrays.values()))
    length = max((length for length in counts if counts[length] > 2), default=counts.most_common(1)[0][0])
    # Torques may have one row less than the states between which they act.
    return {title: column for title, column in arrays.items() if abs(len(column) - length) <= 1}, unread


def _objects(name: str, found: Any) -> Iterator[tuple[str, str]]:
    """Names and classes of MATLAB's objects in a file."""
    if isinstance(found, _Object):
        yield name, found.kind
    for key, each in found.items() if isinstance(found, dict) else ():
        yield from _objects(f"{name}.{key}".removeprefix("."), each)


def _plain_line(name: str, kind: str) -> str:
    """MATLAB's line that saves an object as arrays."""
    if kind in ("table", "timetable"):
        return f"write{kind}({name}, 'plain.csv')"
    if kind == "timeseries":
        return f"t = {name}.Time; x = squeeze({name}.Data); save('plain.mat', 't', 'x', '-v7')"
    return f"s = struct({name}); save('plain.mat', '-struct', 's', '-v7')"


class _Object(NamedTuple):
    """A value of one of MATLAB's classes, whose content is not read."""

    kind: str


def _read_mat(content: bytes) -> dict[str, Any]:
    """Arrays by name; of a structure, a map of its fields. Real parts count alone."""
    if content.startswith(b"MATLAB 7.3"):
        raise SwingupError("is a mat file of version 7.3: save it with -v7")
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        raise ValueError("no mat file of level 5")
    found = {}
    for kind, data in _elements(content[128:], order, LARGEST_ARRAYS):
        if kind == _MATRIX:
            name, value = _matrix(data, order, _MAXIMUM_DEPTH)
            if value is not None and name:  # what has no name belongs to the objects
                found[name] = value
    return found


def _elements(data: bytes, order: str, budget: int | None = None) -> Iterator[tuple[int, bytes]]:
    """Types and contents of elements in a row; with a budget of bytes, compressed ones are unpacked."""
    place = 0
    while place + 8 <= len(data):
        kind, size = struct.unpack_from(order + "II", data, place)
        start = place + 8
        if kind >> 16:  # a small element has its type, size and content in 8 bytes
            kind, size, start = kind & 0xFFFF, kind >> 16, place + 4
        if start + size > len(data):
            raise ValueError("an element is longer than the file")
        part = data[start : start + size]
        place = place + 8 if start == place + 4 else start + size
        # Only whole variables are compressed: an element within one that says so is damaged.
        if kind == _COMPRESSED and budget is not None:
            unpacked = zlib.decompressobj().decompress(part, budget + 1)
            budget -= len(unpacked)
            if budget < 0:
                raise SwingupError(
                    f"has arrays of more than {LARGEST_ARRAYS / 1e6:.0f} MB: it is another kind of file"
                )
            yield from _elements(unpacked, order)
            continue
        place += -place % 8
        yield kind, part


def _matrix(data: bytes, order: str, depth: int) -> tuple[str, Any]:
    """Name and value of a matrix; None for what is not numbers."""
    if not data:  # a field that was never set
        return "", None
    parts = list(_elements(data, order))
    flags = _numbers(*parts[0], order)
    if int(flags[0]) & 0xFF == _OPAQUE:  # it has no dimensions: name, kind of system, class
        return parts[1][1].decode("latin-1"), _Object(parts[3][1].decode("latin-1"))
    dimensions = _numbers(*parts[1], order)
    name, kind = parts[2][1].decode("latin-1"), int(flags[0]) & 0xFF
    if kind in _NUMBERS:
        values, shape = _numbers(*parts[3], order), dimensions.tolist()
        if math.prod(shape) != len(values):
            raise ValueError("an array of another size than it says")
        return name, values.reshape(shape, order="F")
    if kind == _OBJECT:
        return name, _Object(parts[3][1].decode("latin-1"))
    if kind != _STRUCTURE or depth == 0:
        return name, None
    length = max(int(_numbers(*parts[3], order)[0]), 1)
    names = [parts[4][1][k : k + length].split(b"\0")[0] for k in range(0, len(parts[4][1]), length)]
    found = []
    for start in range(5, len(parts), max(len(names), 1)):
        fields = {
            each.decode("latin-1"): _matrix(part[1], order, depth - 1)[1]
            for each, part in zip(names, parts[start:], strict=False)
        }
        found.append({each: value for each, value in fields.items() if value is not None})
    # Those of an array of structures are numbered.
    return name, found[0] if len(found) == 1 else {str(k): each for k, each in enumerate(found, start=1)}


def _numbers(kind: int, data: bytes, order: str) -> np.ndarray:
    """An element's numbers in this machine's order of bytes."""
    return np.frombuffer(data, np.dtype(order + _TYPES[kind])).astype(_TYPES[kind])


def _read_numpy(stream: io.BytesIO) -> Any:
    if zipfile.is_zipfile(stream):
        size = sum(each.file_size for each in zipfile.ZipFile(stream).infolist())
        if size > LARGEST_ARRAYS:
            raise SwingupError(f"has arrays of {size / 1e6:.0f} MB: it is another kind of file")
    stream.seek(0)
    try:
        found = np.load(stream, allow_pickle=False)
        return {name: found[name] for name in found.files} if hasattr(found, "files") else found
    except ValueError as error:
        if "Object arrays" not in str(error):
            raise
        raise SwingupError("has Python's objects, which are not read: save arrays of numbers") from error


def _leaves(path: tuple[str, ...], found: Any) -> Iterator[tuple[tuple[str, ...], np.ndarray]]:
    """Arrays, and those of structures; dates and durations in s."""
    if isinstance(found, dict):
        for name, each in found.items():
            yield from _leaves((*path, str(name)), each)
        return
    if isinstance(found, _Object):
        return
    array = np.asarray(found)
    if array.dtype.names:
        yield from _leaves(path, {name: array[name] for name in array.dtype.names})
    elif array.dtype.kind in "mM":
        since = array.flat[0] if array.dtype.kind == "M" and array.size else np.timedelta64(0)
        yield path, (array - since) / np.timedelta64(1, "s")
    else:
        yield path, array


def _is_table(array: np.ndarray) -> bool:
    return array.dtype.kind in "fiu" and array.size > 1 and array.ndim in (1, 2)


def _columns(found: Any) -> Iterator[tuple[tuple[str, ...], np.ndarray]]:
    """Columns of arrays; those of a matrix are numbered from 1."""
    for path, array in _leaves((), found):
        if not _is_table(array):
            continue
        table = np.atleast_2d(array)
        table = table.T if table.shape[0] < table.shape[1] else table
        *within, title = path or ("",)
        for place, column in enumerate(table.T, start=1):
            yield (*within, title if table.shape[1] == 1 else f"{title}{place}"), column


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
