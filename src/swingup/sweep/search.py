"""A search for hyperparameters: Optuna suggests trials, which train on any ``concurrent.futures.Executor``.

Its folder holds Optuna's storage, a folder for each trial's runs, and ``best.json``. A search that was interrupted
goes on: trials that have ended are not repeated, the others resume from checkpoints.
"""

import contextlib
import itertools
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..areapo.config import Config, format_value, parse_value
from ..benchmark.values import interquartile_mean
from ..common.arrays import write_json
from ..common.checks import is_number, whole_number
from ..common.errors import SwingupError, needing, one_line, quoted
from ..learner.run_folder import RunFolder
from ..learner.run_settings import RunSettings, make_run_settings
from .runs import (
    MOST_RUNS,
    Row,
    describe_error,
    parse_alternatives,
    plan_variant,
    run_length,
    train_one,
    workers_for,
)

if TYPE_CHECKING:
    import optuna

STORAGE = "study.db"
"""Optuna's SQLite file."""
RUNGS = 10
"""Intermediate scores of a run: one a tenth."""


@dataclass(frozen=True)
class SearchPlan:
    """What is searched, in a form that travels between processes."""

    base: RunSettings
    out: Path
    frames: int
    seeds: range


def search(
    env: str,
    space: Mapping[str, str],
    trials: int,
    out: str | Path,
    *,
    frames: int | None = None,
    seed: int = 0,
    seeds: int = 1,
    pruning: bool = True,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: Callable[["optuna.trial.FrozenTrial"], None] | None = None,
    **settings: Any,
) -> "optuna.Study":
    """Search for hyperparameters with Optuna; the same call again goes on.

    Workers are fresh processes, which import the calling script: call this below ``if __name__ == "__main__":``.

    Args:
        env: ``acrobot``, ``pendubot`` or a Gymnasium id, also ``your.module:Task-v0``.
        space: what varies, by the name of a hyperparameter or ``preset``: alternatives such as ``64x64,128x128``,
            or a range such as ``1e-4:1e-2``, or ``1e-4:1e-2:log``, in which equal ratios are equally likely.
        trials: number of trials, those of earlier calls included.
        out: the folder of the search.
        frames: length of each run; by default the preset's, of several presets the longest.
        seed: the first seed of each trial, from which the suggestions follow as well.
        seeds: how many seeds each trial trains, one after the other.
        pruning: whether trials that are worse than the median of the others are cut short.
        workers: trials side by side; by default one for every two cores, or with an executor 1.
        executor: runs the trials, such as Dask's ``Client.get_executor()``; by default local processes.
        progress: called with each trial that ends.
        settings: ``preset`` and ``plant`` of what does not vary, by default those of the task, and
            ``evaluate_every``, ``checkpoint_every`` and ``evaluation_episodes``.

    Returns:
        Optuna's study. A trial's value is the interquartile mean of its seeds' last scores; of a pruned one, the
        last intermediate score. Its user attributes are ``folder``, ``preset``, ``hyperparameters`` (keywords of
        :class:`swingup.AREAPO`), ``command`` (trains its first seed again) and, where it failed, ``error``.

    Raises:
        SwingupError: an argument cannot work, Optuna is not installed, its file is damaged, or the folder holds
            another search or is in use.
    """
    if not isinstance(env, str) or not isinstance(space, Mapping) or not space:
        raise SwingupError(f"env = {quoted(env)}, space = {quoted(space)}: name a Gymnasium id, and what varies")
    distributions = {name: _distribution(name, text) for name, text in space.items()}
    base = make_run_settings(env, **settings)
    length = run_length(frames, space.get("preset", base.preset).split(","))
    seeds, trials = whole_number("seeds", seeds, 1, MOST_RUNS), whole_number("trials", trials, 1, MOST_RUNS)
    first = whole_number("seed", seed, 0, 2**32 - seeds)
    plan = SearchPlan(base, Path(out).absolute(), length, range(first, first + seeds))
    given = None if executor is None else contextlib.nullcontext((executor, workers or 1))
    with given or workers_for(None, workers) as (pool, count), RunFolder(plan.out).exclusive():
        study = _open_study(plan, space, pruning)
        # None first: a kill may have come between a trial's end and the file.
        for trial in itertools.chain([None], _run_trials(plan, study, distributions, trials, pool, count)):
            if (best := best_trial(study)) is not None:
                write_json(plan.out / "best.json", {"trial": best.number, "score": best.value, **best.user_attrs})
            if progress is not None and trial is not None:
                progress(trial)
    return study


def best_trial(study: "optuna.Study") -> "optuna.trial.FrozenTrial | None":
    """The complete trial with the best score; None if no trial is complete."""
    return study.best_trial if any(trial.state.name == "COMPLETE" for trial in study.trials) else None


