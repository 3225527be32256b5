"""Numbers in MATLAB's files of level 5 (-v6 and -v7): arrays and structures of arrays; the rest is left out.

SciPy's reader ends the process with a segmentation fault on some damaged files. Source: MathWorks, MAT-File Format.
"""

import math
import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np

TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
MATRIX, COMPRESSED = 14, 15
STRUCTURE, NUMBERS = 2, range(6, 16)
DEEPEST = 8
"""Structures within one another."""


def read_mat(content: bytes, most: int) -> dict[str, Any]:
    """Arrays by name; of a structure, a map of its fields. Real parts count alone.

    What is unpacked may have ``most`` bytes. Version 7.3 is a NotImplementedError, another file a ValueError.
    """
    if content.startswith(b"MATLAB 7.3"):
        raise NotImplementedError("version 7.3")
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        raise ValueError("no mat file of level 5")
    found = {}
    for kind, data in _elements(content[128:], order, most):
        if kind == MATRIX:
            name, value = _matrix(data, order, DEEPEST)
            if value is not None:
                found[name] = value
    return found


def _elements(data: bytes, order: str, most: int = 0) -> Iterator[tuple[int, bytes]]:
    """Types and contents of elements in a row; compressed ones are unpacked."""
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
        if kind == COMPRESSED and most:  # only whole variables are compressed: what else says so is damaged
            unpacker = zlib.decompressobj()
            unpacked = unpacker.decompress(part, most)
            if unpacker.unconsumed_tail:
                raise ValueError("larger than is read")
            yield from _elements(unpacked, order)
            continue
        place += -place % 8
        yield kind, part


def _matrix(data: bytes, order: str, depth: int) -> tuple[str, Any]:
    """Name and value of a matrix; None for what is not numbers."""
    parts = list(_elements(data, order))
    flags, dimensions = (_numbers(*part, order) for part in parts[:2])
    name, kind = parts[2][1].decode("latin-1"), int(flags[0]) & 0xFF
    if kind in NUMBERS:
        values, shape = _numbers(*parts[3], order), dimensions.tolist()
        if math.prod(shape) != len(values):
            raise ValueError("an array of another size than it says")
        return name, values.reshape(shape, order="F")
    if kind != STRUCTURE or depth == 0:
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
    return np.frombuffer(data, np.dtype(order + TYPES[kind])).astype(TYPES[kind])
