"""Safetensors files of named arrays and JSON metadata: the form of policies, checkpoints and trajectories.

Eight bytes hold the length of a JSON header, which gives type, shape and place of each array; the arrays' bytes
follow (https://huggingface.co/docs/safetensors). Such a file cannot run code or inflate. The metadata is one JSON
text in the header. NumPy suffices, since a robot may have nothing else.
"""

import json
import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from .errors import MALFORMED, SwingupError, quoted
from .files import write_atomically

SUFFIX = ".safetensors"  # the end of a file's name

METADATA = "swingup"
"""Name of the metadata's text in the header's ``__metadata__``, where safetensors allows texts only."""

LARGEST_ARRAYS = 256_000_000
"""Bytes of all arrays that are read, unless the caller expects more; three layers of 4,000 have 130 MB."""

LARGEST_HEADER = 4_000_000  # bytes of the header, metadata included

TYPES = {
    "BOOL": "|b1", "U8": "|u1", "I8": "|i1", "U16": "<u2", "I16": "<i2", "U32": "<u4", "I32": "<i4", "U64": "<u8",
    "I64": "<i8", "F16": "<f2", "F32": "<f4", "F64": "<f8",
}  # fmt: skip
"""Types of arrays by their names in the header: those of safetensors that NumPy has."""


def save_arrays(
    path: str | Path, kind: str, version: int, metadata: Mapping[str, Any], arrays: Mapping[str, np.ndarray]
) -> None:
    """Write a file atomically, with ``format`` (the kind) and ``format_version`` before the metadata's entries."""
    head = {"format": kind, "format_version": version}
    # Twice: first in order, and stronger than another file's, whose metadata may be passed on.
    text = json.dumps(finite({**head, **metadata, **head}))
    header: dict[str, Any] = {"__metadata__": {METADATA: text}}
    names, content = {np.dtype(code): name for name, code in TYPES.items()}, []
    end = 0
    # Wide types first, so that each array starts at a multiple of its items' size; others map the file into memory.
    for name, array in sorted(arrays.items(), key=lambda item: -item[1].dtype.itemsize):
        dtype = array.dtype.newbyteorder("<")
        if dtype not in names:
            raise SwingupError(f"cannot write {path}: {name} is of type {array.dtype}; use numbers or booleans")
        start, end = end, end + array.nbytes
        header[name] = {"dtype": names[dtype], "shape": list(array.shape), "data_offsets": [start, end]}
        content.append(array.astype(dtype).tobytes())
    line = json.dumps(header).encode()
    line += b" " * (-len(line) % 8)
    write_atomically(path, b"".join([len(line).to_bytes(8, "little"), line, *content]))


def finite(value: Any) -> Any:
    """A JSON value with null for every number that is not finite: JSON has no such numbers."""
    if isinstance(value, Mapping):
        return {name: finite(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_json(path: str | Path, content: Any) -> None:
    """Write JSON, in which null stands for numbers that are not finite."""
    write_atomically(path, (json.dumps(finite(content), indent=2) + "\n").encode())


def load_arrays(
    path: str | Path,
    kind: str,
    version: int,
    known: Callable[[str], bool] = lambda name: True,
    limit: int = LARGEST_ARRAYS,
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read the metadata and the arrays of a file.

    The metadata must name the kind as ``format`` and give the version as ``format_version``. Arrays of unknown
    names are left alone; the others may have ``limit`` bytes, all together.
    """
    try:
        with Path(path).open("rb") as stream:
            header = _read_header(stream)
            metadata = _read_metadata(path, kind, version, header.pop("__metadata__", None))
            first = stream.tell()
            places = _places(header, os.fstat(stream.fileno()).st_size - first)
            wanted = {name: place for name, place in places.items() if known(name)}
            size = sum(math.prod(shape) * dtype.itemsize for dtype, shape, _ in wanted.values())
            if size > limit:
                raise SwingupError(
                    f"{path} holds {size / 1e6:.4g} MB of arrays, where a {kind} file may have "
                    f"{limit / 1e6:.4g} MB: it is damaged or foreign"
                )
            arrays = {}
            for name, (dtype, shape, start) in wanted.items():
                stream.seek(first + start)
                array = np.frombuffer(stream.read(math.prod(shape) * dtype.itemsize), dtype).reshape(shape)
                # Copied, because an array over bytes is read-only.
                arrays[name] = array.astype(dtype.newbyteorder("="))
            return metadata, arrays
    except FileNotFoundError as error:
        raise SwingupError(f"no such file: {path}") from error
    except OSError as error:
        raise SwingupError(f"cannot read {path}: {error.strerror}") from error
    except MALFORMED as error:
        raise SwingupError(f"{path} is not a {kind} file, or it is truncated: copy or make it anew") from error


def read_format(path: str | Path) -> str | None:
    """The ``format`` that a file names; None where it is not one of these files, or cannot be read."""
    try:
        with Path(path).open("rb") as stream:
            return str(json.loads(_read_header(stream)["__metadata__"][METADATA])["format"])
    except (OSError, *MALFORMED):
        return None


def _read_header(stream: BinaryIO) -> dict[str, Any]:
    """The header's JSON object; the stream then stands at the first array."""
    length = int.from_bytes(stream.read(8), "little")
    if length > LARGEST_HEADER:
        raise ValueError("a header of absurd length")
    text = stream.read(length)
    if len(text) < length or text[:1] != b"{":
        raise ValueError("a header that is truncated or no object")
    return json.loads(text, object_pairs_hook=_object)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object; with a name twice, two readers could see two files."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a name that is given twice")
    return found


def _read_metadata(path: str | Path, kind: str, version: int, texts: Any) -> dict[str, Any]:
    try:
        metadata = json.loads(texts[METADATA])
        found, found_version = metadata["format"], metadata["format_version"]
    except MALFORMED as error:
        raise SwingupError(f"{path} is not a {kind} file: it lacks swingup's metadata") from error
    if found != kind:
        raise SwingupError(f"{path} is a {quoted(found)} file: a {kind} file is needed here")
    # The exact type, because true is equal to 1.
    if type(found_version) is not int or found_version != version:
        raise SwingupError(
            f"{path} has format version {quoted(found_version)}, this program reads {version}: update swingup"
        )
    return metadata


def _places(header: dict[str, Any], size: int) -> dict[str, tuple[np.dtype, tuple[int, ...], int]]:
    """Type, shape and first byte of each array; they follow each other without gaps, to the file's end."""
    places, end = {}, 0
    for name, entry in sorted(header.items(), key=lambda item: item[1]["data_offsets"]):
        dtype, shape, (start, stop) = np.dtype(TYPES[entry["dtype"]]), tuple(entry["shape"]), entry["data_offsets"]
        # NumPy takes up to 64 dimensions; a product of many more would take long.
        counts = all(type(value) is int and 0 <= value < 2**63 for value in (*shape, start, stop))
        if len(entry) != 3 or len(shape) > 64 or not counts:
            raise ValueError(f"no entry of an array: {name}")
        if start != end or stop - start != math.prod(shape) * dtype.itemsize:
            raise ValueError(f"another place or size than the arrays before it and its shape leave: {name}")
        places[name], end = (dtype, shape, start), stop
    if end != size:
        raise ValueError("more or fewer bytes than the header says")
    return places
