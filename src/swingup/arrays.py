"""``.npz`` archives of named arrays and JSON metadata: the form of policy files and checkpoints, without pickle."""

import io
import json
import math
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .errors import SwingupError
from .files import write_atomically

DAMAGED = (
    OSError, ValueError, EOFError, KeyError, AttributeError, TypeError, RuntimeError, NotImplementedError,
    MemoryError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip
"""What NumPy and zipfile raise on archives that are truncated, altered, encrypted or something else."""

METADATA = "metadata"
"""Name of the array that holds the JSON text as UTF-8 bytes."""


def save_archive(
    path: str | Path, kind: str, version: int, metadata: Mapping[str, Any], arrays: Mapping[str, np.ndarray]
) -> None:
    """Write an archive atomically; its metadata starts with ``format`` (the kind) and ``format_version``.

    Raises:
        SwingupError: the file cannot be written.
    """
    text = json.dumps(finite({"format": kind, "format_version": version, **metadata}), indent=2)
    buffer = io.BytesIO()
    contents: dict[str, Any] = {METADATA: np.frombuffer(text.encode(), np.uint8), **arrays}
    np.savez_compressed(buffer, **contents)
    write_atomically(path, buffer.getvalue())


def finite(value: Any) -> Any:
    """A JSON value with null for every number that is not finite: JSON has none of these."""
    if isinstance(value, Mapping):
        return {name: finite(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def load_archive(path: str | Path, kind: str, version: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read the metadata and the arrays of an archive.

    Raises:
        SwingupError: there is no such file, it is truncated or foreign, or of another kind or version.
    """
    arrays = _read(path, kind)
    try:
        metadata = dict(json.loads(arrays.pop(METADATA).tobytes().decode()))
        found, found_version = metadata["format"], metadata["format_version"]
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise SwingupError(f"{path} is not a {kind} file: it lacks swingup's metadata") from error
    if found != kind:
        raise SwingupError(f"{path} is a {found!r} file: a {kind} file is needed here")
    if found_version != version:
        raise SwingupError(
            f"{path} has format version {found_version!r}, this program reads {version}: update swingup"
        )
    return metadata, arrays


def _read(path: str | Path, kind: str) -> dict[str, np.ndarray]:
    try:
        # NumPy leaves a file open that it was to open itself and that is no archive.
        with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        if not all(isinstance(array, np.ndarray) for array in arrays.values()):
            raise ValueError("a member is no array")
        return arrays
    except FileNotFoundError as error:
        raise SwingupError(f"no such file: {path}") from error
    except (PermissionError, IsADirectoryError) as error:
        raise SwingupError(f"cannot read {path}: {error.strerror}") from error
    except DAMAGED as error:
        raise SwingupError(f"{path} is not a {kind} file, or it is truncated: copy or make it anew") from error
