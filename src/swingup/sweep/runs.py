"""The runs of a sweep, one for each combination of alternatives and seed, in folders of their own; their table."""

import contextlib
import dataclasses
import itertools
import math
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
)
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from ..areapo.config import NEEDED, check_hyperparameter, format_value, parse_value, why_without_effect
from ..benchmark.values import interquartile_interval, interquartile_mean
from ..common import cores
from ..common.checks import is_number, one_of, whole_number
from ..common.errors import SwingupError, needing, one_line
from ..learner.metrics import METRICS_FILE, RESETS, REWARD_RATE, read_metrics
from ..learner.presets import PRESETS, get_preset
from ..learner.run import resume_run, start_run
from ..learner.run_folder import RunFolder
from ..learner.run_settings import RunSettings, config_for, read_run_settings

Row = Mapping[str, Any]  # A row of a run's metrics
MAX_RUNS = 10_000  # A sweep of more runs is taken for a typing error
LOCK_SECONDS = 10.0
"""How long a run waits for its folder (s): a worker of a sweep that was killed may hold it for a moment longer."""


@dataclass(frozen=True)
class Job:
    """One run of a sweep, in a form that travels between processes."""

    variant: str  # Its varied settings as text; empty if nothing varies
    settings: RunSettings
    folder: Path
    frames: int


def plan_jobs(
    base: RunSettings,
    grid: Mapping[str, Sequence],
    seeds: Sequence[int],
    out: str | Path,
    frames: int | None = None,
) -> list[Job]:
    """The jobs of a sweep: every combination of the grid with every seed.

    The grid has alternatives by the name of a hyperparameter, or ``preset``. Without a number of frames a run has
    the preset's, of several presets the longest.
    """
    count = math.prod(map(len, grid.values())) * len(seeds)
    if count > MAX_RUNS:
        raise SwingupError(f"this sweep has {count:,} runs: choose at most {MAX_RUNS:,}")
    presets = grid.get("preset", [base.preset])
    check_varied(grid, presets, base)
    length = run_length(frames, presets)
    jobs: list[Job] = []
    for values in itertools.product(*grid.values()):
        chosen = dict(zip(grid, values, strict=True))
        jobs += plan_variant(base, chosen, seeds, Path(out) / (describe(chosen, ",") or "base"), length)
    if len({job.folder for job in jobs}) < len(jobs):
        raise SwingupError("two runs of the sweep are the same: give each alternative and each seed once")
    return jobs


def plan_variant(base: RunSettings, chosen: Mapping, seeds: Sequence[int], folder: Path, frames: int) -> list[Job]:
    """The jobs of one choice of settings: one for each seed, in folders of their own below ``folder``."""
    changes = dict(chosen)
    preset = base.problem.choose_preset(changes.pop("preset", base.preset))
    config = config_for(base.problem, preset, base.changes | changes)
    base = dataclasses.replace(base, preset=preset, config=config, seeds=1)
    runs = [dataclasses.replace(base, seed=seed) for seed in seeds]
    # Absolute, since workers may have another working directory.
    return [Job(describe(chosen), run, folder.absolute() / f"seed-{run.seed}", frames) for run in runs]


def check_varied(names: Iterable[str], presets: Sequence[str], base: RunSettings) -> None:
    """Refuse settings that vary without effect in any preset, unless what they need varies too.

    Fixed hyperparameters are refused beside several presets, whose own differences from each other they would hide.
    """
    varied, configs = list(names), [base.config]
    if "preset" in varied:
        if fixed := [name for name in base.changes if name not in varied]:
            raise SwingupError(f"{', '.join(fixed)} cannot stay fixed where the preset varies: vary it too")
        configs = [config_for(base.problem, base.problem.choose_preset(each), {}) for each in presets]
    for name in varied:
        if NEEDED.get(name, ("",))[0] not in varied:
            vain = [why_without_effect(name, config) for config in configs]
            if vain[0] is not None and all(vain):
                raise SwingupError(vain[0])


def run_length(frames: int | None, presets: Sequence[str]) -> int:
    """Frames of each run; by default those of the preset with the longest runs, so that all runs compare."""
    return max(get_preset(name).frames for name in presets) if frames is None else whole_number("frames", frames, 1)


def describe(chosen: Mapping[str, Any], separator: str = " ") -> str:
    """Settings as words like ``learning_rate=0.001``."""
    return separator.join(f"{name}={format_value(value)}" for name, value in chosen.items())


def parse_alternatives(name: str, text: str) -> list[Any]:
    """The alternatives of a hyperparameter, or of ``preset``, that commas separate."""
    if name == "preset":
        return [one_of("preset", part, PRESETS) for part in text.split(",")]
    check_hyperparameter(name, ["preset"])
    if ":" in text:
        raise SwingupError(f"{name}={text} is a range: give --trials to search it, or alternatives")
    return [parse_value(name, part) for part in text.split(",")]


def run_jobs(
    jobs: Sequence[Job], executor: Executor, progress: Callable[[Job, Row], None] = lambda job, row: None
) -> list[Row]:
    """Run all jobs that are not done yet; a job that fails does not stop the others.

    ``progress`` is called with each job that ends and its row: its last metrics, or only its ``error``.
    """
    futures = {executor.submit(train_one, job): job for job in jobs}
    rows: dict[Path, Row] = {}
    for future in as_completed(futures):
        job, error = futures[future], future.exception()
        rows[job.folder] = row = future.result() if error is None else {"error": describe_error(error)}
        progress(job, row)
    return [rows[job.folder] for job in jobs]


