"""A run's metrics: ``metrics.jsonl``, one line a report and seed, and TensorBoard events beside it."""

import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ..errors import SwingupError
from ..files import write_atomically

FILE = "metrics.jsonl"


class MetricsWriter:
    """Appends reports to a run's folder; resuming drops those after the checkpoint."""

    def __init__(self, folder: Path, after_frames: int = 0) -> None:
        """Open the files of a run that stands at ``after_frames``."""
        # Imported here: a third of a second that only training needs to spend.
        from tensorboardX import SummaryWriter

        path = folder / FILE
        kept = [row for row in read_metrics(path) if row["frames"] <= after_frames] if path.exists() else []
        write_atomically(path, "".join(json.dumps(row) + "\n" for row in kept).encode())
        self._file = path.open("a", encoding="utf-8")
        self._boards: dict[int, Any] = {}
        self._new_board = lambda seed: SummaryWriter(
            str(folder / "tensorboard" / f"seed-{seed}"), purge_step=after_frames + 1
        )

    def write(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Append rows that hold at least ``seed`` and ``frames``.

        Raises:
            SwingupError: a file cannot be written.
        """
        try:
            self._write(rows)
        except OSError as error:
            raise SwingupError(f"cannot write {self._file.name}: {error.strerror}; make room and resume") from error

    def _write(self, rows: Iterable[Mapping[str, Any]]) -> None:
        for row in rows:
            self._file.write(json.dumps(row) + "\n")
            if row["seed"] not in self._boards:
                self._boards[row["seed"]] = self._new_board(row["seed"])
            board = self._boards[row["seed"]]
            for name, value in row.items():
                if name not in ("seed", "frames") and isinstance(value, int | float) and math.isfinite(value):
                    board.add_scalar(name, value, row["frames"])
        self._file.flush()

    def __enter__(self) -> "MetricsWriter":
        return self

    def __exit__(self, *exception: object) -> None:
        """Flush and close all files."""
        self._file.close()
        for board in self._boards.values():
            board.close()


def read_metrics(path: str | Path) -> list[dict[str, Any]]:
    """Read the rows of a ``metrics.jsonl``; a last line cut short by a crash is left out.

    Raises:
        SwingupError: the file cannot be read, or another line is not JSON.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise SwingupError(f"cannot read {path}: {error.strerror}") from error
    rows = []
    for number, line in enumerate(lines, start=1):
        try:
            row = json.loads(line)
            row["frames"], row["seed"]
            rows.append(row)
        except (ValueError, TypeError, KeyError) as error:
            if number < len(lines):
                raise SwingupError(f"{path} line {number} is no row of metrics: remove or mend the line") from error
    return rows
