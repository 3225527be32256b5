"""One run of a sweep, and many of them on any ``concurrent.futures.Executor``."""

import contextlib
import math
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..common.errors import SwingupError
from ..common.files import write_atomically
from ..common.text import one_line
from ..learner.metrics import METRICS_FILE, read_metrics
from ..learner.rates import RESETS, REWARD_RATE
from ..learner.run import Run
from ..learner.run_folder import RunFolder
from ..learner.run_settings import read_run_settings, run_settings_from_dict
from ..learner.start import resume_run, start_run
from .signals import in_progress

PRUNED = "pruned"
"""An empty file in a run's folder that asks for the run's end."""


@dataclass(frozen=True)
class Job:
    """One run of a sweep, in a form that travels between processes."""

    variant: str
    """Its varied settings as text; empty if nothing varies."""
    settings: dict[str, Any]
    folder: str
    frames: int


@dataclass(frozen=True)
class JobOutcome:
    """The result of a job."""

    job: Job
    score: float
    """Score of the last policy."""
    best_score: float
    error: str = ""
    """The reason why there is no score; empty where there is one."""
    reward_rate: float = math.nan
    """Of the last policy's evaluation; NaN where the score is none of episodes."""
    resets_per_1000_steps: float = math.nan
    """Likewise."""
    pruned: bool = False
    """Whether the run was ended early, since a search expects no more from it."""


def run_jobs(
    jobs: Sequence[Job], executor: Executor, progress: Callable[[JobOutcome], None] | None = None
) -> list[JobOutcome]:
    """Run all jobs that are not done yet; a job that fails does not stop the others.

    Args:
        jobs: the jobs.
        executor: a process pool, Dask's ``Client.get_executor()``, submitit's, or any other.
        progress: called with each outcome as it comes.

    Raises:
        SwingupError: the executor lost its workers; the same sweep continues from the checkpoints.
    """
    futures = {executor.submit(train_one, job): index for index, job in enumerate(jobs)}
    outcomes: dict[int, JobOutcome] = {}
    for future in as_completed(futures):
        outcomes[futures[future]] = outcome = outcome_of(future, jobs[futures[future]])
        if progress is not None:
            progress(outcome)
    return [outcomes[index] for index in sorted(outcomes)]


def outcome_of(future: Future[JobOutcome], job: Job) -> JobOutcome:
    """The outcome of a job that has ended on an executor.

    Raises:
        SwingupError: the executor lost its workers.
    """
    try:
        return future.result()
    except BrokenExecutor as error:
        raise SwingupError("a worker of the sweep died: give the same command again, it goes on") from error
    except Exception as error:  # train_one returns its errors: this one is the executor's
        return _failed(job, error)


def train_one(job: Job) -> JobOutcome:
    """Run one job, or the rest of it, in the calling process; errors become part of the outcome."""
    try:
        with contextlib.closing(_open(job)) as run:
            in_progress.append(run)
            try:
                for _ in run.advance():
                    if is_pruned(job):
                        run.stop()
            finally:
                in_progress.remove(run)
        early = run.frames < job.frames
        # A signal stopped it in a local worker, which ends now that the run is saved.
        if early and not is_pruned(job):
            signal.raise_signal(signal.SIGTERM)
        rows = read_metrics(Path(job.folder) / METRICS_FILE)
        if not rows:
            raise SwingupError(f"{job.folder} holds no metrics: remove it to train again")
        last = rows[-1]
        scores = _number(last["score"]), _number(last["best_score"])
        # A file of an older version, and one of the pendulum, has no rates.
        return JobOutcome(job, *scores, "", _number(last.get(REWARD_RATE)), _number(last.get(RESETS)), early)
    except Exception as error:
        return _failed(job, error)


def prune(job: Job) -> None:
    """Ask for the end of a job, on whatever worker it runs, after the chunk in progress."""
    write_atomically(Path(job.folder) / PRUNED, b"")


def is_pruned(job: Job) -> bool:
    """Whether the end of a job was asked for."""
    return (Path(job.folder) / PRUNED).exists()


def _failed(job: Job, error: Exception) -> JobOutcome:
    words = str(error) if isinstance(error, SwingupError) else f"{type(error).__name__}: {one_line(error)}"
    return JobOutcome(job, float("nan"), float("nan"), words)


def _open(job: Job) -> Run:
    """A new run, or the one in the folder from its checkpoint."""
    folder, settings = RunFolder(job.folder), run_settings_from_dict(job.settings)
    # Two workers must not start the same run. Training then takes the lock itself.
    with folder.exclusive():
        if not folder.has_checkpoint():
            folder.clear()  # killed before its first checkpoint
            return start_run(settings, folder.path, job.frames)
    if read_run_settings(folder.path)[0].as_dict() != job.settings:
        raise SwingupError(f"{folder} holds a run with other settings: choose another --out")
    run = resume_run(folder.path)
    if run.frames < job.frames:
        run.extend(job.frames - run.frames)
    return run


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)