def train_one(job: Job, report: Callable[[Row], None] = lambda row: None) -> Row:
    """Run one job, or the rest of it, in the calling process; its last metrics.

    ``report`` is called with the metrics of each evaluation; what it raises ends the run.
    """
    folder, metrics, row = RunFolder(job.folder), job.folder / METRICS_FILE, None
    rollout = job.settings.config.rollout_size
    end = math.ceil(job.frames / rollout) * rollout
    if folder.has_checkpoint() or metrics.exists():
        if read_run_settings(job.folder)[0] != job.settings:
            raise SwingupError(f"{folder} holds a run with other settings: choose another --out")
        # Metrics are written before their checkpoint: a run that was killed between the two has to go on.
        if folder.newest_frames(end) >= end and metrics.exists():
            row = next((each for each in read_metrics(metrics) if each["frames"] == end), None)
    if row is None:
        # Two workers must not start the same run; training then takes the lock itself.
        with folder.exclusive(LOCK_SECONDS):
            if folder.has_checkpoint():
                run = resume_run(job.folder, job.frames)
            elif metrics.exists():
                raise SwingupError(
                    f"{folder} has metrics and no checkpoint: restore its checkpoints, or remove it to train again"
                )
            else:
                folder.clear()  # killed before its first checkpoint
                run = start_run(job.settings, job.folder, job.frames)
        with contextlib.closing(run):
            for each in run.advance():
                row = each.rows[0].as_dict()
                report(row)
    if row is None:
        raise SwingupError(f"{folder} is complete but its metrics are not: remove it to train again")
    return row


def describe_error(error: BaseException) -> str:
    """Why a run has no score."""
    if isinstance(error, BrokenExecutor):
        return "its worker died (was memory short?): the same command continues it"
    return str(error) if isinstance(error, SwingupError) else f"{type(error).__name__}: {one_line(error)}"


def summarise(jobs: Sequence[Job], rows: Sequence[Row]) -> list[dict[str, Any]]:
    """The table of a sweep: one row for each variant, in the order of the jobs.

    A row has its ``variant`` (text), ``runs`` with a score, ``failed`` ones, and interquartile means over the runs:
    of the last ``score`` with its 95 % bootstrap ``interval`` (None for fewer than two runs), of ``best_score``,
    and of the last policies' ``reward_rate`` and ``resets_per_1000_steps``. A number is NaN if a run lacks it.
    """
    table = []
    for variant in dict.fromkeys(job.variant for job in jobs):
        mine = [row for job, row in zip(jobs, rows, strict=True) if job.variant == variant]
        good = [row for row in mine if is_number(row.get("score"))]
        interval = interquartile_interval([row["score"] for row in good])
        counts = {"variant": variant, "runs": len(good), "failed": len(mine) - len(good)}
        scores = {"score": _middle(good, "score"), "interval": interval and list(interval)}
        table.append(counts | scores | {name: _middle(good, name) for name in ("best_score", REWARD_RATE, RESETS)})
    return table


def _middle(rows: Sequence[Row], name: str) -> float:
    # A mean of the runs that have the value would hide the others.
    values = [row[name] for row in rows if is_number(row.get(name))]
    return float(interquartile_mean(values)) if values and len(values) == len(rows) else math.nan


@contextlib.contextmanager
def executor_for(scheduler: str | None = None, workers: int | None = None) -> Iterator[Executor]:
    """An executor of local processes, or of the workers at a Dask scheduler's address.

    There is one process for every two cores, unless a number is given: a run uses about two.
    """
    if scheduler is None:
        with _local_processes(
            whole_number("workers", max(1, cores() // 2) if workers is None else workers, 1, 1024)
        ) as executor:
            yield executor
        return
    if workers is not None:
        raise SwingupError(f"--workers {workers} does not go with --scheduler: its cluster has workers of its own")
    with needing("Dask", "dask", "--scheduler"):
        from distributed import Client
    try:
        client = Client(scheduler, timeout=5)
    except (OSError, ValueError) as error:
        raise SwingupError(f"no Dask scheduler answers at {scheduler}: start one with dask scheduler") from error
    with client, client.get_executor() as executor:
        try:
            yield executor
        except BaseException:
            executor.shutdown(wait=False)  # cancels the runs that have not started
            raise


@contextlib.contextmanager
def _local_processes(count: int) -> Iterator[Executor]:
    """Threads that run each call in a fresh process; the processes end with an interrupt and with this process.

    One ProcessPoolExecutor of many processes would do less: where one of them dies, for example by its need for
    memory, that pool ends all others as well.
    """
    context = multiprocessing.get_context("spawn")  # JAX does not survive a fork
    # Nothing is ever sent. The system closes our end when this process dies, even by SIGKILL.
    lifeline, ours = context.Pipe(duplex=False)

    class FreshProcesses(ThreadPoolExecutor):
        def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
            def run() -> Any:
                with ProcessPoolExecutor(1, context, _begin_worker, (lifeline,)) as pool:
                    return pool.submit(fn, *args, **kwargs).result()

            return super().submit(run)

    with lifeline, ours, FreshProcesses(count) as executor:
        try:
            yield executor
        except BaseException:  # Ctrl-C is not an Exception
            ours.close()
            executor.shutdown(cancel_futures=True)
            raise


def _begin_worker(lifeline: Connection) -> None:
    """Let a worker leave Ctrl-C to the process that started it, print where that does not, and end with it."""
    os.dup2(2, 1)  # standard output may be the parent's JSON

    def wait_for_end() -> None:
        with contextlib.suppress(EOFError, OSError):
            lifeline.recv_bytes()
        os._exit(1)  # the run resumes from its checkpoint

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=wait_for_end, daemon=True).start()
