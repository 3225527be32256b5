"""One run of a sweep, and many of them on any ``concurrent.futures.Executor``."""

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, as_completed
from dataclasses import dataclass, field
from typing import Any

from ..common.errors import SwingupError
from ..common.text import one_line
from ..learner.metrics import METRICS_FILE, read_metrics
from ..learner.run import Run
from ..learner.run_folder import RunFolder
from ..learner.run_settings import RunSettings, read_run_settings, run_settings_from_dict
from ..learner.start import resume_run, start_run

Row = Mapping[str, Any]
"""A row of a run's metrics."""


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
    row: Row = field(default_factory=dict)
    """The last metrics of the run."""
    error: str = ""
    """The reason why there is no score; empty where there is one."""
    pruned: bool = False
    """Whether the run was ended early, since a search expects no more of it."""

    def number(self, name: str) -> float:
        """One of the last metrics; NaN where it was not recorded."""
        value = self.row.get(name)
        return math.nan if value is None else float(value)


def run_jobs(
    jobs: Sequence[Job], executor: Executor, progress: Callable[[JobOutcome], None] | None = None
) -> list[JobOutcome]:
    """Run all jobs that are not done yet; a job that fails does not stop the others.

    Args:
        jobs: the jobs.
        executor: a process pool, Dask's ``Client.get_executor()``, submitit's, or any other.
        progress: called with each outcome as it comes.
    """
    futures = {executor.submit(train_one, job): job for job in jobs}
    outcomes: dict[str, JobOutcome] = {}
    for future in as_completed(futures):
        job = futures[future]
        outcomes[job.folder] = outcome = _outcome(future, job)
        if progress is not None:
            progress(outcome)
    return [outcomes[job.folder] for job in jobs]


def train_one(job: Job, is_hopeless: Callable[[Row], bool] | None = None) -> JobOutcome:
    """Run one job, or the rest of it, in the calling process; errors become part of the outcome.

    Args:
        job: the job.
        is_hopeless: called with the metrics of each evaluation; the run ends early once it returns true.
    """
    try:
        folder, settings = RunFolder(job.folder), run_settings_from_dict(job.settings)
        row, pruned = _row_at_end(folder, settings, job.frames), False
        if row is None:
            with contextlib.closing(_open(folder, settings, job.frames)) as run:
                for report in run.advance():
                    row = report.rows[0]
                    if is_hopeless is not None and is_hopeless(row):
                        run.stop()
                        pruned = True
        if row is None:
            raise SwingupError(f"{folder} is complete but its metrics are not: remove it to train again")
        return JobOutcome(job, row, pruned=pruned)
    except Exception as error:
        return JobOutcome(job, error=describe_error(error))


def describe_error(error: BaseException) -> str:
    """Why a run has no score."""
    if isinstance(error, BrokenExecutor):
        return "its worker died (was memory short?): the same command continues it"
    return str(error) if isinstance(error, SwingupError) else f"{type(error).__name__}: {one_line(error)}"


def _outcome(future: Future[JobOutcome], job: Job) -> JobOutcome:
    try:
        return future.result()
    except Exception as error:  # train_one returns its errors: this one is the executor's
        return JobOutcome(job, error=describe_error(error))


def _row_at_end(folder: RunFolder, settings: RunSettings, frames: int) -> Row | None:
    """The metrics after so many frames of a run that got there, and perhaps further; None if it has to be trained.

    Raises:
        SwingupError: the folder holds a run with other settings, or its metrics cannot be read.
    """
    if not folder.has_checkpoint():
        return None
    if read_run_settings(folder.path)[0] != settings:
        raise SwingupError(f"{folder} holds a run with other settings: choose another --out")
    path, rollout = folder.path / METRICS_FILE, settings.config.rollout_size
    end = math.ceil(frames / rollout) * rollout
    # Metrics are written before their checkpoint: a run that was killed between the two has to go on.
    if folder.newest_frames() < end or not path.exists():
        return None
    return next((row for row in read_metrics(path) if row["frames"] == end), None)


def _open(folder: RunFolder, settings: RunSettings, frames: int) -> Run:
    """A new run, or the one in the folder from its checkpoint."""
    # Two workers must not start the same run. Training then takes the lock itself.
    with folder.exclusive():
        if not folder.has_checkpoint():
            folder.clear()  # killed before its first checkpoint
            return start_run(settings, folder.path, frames)
    return resume_run(folder.path, frames)
