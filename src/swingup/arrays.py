"""``.npz`` archives of named arrays and JSON metadata: the form of policy files and checkpoints, without pickle.

A compressed file of 3 MB may hold 3 GB, and its header may declare any shape. So the archive is read by hand: the
sizes that it declares are summed before anything is inflated, and no member may give more bytes than it declared.
"""

import io
import json
import math
import re
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .errors import SwingupError
from .files import write_atomically
from .text import quoted

METADATA = "metadata"
"""Name of the array that holds the JSON text as UTF-8 bytes."""

LARGEST_ARCHIVE = 256_000_000
"""Bytes of all arrays that are read, unless the caller expects more; three layers of 4,000 have 130 MB."""

LARGEST_METADATA = 4_000_000
"""Bytes of the JSON text."""

# Matched, not parsed: NumPy's own reader accepts any Python literal.
_HEADER = re.compile(
    rb"\{'descr': '([<>|=]?[biufc]\d{1,2})', 'fortran_order': (False|True), 'shape': \(([\d, ]{0,99})\),? ?\} *\n"
)
"""Header of an array of numbers as NumPy writes it: https://numpy.org/doc/stable/reference/generated/numpy.lib.format."""


def save_archive(
    path: str | Path, kind: str, version: int, metadata: Mapping[str, Any], arrays: Mapping[str, np.ndarray]
) -> None:
    """Write an archive atomically; its metadata starts with ``format`` (the kind) and ``format_version``.

    Raises:
        SwingupError: the file cannot be written.
    """
    text = json.dumps(finite({"format": kind, "format_version": version, **metadata}), indent=2)
    # In memory first: the file is then written in one piece.
    buffer = io.BytesIO()
    contents: dict[str, Any] = {METADATA: np.frombuffer(text.encode(), np.uint8), **arrays}
    np.savez_compressed(buffer, **contents)
    write_atomically(path, buffer.getvalue())


def finite(value: Any) -> Any:
    """A JSON value with null for every number that is not finite: JSON has no such numbers."""
    if isinstance(value, Mapping):
        return {name: finite(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def load_archive(
    path: str | Path,
    kind: str,
    version: int | tuple[int, ...],
    known: Callable[[str], bool] = lambda name: True,
    most: int = LARGEST_ARCHIVE,
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read the metadata and the arrays of an archive.

    Args:
        path: the file.
        kind: what its metadata must name as ``format``.
        version: what it must give as ``format_version``, or several of which it must give one.
        known: whether an array of this name is read; others are left alone.
        most: bytes that the arrays may have in memory, all together.

    Raises:
        SwingupError: there is no such file, it is truncated, altered or foreign, of another kind or version, or its
            arrays are larger than that.
    """
    text, arrays = _read(path, kind, known, most)
    try:
        metadata = json.loads(text)
        found, found_version = metadata["format"], metadata["format_version"]
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise SwingupError(_lacks_metadata(path, kind)) from error
    if found != kind:
        raise SwingupError(f"{path} is a {quoted(found)} file: a {kind} file is needed here")
    versions = version if isinstance(version, tuple) else (version,)
    if found_version not in versions:
        *others, newest = map(str, versions)
        read = f"{', '.join(others)} and {newest}" if others else newest
        raise SwingupError(
            f"{path} has format version {quoted(found_version)}, this program reads {read}: update swingup"
        )
    return metadata, arrays


def _read(
    path: str | Path, kind: str, known: Callable[[str], bool], most: int
) -> tuple[bytes, dict[str, np.ndarray]]:
    """The metadata's text and the known arrays, from members whose sizes were summed first."""
    try:
        with Path(path).open("rb") as stream, zipfile.ZipFile(stream) as archive:
            members = _members(archive)
            if METADATA not in members:
                raise SwingupError(_lacks_metadata(path, kind))
            text = members.pop(METADATA)
            wanted = {name: member for name, member in members.items() if known(name)}
            size = sum(member.file_size for member in wanted.values())
            if size > most or text.file_size > LARGEST_METADATA:
                raise SwingupError(
                    f"{path} holds {(size + text.file_size) / 1e6:.4g} MB of arrays, where a {kind} file may have "
                    f"{most / 1e6:.4g} MB: it is damaged or foreign"
                )
            arrays = {name: _array(archive, member) for name, member in wanted.items()}
            return _array(archive, text).tobytes(), arrays
    except SwingupError:
        raise
    except FileNotFoundError as error:
        raise SwingupError(f"no such file: {path}") from error
    except (PermissionError, IsADirectoryError) as error:
        raise SwingupError(f"cannot read {path}: {error.strerror}") from error
    except Exception as error:  # zipfile, zlib and NumPy have a dozen kinds of error for damaged bytes
        raise SwingupError(f"{path} is not a {kind} file, or it is truncated: copy or make it anew") from error


def _lacks_metadata(path: str | Path, kind: str) -> str:
    return f"{path} is not a {kind} file: it lacks swingup's metadata"


def _members(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """The arrays of an archive by their name; twice the same name would let two readers see two files."""
    members: dict[str, zipfile.ZipInfo] = {}
    for member in archive.infolist():
        name = member.filename.removesuffix(".npy")
        if name in members:
            raise ValueError(f"two members of one name, {name}")
        members[name] = member
    return members


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    """One array of numbers, native or not, in memory of its own.

    Raises:
        ValueError: the member has another size than it declares, or is no array of numbers.
    """
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError("a compression that NumPy does not use")  # some of which need gigabytes for any content
    with archive.open(member) as stream:
        # Sized, so that zlib stops there: without a size it inflates all that the member holds.
        content = stream.read(member.file_size)
    if content[:6] != b"\x93NUMPY" or content[6:7] not in (b"\x01", b"\x02"):
        raise ValueError("no array of NumPy's format 1 or 2")
    start = 10 if content[6] == 1 else 12
    header = _HEADER.match(content, start)
    if header is None or header.end() != start + int.from_bytes(content[8:start], "little"):
        raise ValueError("no header of an array of numbers")
    dtype, fortran, shape = np.dtype(header[1].decode()), header[2] == b"True", _shape(header[3].decode())
    if math.prod(shape) * dtype.itemsize != len(content) - header.end():
        raise ValueError("another size than the header declares")
    # Copied, because an array over bytes is read-only.
    return np.ndarray(shape, dtype, content, header.end(), order="F" if fortran else "C").copy(order="K")


def _shape(text: str) -> tuple[int, ...]:
    return tuple(int(number) for number in text.split(",") if number.strip())