def train_trial(plan: SearchPlan, trial: "optuna.Trial") -> float:
    """Train a trial's seeds, one after the other, in the calling process: the interquartile mean of their scores.

    Optuna prunes a trial of which it expects no more; settings that do not go together are refused.
    """
    from optuna import TrialPruned

    scores: list[float] = []
    # An interrupted run has reported already.
    reported = set(trial.study.get_trials(deepcopy=False)[trial.number].intermediate_values)

    def report(row: Row) -> None:
        tenth = RUNGS * row["frames"] // plan.frames
        rung = RUNGS * len(scores) + tenth
        # The end of a run is no reason to cut it short.
        if rung not in reported and 0 < tenth < RUNGS and is_number(row["score"]):
            reported.add(rung)
            trial.report(float(interquartile_mean([*scores, row["score"]])), rung)
            if trial.should_prune():
                raise TrialPruned

    # Optuna stores alternatives as text.
    texts = {name for name, value in trial.params.items() if isinstance(value, str) and name != "preset"}
    params = trial.params | {name: parse_value(name, trial.params[name]) for name in texts}
    jobs = plan_variant(plan.base, params, plan.seeds, plan.out / f"trial-{trial.number}", plan.frames)
    settings = jobs[0].settings
    chosen = {name: getattr(settings.config, name) for name in trial.params if name != "preset"}
    trial.set_user_attr("folder", str(jobs[0].folder.parent))
    trial.set_user_attr("preset", settings.preset)
    trial.set_user_attr("hyperparameters", chosen)
    trial.set_user_attr("command", settings.command(plan.frames))
    for job in jobs:
        scores.append(train_one(job, report)["score"])
    if not all(map(is_number, scores)):
        raise SwingupError(f"scores = {scores}: every run needs one, so let it evaluate its policies")
    return float(interquartile_mean(scores))


def _run_trials(
    plan: SearchPlan, study: "optuna.Study", space: dict[str, Any], trials: int, pool: Executor, count: int
) -> Iterator["optuna.trial.FrozenTrial"]:
    """Ask for trials, run them, and tell the study what came of each."""
    from optuna import TrialPruned, samplers
    from optuna.trial import TrialState

    with _storage_errors(plan):
        interrupted = [trial for trial in study.get_trials() if not trial.state.is_finished()]
        for each in interrupted:
            study._storage.set_trial_state_values(each._trial_id, TrialState.WAITING)
        numbers = [*(each.number for each in interrupted), *range(len(study.trials), trials)]
        running: dict[Future[float], optuna.Trial] = {}
        while numbers or running:
            while numbers and len(running) < count:
                # From the number, too: a search that goes on must not draw the first values again.
                source = np.random.SeedSequence([plan.seeds.start, numbers.pop(0)])
                study.sampler = samplers.TPESampler(seed=int(source.generate_state(1)[0]))
                asked = study.ask(space)  # the waiting trials first, with the settings that they have
                running[pool.submit(train_trial, plan, asked)] = asked
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                trial, error = running.pop(future), future.exception()
                told = "" if error is None or isinstance(error, TrialPruned) else describe_error(error)
                if told or "error" in trial.user_attrs:
                    trial.set_user_attr("error", told)
                if error is None:
                    study.tell(trial.number, future.result())
                # A worker's death says nothing of the settings: the trial stays open for the next call.
                elif not isinstance(error, BrokenExecutor):
                    study.tell(trial.number, state=TrialState.FAIL if told else TrialState.PRUNED)
                yield study.trials[trial.number]


def _distribution(name: str, text: str) -> Any:
    """Optuna's form of a range, or of alternatives, which it stores as text."""
    with needing("Optuna", "optuna", "a search"):
        from optuna import distributions
    low, colon, rest = text.partition(":")
    if not colon:
        texts = dict.fromkeys(map(format_value, parse_alternatives(name, text)))
        return distributions.CategoricalDistribution(tuple(texts))
    high, *scale = rest.split(":")
    (least, *_), (most, *_) = parse_alternatives(name, low), parse_alternatives(name, high)
    kind = type(getattr(Config(), name, None))
    if kind not in (int, float) or "," in text or scale not in ([], ["log"]):
        raise SwingupError(f"{name} = {quoted(text)}: write LOW:HIGH or LOW:HIGH:log for a number, or alternatives")
    try:
        number = distributions.IntDistribution if kind is int else distributions.FloatDistribution
        return number(least, most, log=bool(scale))
    except ValueError as error:
        raise SwingupError(f"{name} = {quoted(text)}: {one_line(error)}") from error


def _open_study(plan: SearchPlan, space: Mapping[str, str], pruning: bool) -> "optuna.Study":
    """The study in the folder, or a new one."""
    from optuna import create_study, logging, pruners, storages
    from sqlalchemy import pool

    logging.set_verbosity(logging.WARNING)  # no line about a new study or an ended trial
    # No trial is cut short before five others have ended, nor in the first two tenths of its first run.
    pruner = pruners.MedianPruner(n_startup_trials=5, n_warmup_steps=2) if pruning else pruners.NopPruner()
    seeds = [plan.seeds.start, len(plan.seeds)]
    settings = {"frames": plan.frames, **plan.base.as_dict(), "seeds": seeds, "space": dict(space)}
    with _storage_errors(plan):
        # Workers report to the same file: SQLite lets them wait for one another. Each connection is closed after
        # its use, since nobody closes those of a pool.
        options = {"connect_args": {"timeout": 60}, "poolclass": pool.NullPool}
        storage = storages.RDBStorage(f"sqlite:///{plan.out / STORAGE}", options)
        study = create_study(
            storage=storage, study_name="search", direction="maximize", load_if_exists=True, pruner=pruner
        )
        best_trial(study)  # reads all trials: what is damaged shows here
        if (known := study.user_attrs.get("settings")) is None:
            study.set_user_attr("settings", known := settings)
        different = ", ".join(name for name in settings if known[name] != settings[name])
    if different:
        raise SwingupError(f"{plan.out} holds a search with another {different}: choose another --out")
    return study


@contextlib.contextmanager
def _storage_errors(plan: SearchPlan) -> Iterator[None]:
    """Name the file in whatever a damaged one raises: the storage does not say what that is."""
    try:
        yield
    except Exception as error:
        damaged = f"{plan.out / STORAGE} ({one_line(error, 80)})"
        raise SwingupError(f"cannot read {damaged}: restore it, or choose another --out") from error
