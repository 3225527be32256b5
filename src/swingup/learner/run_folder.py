"""A run's folder: one process at a time, checkpoints that are never lost, policies by seed."""

import contextlib
import errno
import re
import shutil
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ..areapo.checkpoint import load_checkpoint, read_metadata, save_checkpoint
from ..common.errors import MALFORMED, SwingupError, one_line
from ..common.files import behind_links, make_folder
from ..policy.file import read_network
from .metrics import REWARD_RATE
from .progress import UNRANKED, Rank, rank
from .run_settings import RunSettings

FIRST, BEST, LAST = "first.safetensors", "best.safetensors", "last.safetensors"

CHECKPOINTS_KEPT = 2  # The newest and one to go back to, if that is damaged

LOCK = ".lock"  # An empty file in the folder, which stays: removed, it could be locked twice
HELD = (errno.EAGAIN, errno.EACCES)
"""How the kernel says that another process holds a lock; the second, on some network file systems."""
NO_LOCKS = (errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK, errno.ENOSYS)
"""How it says that a file system has no locks."""


class RunFolder:
    """The folder of a run's files."""

    def __init__(self, path: str | Path) -> None:
        """A folder at this path, which need not exist yet."""
        self.path = Path(path)
        self.checkpoints = self.path / "checkpoints"

    def __str__(self) -> str:
        return str(self.path)

    def check_new(self) -> None:
        """Refuse a folder that holds something."""
        try:
            behind_links(self.path)  # which refuses a link to itself
            if any(self._content()):
                raise SwingupError(
                    f"{self.path} exists: continue it with --resume {self.path} (in Python resume_run), or choose "
                    "another --out (folder)"
                )
        except OSError as error:
            raise _cannot_create(self.path, error) from error

    def clear(self) -> None:
        """Remove everything in the folder except the lock."""
        for path in self._content():
            # A link is removed, never what it points at.
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()

    def save_checkpoint(self, frames: int, state: Any, metadata: Mapping[str, Any]) -> None:
        """Write a checkpoint, then delete the oldest: a write that fails loses nothing."""
        save_checkpoint(self.checkpoints / f"{frames:012d}.safetensors", state, metadata)
        for old in self._checkpoints()[:-CHECKPOINTS_KEPT]:
            old.unlink(missing_ok=True)

    def has_checkpoint(self) -> bool:
        """Whether there is a checkpoint to continue from."""
        return bool(self._checkpoints())

    def newest_frames(self, default: int = 0) -> int:
        """The frames of the newest checkpoint; ``default`` without one."""
        return max((int(path.stem) for path in self._checkpoints()), default=default)

    def load_checkpoint(self, like: Any) -> tuple[Any, dict[str, Any]]:
        """Read the newest checkpoint."""
        paths = self._checkpoints()
        if not paths:
            raise SwingupError(f"{self.path} has no checkpoint: delete it and train again")
        try:
            read_metadata(paths[-1])
        except SwingupError as error:
            advice = "; delete it to resume from the one before" if len(paths) > 1 else ""
            raise SwingupError(f"{error}{advice}") from error
        return load_checkpoint(paths[-1], like=like)

    def best(self, settings: RunSettings, measure: str) -> list[Rank]:
        """Rank of each seed's best policy file, perhaps newer than the checkpoint; a foreign one is refused."""
        if settings.seeds > 1:
            # Only to refuse a foreign file: the best of all is one of the seeds' best policies.
            _rank_on_disk(self.path / BEST, settings, measure)
        files = [self.path / seed_file(BEST, settings, index) for index in range(settings.seeds)]
        return [_rank_on_disk(file, settings, measure) for file in files]

    @contextlib.contextmanager
    def locked(self, frames: int) -> Iterator[None]:
        """Keep other processes from training on from a checkpoint of so many frames, as long as this one lives."""
        with self.exclusive():
            # Between the reading and the lock another process may have trained here.
            newest = self.newest_frames(frames)
            if newest > frames:
                raise SwingupError(
                    f"{self.path} has moved on to {newest} frames: continue it with --resume {self.path}"
                )
            for leftover in (*self.path.glob(".*.safetensors.*"), *self.checkpoints.glob(".*.safetensors.*")):
                leftover.unlink(missing_ok=True)  # half-written by a process that was killed
            yield

    @contextlib.contextmanager
    def exclusive(self, patience: float = 0.0) -> Iterator[None]:
        """Hold the kernel's lock on the folder, where the system has such locks; make the folder if it is missing.

        ``patience`` is how long to wait for a process that holds it (s).
        """
        try:
            import fcntl
        except ImportError:  # no such module on Windows
            yield
            return
        make_folder(self.path)
        try:
            # Open for writing, or NFS refuses to lock it.
            file = (self.path / LOCK).open("ab")
        except OSError as error:
            raise _cannot_create(self.path / LOCK, error) from error
        with file:
            deadline = time.monotonic() + patience
            while True:
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except OSError as error:
                    if error.errno in HELD and time.monotonic() < deadline:
                        time.sleep(0.05)
                        continue
                    if error.errno in HELD:
                        raise SwingupError(
                            f"another process trains in {self.path}: wait for it, stop it, or choose another --out"
                        ) from None
                    if error.errno not in NO_LOCKS:
                        raise SwingupError(f"cannot lock {file.name}: {error.strerror}") from error
                break
            yield

    def _content(self) -> list[Path]:
        return [path for path in self.path.iterdir() if path.name != LOCK] if self.path.exists() else []

    def _checkpoints(self) -> list[Path]:
        paths = self.checkpoints.glob("*.safetensors")
        return sorted(path for path in paths if re.fullmatch(r"[0-9]{1,15}", path.stem))


def _cannot_create(path: Path, error: OSError) -> SwingupError:
    return SwingupError(f"cannot create {path}: {error.strerror}; make it writable, or choose another folder")


def seed_file(name: str, settings: RunSettings, index: int) -> str:
    """File of a seed's best or last policy; with several seeds best.safetensors is the best of all."""
    return name if settings.seeds == 1 else name.replace(".", f"-{settings.seed + index}.")


def _rank_on_disk(path: Path, settings: RunSettings, measure: str) -> Rank:
    if not path.exists():
        return UNRANKED
    try:
        # Loaded whole: a file with sound metadata and damaged weights is not a best policy.
        metadata = read_network(path)[1]
        robot = settings.problem.record["robot"]
        trained_on = metadata.get("robot", robot)
        if trained_on != robot:
            raise SwingupError(f"it is for {one_line(trained_on, 40)}")
        result = metadata["scores"][measure]
        found = rank(result["score"], result.get(REWARD_RATE))
        if found == UNRANKED:
            raise SwingupError(f"it has no score of {measure}")
        return found
    except (SwingupError, *MALFORMED) as error:
        reason = one_line(error, 200)
        raise SwingupError(f"{path} is not a policy of this run ({reason}): move it away to resume") from error
