"""Sweeps: many training runs over seeds and settings, on any ``concurrent.futures.Executor``.

Each run has its own folder and is a run like any other: one that is finished is not repeated, one that was cut off
resumes from its checkpoint, wherever it is started next. Workers on other machines need the same file system.
"""

import contextlib
import itertools
import multiprocessing
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from .areapo.config import Config, config_from_dict
from .benchmark.interval import Interval, bootstrap_interval, interquartile_mean
from .errors import SwingupError
from .learner.metrics import FILE, read_metrics
from .learner.presets import get_preset
from .learner.run import Run
from .learner.run_folder import RunFolder
from .learner.run_settings import Settings, read_settings, settings_from_dict, whole

Grid = Mapping[str, Sequence[Any]]
"""Alternatives of each setting: names of the hyperparameters, or ``preset``."""


@dataclass(frozen=True)
class Job:
    """One run of a sweep, in a form that travels between processes."""

    variant: str
    """Its settings in words; empty where nothing is varied."""
    settings: dict[str, Any]
    folder: str
    frames: int


@dataclass(frozen=True)
class Outcome:
    """What a job came to."""

    job: Job
    score: float
    """Score of the last policy."""
    best_score: float
    error: str = ""
    """Why there is no score, if there is none."""


@dataclass(frozen=True)
class Row:
    """A variant's runs."""

    variant: str
    runs: int
    """Runs with a score."""
    failed: int
    score: float
    """Interquartile mean of the last scores."""
    interval: Interval
    """Its 95 % bootstrap interval."""
    best: float
    """Interquartile mean of the best scores."""


def plan(
    base: Mapping[str, Any], grid: Grid, seeds: Sequence[int], out: str | Path, frames: int | None = None
) -> list[Job]:
    """The jobs of a sweep: every combination of the grid with every seed.

    Args:
        base: fields of :class:`swingup.learner.run_settings.Settings` that all runs share, but for seed and config.
        grid: what varies.
        seeds: the seeds.
        out: folder of the sweep; each run's is in it.
        frames: length of the runs; by default the preset's.

    Raises:
        SwingupError: a setting is unknown or cannot work, two runs would be the same, or presets that are to be
            compared have runs of different lengths.
    """
    presets = {name: get_preset(name).frames for name in grid.get("preset", [base["preset"]])}
    if frames is None and len(set(presets.values())) > 1:
        lengths = ", ".join(f"{name} {length:,}" for name, length in presets.items())
        raise SwingupError(f"presets have runs of different lengths ({lengths} frames): give --frames")
    jobs: list[Job] = []
    for values in itertools.product(*grid.values()):
        chosen = dict(zip(grid, values, strict=True))
        words = [f"{name}={format_value(value)}" for name, value in chosen.items()]
        preset = chosen.pop("preset", base["preset"])
        config = config_from_dict(vars(get_preset(preset).config) | chosen)
        for seed in seeds:
            settings = Settings(**{**base, "preset": preset, "seed": seed, "seeds": 1}, config=config)
            folder = Path(out).absolute() / (",".join(words) or "base") / f"seed-{seed}"
            length = presets[preset] if frames is None else whole("frames", frames, 1)
            jobs.append(Job(" ".join(words), settings.as_dict(), str(folder), length))
    for path, count in Counter(job.folder for job in jobs).items():
        if count > 1:
            raise SwingupError(f"{path} would hold {count} runs: give each alternative and each seed once")
    return jobs


def parse_grid(assignments: Sequence[str]) -> dict[str, list[Any]]:
    """Alternatives from words like ``learning_rate=3e-4,5e-4`` or ``policy_layers=64x64,128x128``.

    Raises:
        SwingupError: a word is no assignment, a name is unknown, or a value is of another type.
    """
    grid: dict[str, list[Any]] = {}
    for assignment in assignments:
        name, equals, values = assignment.partition("=")
        name = name.replace("-", "_")
        usual = "" if name == "preset" else vars(Config()).get(name)
        if not equals or usual is None:
            raise SwingupError(f"--set {assignment}: write NAME=VALUE,VALUE with a hyperparameter's name or preset")
        grid.setdefault(name, []).extend(_parse(assignment, text, usual) for text in values.split(","))
    return grid


def _parse(assignment: str, text: str, usual: Any) -> Any:
    """A value of the type of the usual one."""
    try:
        if isinstance(usual, bool):
            return {"true": True, "false": False}[text.lower()]
        if isinstance(usual, tuple):
            return tuple(int(part) for part in text.split("x"))
        return type(usual)(text)
    except (KeyError, ValueError) as error:
        wanted = "numbers like 64x64" if isinstance(usual, tuple) else type(usual).__name__
        raise SwingupError(f"--set {assignment}: {text!r} must be {wanted}") from error


def format_value(value: Any) -> str:
    """A value as ``parse_grid`` reads it."""
    return "x".join(map(str, value)) if isinstance(value, tuple) else str(value)


