"""A run's metrics: ``metrics.jsonl``, one line a report and seed, and TensorBoard events beside it.

A continuing task is reported by its reward rate and its resets per 1,000 steps. The reward rate is the mean reward
of a step, as measured. The gain ρ is the learner's estimate of it for the exploring policy, less what its resets
cost. A reset is a termination of the task itself. A truncation is not a reset: the process would continue, and only
the caller starts it anew.
"""

import contextlib
import json
import math
import os
import socket
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ..common.checks import is_number, whole_number
from ..common.errors import SwingupError
from ..common.files import write_atomically

METRICS_FILE = "metrics.jsonl"
REWARD_RATE, REWARD_PER_SECOND = "reward_rate", "reward_per_second"
RESETS = "resets_per_1000_steps"

MISSING = "–"
"""Shown where a number was not recorded."""


class MetricsWriter(contextlib.AbstractContextManager["MetricsWriter"]):
    """Appends reports to a run's folder; resuming drops those after the checkpoint.

    A file that cannot be written is a :class:`SwingupError`.
    """

    def __init__(self, folder: Path, after_frames: int = 0) -> None:
        """Open the files of a run that has trained for ``after_frames``."""
        self._folder, self._start = folder, after_frames
        path = folder / METRICS_FILE
        # A resumed run trains again what came after its checkpoint, and would write these rows twice.
        kept = [row for row in read_metrics(path) if row["frames"] <= after_frames] if path.exists() else []
        write_atomically(path, "".join(json.dumps(row) + "\n" for row in kept).encode())
        self._boards: dict[int, _Board] = {}
        with self._errors_in_words():
            self._file = path.open("a", encoding="utf-8")

    def write(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Append rows that hold at least ``seed`` and ``frames``."""
        with self._errors_in_words():
            for row in rows:
                self._file.write(json.dumps(row) + "\n")
                if row["seed"] not in self._boards:
                    self._boards[row["seed"]] = _Board(
                        self._folder / "tensorboard" / f"seed-{row['seed']}", self._start
                    )
                self._boards[row["seed"]].write(row)
            self._file.flush()

    def sync(self) -> None:
        """Write the rows through to the disk, before their checkpoint."""
        with self._errors_in_words():
            self._file.flush()
            os.fsync(self._file.fileno())

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        """Close all files; a failure to flush is raised only if no other error is in flight."""
        told = self._errors_in_words() if error is None else contextlib.suppress(OSError)
        with told, contextlib.ExitStack() as closing:
            closing.callback(self._file.close)
            for board in self._boards.values():
                closing.callback(board.close)

    @contextlib.contextmanager
    def _errors_in_words(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise SwingupError(
                f"cannot write metrics in {self._folder}: {error.strerror}; make room and resume"
            ) from error


class _Board:
    """TensorBoard's events of one seed.

    Events are written at once. tensorboardX's SummaryWriter has a thread for it: a full disk ends the thread, and
    the next write would wait for it forever.
    """

    def __init__(self, folder: Path, after_frames: int) -> None:
        # Imported here: it takes a third of a second, and only training needs it.
        from tensorboardX.proto.event_pb2 import Event, SessionLog
        from tensorboardX.proto.summary_pb2 import Summary
        from tensorboardX.record_writer import RecordWriter

        self._event, self._summary = Event, Summary
        folder.mkdir(parents=True, exist_ok=True)
        name = f"events.out.tfevents.{int(time.time()):010d}.{socket.gethostname()}.{os.getpid()}.{after_frames}"
        self._records = RecordWriter(str(folder / name))
        self._add(0, file_version="brain.Event:2")
        # TensorBoard then hides the events that an interrupted run wrote after its checkpoint.
        self._add(after_frames + 1, session_log=SessionLog(status=SessionLog.START))

    def write(self, row: Mapping[str, Any]) -> None:
        """Write a row's numbers at its frames."""
        values = [
            self._summary.Value(tag=name, simple_value=value)
            for name, value in row.items()
            if name not in ("seed", "frames") and isinstance(value, int | float) and math.isfinite(value)
        ]
        self._add(row["frames"], summary=self._summary(value=values))
        self._records.flush()

    def close(self) -> None:
        """Close the file."""
        self._records.close()

    def _add(self, step: int, **content: Any) -> None:
        self._records.write(self._event(wall_time=time.time(), step=step, **content).SerializeToString())


def read_metrics(path: str | Path) -> list[dict[str, Any]]:
    """Read the rows of a ``metrics.jsonl``, without a last line that a crash cut short."""
    try:
        # A crash may cut a character in two: replaced, it spoils only the last line.
        lines = Path(path).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise SwingupError(f"cannot read {path}: {error.strerror}") from error
    rows = []
    for number, line in enumerate(lines, start=1):
        try:
            rows.append(_parse_row(line))
        except (ValueError, TypeError, KeyError, RecursionError, SwingupError) as error:
            # Only the last line can be cut short by a crash; another bad line has a cause that the user must see.
            if number < len(lines):
                raise SwingupError(f"{path} line {number} is not a row of metrics: remove or correct it") from error
    return rows


def _parse_row(line: str) -> dict[str, Any]:
    """A row: finite numbers, words and nulls by name, among them the seed and the frames."""
    row = json.loads(line, parse_constant=_refuse)
    if not isinstance(row, dict) or any(isinstance(value, dict | list) for value in row.values()):
        raise TypeError("a row is one level of names and values")
    return row | {name: whole_number(name, row[name], 0) for name in ("seed", "frames")}


def _refuse(constant: str) -> None:
    """JSON has neither NaN nor infinities, although Python reads them."""
    raise ValueError(f"{constant} is not a number")


def step_time(*timed: Any) -> float | None:
    """Seconds of one step: the ``dt`` of the first environment, task or its parameters that has it; None if none.

    Gymnasium's MuJoCo tasks have it, and so have its Pendulum and Acrobot. Wrappers are asked first: one that
    repeats actions can have a ``dt`` of its own.
    """
    for env in timed:
        # A figure for reports must not end a training, whatever a foreign property raises.
        with contextlib.suppress(Exception):
            find = getattr(env, "get_wrapper_attr", None)
            seconds = float(find("dt") if callable(find) else env.dt)
            if math.isfinite(seconds) and seconds > 0.0:
                return seconds
    return None


def rates(reward: float, termination_rate: float, step_time: float | None = None) -> dict[str, float]:
    """The entries of an evaluation's result; a task without time has no seconds of a step."""
    timed = {} if step_time is None else {REWARD_PER_SECOND: reward / step_time}
    return {REWARD_RATE: reward, **timed, RESETS: 1000.0 * termination_rate}


def training_resets(row: Mapping[str, Any]) -> float | None:
    """Resets per 1,000 steps of training in a row of metrics; None in rows of a version that did not count them."""
    rate: Any = row.get("termination_rate")
    return 1000.0 * float(rate) if is_number(rate) else None


def describe_rates(result: Mapping[str, Any]) -> str:
    """Both rates of an evaluation's result in words, with a dash for what it lacks."""
    per_second = result.get(REWARD_PER_SECOND)
    timed = f" ({shown_rate(per_second)} per second)" if is_number(per_second) else ""
    rate, resets = shown_rate(result.get(REWARD_RATE)), shown_rate(result.get(RESETS))
    return f"reward rate {rate} per step{timed}, resets per 1,000 steps {resets}"


def shown_rate(value: Any) -> str:
    """A number in four digits; a dash for anything else."""
    return f"{value:.4g}" if is_number(value) else MISSING
