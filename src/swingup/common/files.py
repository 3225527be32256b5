"""Files: a crash, a full disk or a signal never leaves half a file, and reading has a bound."""

import contextlib
import errno
import os
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from .errors import SwingupError, one_line


def write_atomically(path: str | Path, content: bytes) -> None:
    """Write a whole file or none: sync a temporary file beside it to the disk, rename it, and sync the folder."""
    temporary = None
    try:
        target = behind_links(path)
        if target.exists() and not target.is_file():
            target.write_bytes(content)  # a device or a pipe, which a rename would replace
            return
        # Temporary files are private: the new file takes the mode of the old one, or of any new file.
        mode = target.stat().st_mode if target.exists() else 0o666 & ~_umask()
        # In the same folder, since a rename is atomic only within one file system; cut short, since the file's name
        # may be as long as names may be.
        prefix = f".{target.name[:40]}."
        with tempfile.NamedTemporaryFile(dir=target.parent, prefix=prefix, delete=False) as file:
            temporary = Path(file.name)
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.chmod(mode)
        temporary.replace(target)
        _sync_folder(target.parent)
    except BaseException as error:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
        if not isinstance(error, OSError):
            raise
        reason = error.strerror or error
        raise SwingupError(
            f"cannot write {path}: {reason}; choose a folder that exists and can be written"
        ) from error


def write_map(path: str | Path, values: Mapping[str, Any], *comments: str) -> None:
    """Write a flat YAML map below lines of comments."""
    lines = [*(f"# {one_line(each, 600)}" for each in comments), *(f"{name}: {values[name]}" for name in values)]
    write_atomically(path, "\n".join([*lines, ""]).encode())


def read_bytes(path: str | Path, limit: int) -> bytes:
    """Read a whole file of at most ``limit`` bytes; larger ones are never held in memory."""
    try:
        with Path(path).open("rb") as stream:
            # One byte more shows that the file is too large, also where it has no size, such as a pipe.
            content = stream.read(limit + 1)
    except FileNotFoundError as error:
        raise SwingupError(f"no such file: {one_line(path)}") from error
    except OSError as error:
        raise SwingupError(f"cannot read {one_line(path)}: {error.strerror or error}; check the path") from error
    except ValueError as error:  # a null character
        raise SwingupError(f"cannot read {one_line(path)}: not the name of a file") from error
    if len(content) > limit:
        raise SwingupError(f"{path} has more than {limit / 1e6:g} MB: it is another kind of file")
    return content


def file_name(text: str) -> str:
    """A name for a file or folder on every system, from an id such as ``module:Namespace/Task-v0``."""
    return re.sub(r"[^\w.,=+ -]", "-", text)


def make_folder(path: str | Path) -> None:
    """Make a folder with its parents, unless it exists."""
    try:
        behind_links(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SwingupError(f"cannot create {path}: {error.strerror}; choose another folder") from error


def check_writable(path: str | Path) -> None:
    """Refuse a file that cannot be written, before the work that fills it."""
    try:
        target = behind_links(path)
        folder, writable = target.is_dir(), os.access(target.parent, os.W_OK | os.X_OK)
        reason = "is a folder" if folder else "" if writable else "no such folder, or not to be written"
    except OSError as error:
        reason = str(error.strerror)
    if reason:
        raise SwingupError(f"cannot write {path}: {reason}; choose a folder that exists and can be written")


def behind_links(path: str | Path) -> Path:
    """The file that a path leads to: a rename would replace a link instead of the file behind it."""
    try:
        target = Path(os.path.realpath(path))
    except ValueError as error:
        raise OSError(errno.EINVAL, "not the name of a file") from error
    if target.is_symlink():
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
    return target


def _sync_folder(folder: Path) -> None:
    """Write a folder's names to the disk, if the system can."""
    with contextlib.suppress(OSError):  # the file is whole; Windows opens no folders
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _umask() -> int:
    # The mask can only be read by setting it.
    mask = os.umask(0)
    os.umask(mask)
    return mask


def has_suffix(path: str | Path, *known: str) -> bool:
    """Whether a file's name ends in one of some suffixes, in small letters or capitals."""
    return Path(path).suffix.lower() in known


def check_suffix(path: str | Path, known: Sequence[str]) -> str:
    """The suffix of an output file, in lower case."""
    if not has_suffix(path, *known):
        raise SwingupError(f"cannot write {path}: its name must end in {' or '.join(known)}")
    return Path(path).suffix.lower()


@contextlib.contextmanager
def working_folder_first() -> Iterator[None]:
    """Search the working folder first, as ``python`` itself does, during one import.

    Afterwards the folder comes last, for what the module imports when it is called. There it hides no package: a
    ``json.py`` in the working folder does not replace Python's.
    """
    sys.path.insert(0, "")
    try:
        yield
    finally:
        sys.path.remove("")
        if "" not in sys.path:
            sys.path.append("")