def sweep(
    jobs: Sequence[Job], executor: Executor, progress: Callable[[Outcome], None] | None = None
) -> list[Outcome]:
    """Do all jobs that are not done yet; a job that fails does not keep the others from running.

    Args:
        jobs: what to run.
        executor: where: a process pool, Dask's ``Client.get_executor()``, submitit's, or any other.
        progress: told each outcome as it comes.

    Raises:
        SwingupError: the executor lost its workers; the same sweep goes on from the checkpoints.
    """
    futures = {executor.submit(train_one, job): index for index, job in enumerate(jobs)}
    outcomes: dict[int, Outcome] = {}
    for future in as_completed(futures):
        try:
            outcome = future.result()
        except BrokenExecutor as error:
            raise SwingupError("a worker of the sweep died: give the same command again, it goes on") from error
        except Exception as error:  # what an executor has to say of a job that it gave up
            outcome = _failed(jobs[futures[future]], error)
        outcomes[futures[future]] = outcome
        if progress is not None:
            progress(outcome)
    return [outcomes[index] for index in sorted(outcomes)]


def train_one(job: Job) -> Outcome:
    """Do one job, or what is left of it, in the process that calls this; what goes wrong is in the outcome."""
    try:
        with contextlib.closing(_open(job)) as run:
            _in_progress.append(run)
            try:
                for _ in run.advance():
                    pass
            finally:
                _in_progress.remove(run)
        if run.frames < job.frames:  # a signal stopped it, in a worker of ours
            signal.raise_signal(signal.SIGTERM)
        rows = read_metrics(Path(job.folder) / FILE)
        if not rows:
            raise SwingupError(f"{job.folder} holds no metrics: remove it to train again")
        return Outcome(job, _number(rows[-1]["score"]), _number(rows[-1]["best_score"]))
    except Exception as error:
        return _failed(job, error)


def _failed(job: Job, error: Exception) -> Outcome:
    words = str(error) if isinstance(error, SwingupError) else f"{type(error).__name__}: {error}"
    return Outcome(job, float("nan"), float("nan"), words)


def _open(job: Job) -> Run:
    """A run's beginning, or where its folder has it."""
    folder, settings = RunFolder(job.folder), settings_from_dict(job.settings)
    with folder.exclusive():
        if not folder.has_checkpoint():
            folder.clear()  # killed before there was anything to lose
            return Run(settings, folder.path, job.frames)
    if read_settings(folder.path)[0].as_dict() != job.settings:
        raise SwingupError(f"{folder} holds a run with other settings: choose another --out")
    run = Run.resume(folder.path)
    if run.frames < job.frames:
        run.extend(job.frames - run.frames)
    return run


_in_progress: list[Run] = []
"""What this process trains."""


def _obey_signals() -> None:
    """In a local worker: Ctrl-C and SIGTERM end the run in progress after its chunk, saved, and then the worker."""

    def end(number: int, frame: FrameType | None) -> None:
        if number == signal.SIGINT or not _in_progress:  # a second Ctrl-C does not wait
            signal.signal(number, signal.SIG_DFL)
        if not _in_progress:
            signal.raise_signal(number)
        for run in _in_progress:
            run.stop()

    signal.signal(signal.SIGINT, end)
    signal.signal(signal.SIGTERM, end)


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def summarise(outcomes: Sequence[Outcome]) -> list[Row]:
    """One row a variant, in the order of the jobs."""
    rows = []
    for variant in dict.fromkeys(outcome.job.variant for outcome in outcomes):
        mine = [outcome for outcome in outcomes if outcome.job.variant == variant]
        good = [outcome for outcome in mine if outcome.score == outcome.score]
        scores, best = [o.score for o in good], [o.best_score for o in good]
        none = float("nan")
        rows.append(
            Row(
                variant=variant,
                runs=len(good),
                failed=len(mine) - len(good),
                score=interquartile_mean(scores) if scores else none,
                interval=bootstrap_interval(scores) if scores else (none, none),
                best=interquartile_mean(best) if best else none,
            )
        )
    return rows


@contextlib.contextmanager
def executor_for(scheduler: str | None, workers: int | None) -> Iterator[Executor]:
    """A Dask cluster's executor where there is an address, else a pool of fresh local processes.

    Args:
        scheduler: address of a running Dask scheduler, such as ``tcp://10.0.0.1:8786``.
        workers: local processes; by default one for every two cores, since a run uses about two.

    Raises:
        SwingupError: Dask is not installed, its scheduler does not answer, or there are no workers.
    """
    if workers is not None and workers < 1:
        raise SwingupError(f"workers = {workers} must be at least 1")
    if scheduler is None:
        count = workers or max(1, (os.cpu_count() or 1) // 2)
        # Fresh processes: JAX does not survive a fork.
        others = set(multiprocessing.active_children())
        with ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), _obey_signals) as pool:
            try:
                yield pool
            except BaseException:
                for worker in set(multiprocessing.active_children()) - others:
                    worker.terminate()
                pool.shutdown(cancel_futures=True)
                raise
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise SwingupError("--scheduler needs Dask: pip install 'swingup[dask]'") from error
    try:
        client = Client(scheduler, timeout=5)
    except (OSError, ValueError) as error:
        raise SwingupError(f"no Dask scheduler answers at {scheduler}: start one with dask scheduler") from error
    with client, client.get_executor() as executor:
        try:
            yield executor
        except BaseException:
            executor.shutdown(wait=False)  # gives up what was not begun
            raise
