"""A run's metrics: a :class:`Row` for each report and seed, in ``metrics.jsonl`` and as TensorBoard events.

A continuing task is reported by its reward rate and its resets per 1,000 steps. The reward rate is the mean reward
of a step, as measured. The gain ρ is the learner's estimate of it for the exploring policy, less what its resets
cost. A reset is a termination of the task itself. A truncation is not a reset: the process would continue, and only
the caller starts it anew.
"""

import contextlib
import dataclasses
import json
import math
import os
import socket
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..common.arrays import finite
from ..common.checks import is_number, whole_number
from ..common.errors import SwingupError
from ..common.files import write_atomically

if TYPE_CHECKING:
    from ..areapo.state import Metrics
    from ..benchmark.board import Criteria

METRICS_FILE = "metrics.jsonl"
REWARD_RATE, REWARD_PER_SECOND = "reward_rate", "reward_per_second"
RESETS = "resets_per_1000_steps"
SUCCESS_RATE = "success_rate"
OPTIONAL = REWARD_PER_SECOND, SUCCESS_RATE  # Entries of an evaluation that a task without them leaves out

MISSING = "–"  # Shown where a number was not recorded


@dataclass(frozen=True)
class Evaluation:
    """The result of an evaluation of a deterministic policy."""

    score: float | None
    """Mean return, of a continuing task its reward rate, of a robot the RealAI score; None: no episode ended."""
    mean_length: float | None = None  # Mean length of the episodes (steps)
    reward_rate: float | None = None  # Mean reward of a step
    resets_per_1000_steps: float | None = None  # Terminations of the task itself
    reward_per_second: float | None = None
    """Reward rate over the time of a step; None where a step has no known time."""
    success_rate: float | None = None  # Share of the episodes that end as a success; None where the task names none
    criteria: "Criteria | None" = None  # What a robot's swing-up is judged by, in place of all but the score

    def as_dict(self) -> dict[str, Any]:
        """The entries of policy files and rows."""
        if self.criteria is not None:
            return dataclasses.asdict(self.criteria)
        values = {name: value for name, value in vars(self).items() if name != "criteria"}
        return {name: value for name, value in values.items() if name not in OPTIONAL or value is not None}


@dataclass(frozen=True)
class HostMetrics:
    """What is recorded where the host steps the environments."""

    episode_return: float | None  # Mean return of the episodes that ended; None where none ended
    episode_length: float | None  # Their mean length (steps)
    episode_success: float | None  # Share of successes; None where the environments do not say
    longest_pause: float  # Longest time between an answer of the environments and the next actions (s)
    late_steps: int  # Steps of a stream that came too late, not counting the first after an update


@dataclass(frozen=True)
class TrainingMetrics:
    """What one seed did in the iterations since the last report."""

    means: "Metrics"  # Means over the iterations
    host: HostMetrics | None = None  # None where the task is compiled

    @property
    def ended(self) -> bool:
        """Whether an episode ended, as far as is known."""
        return self.host is None or self.host.episode_length is not None

    def as_dict(self) -> dict[str, float | None]:
        """Flat, as Python's numbers."""
        return self.means.as_dict() | ({} if self.host is None else vars(self.host))


@dataclass(frozen=True)
class Row:
    """A report of one seed: ``as_dict`` is a row of ``metrics.jsonl``."""

    seed: int
    frames: int
    """Frames of the seed so far."""
    seconds: float
    """Time of the run so far (s)."""
    frames_per_second: float
    """Frames of all seeds together in a second, since the last report."""
    training: TrainingMetrics
    evaluation: Evaluation
    best_score: float | None
    """Best score of the seed so far."""

    @property
    def score(self) -> float | None:
        """Score of the evaluation; None where no episode ended that gives one."""
        return self.evaluation.score

    @property
    def reward(self) -> float:
        """Mean reward of a step of the exploring policy."""
        return float(self.training.means.reward)

    @property
    def gain(self) -> float:
        """The learner's estimate of ρ."""
        return float(self.training.means.gain)

    @property
    def resets_per_1000_steps(self) -> float:
        """Terminations of the exploring policy's steps."""
        return 1000.0 * float(self.training.means.termination_rate)

    def as_dict(self) -> dict[str, Any]:
        """Flat, as JSON values: numbers that are not finite become null."""
        head = {"seed": self.seed, "frames": self.frames}
        times = {"seconds": round(self.seconds, 3), "frames_per_second": round(self.frames_per_second, 1)}
        measured = self.training.as_dict() | self.evaluation.as_dict()
        return dict(finite(head | times | measured | {"best_score": self.best_score}))


class MetricsWriter(contextlib.AbstractContextManager["MetricsWriter"]):
    """Appends reports to a run's folder; a run that is resumed drops the reports after its checkpoint."""

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
        on_failure = self._errors_in_words() if error is None else contextlib.suppress(OSError)
        with on_failure, contextlib.ExitStack() as closing:
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
        values = [
            self._summary.Value(tag=name, simple_value=value)
            for name, value in row.items()
            if name not in ("seed", "frames") and isinstance(value, int | float) and math.isfinite(value)
        ]
        self._add(row["frames"], summary=self._summary(value=values))
        self._records.flush()

    def close(self) -> None:
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
    row = json.loads(line)
    # Python reads NaN and infinities, which JSON does not have.
    if not isinstance(row, dict) or any(isinstance(v, dict | list) or finite(v) != v for v in row.values()):
        raise TypeError("a row is one level of names, and finite numbers, words and nulls")
    return row | {name: whole_number(name, row[name], 0) for name in ("seed", "frames")}


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


def make_evaluation(
    score: float | None,
    mean_length: float | None,
    reward_rate: float,
    termination_rate: float,
    step_time: float | None = None,
) -> Evaluation:
    """An evaluation from terminations a step and the seconds of a step, if it has a time."""
    per_second = None if step_time is None else reward_rate / step_time
    return Evaluation(score, mean_length, reward_rate, 1000.0 * termination_rate, per_second)


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
