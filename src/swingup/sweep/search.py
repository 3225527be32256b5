"""A search for hyperparameters: each of Optuna's trials trains on any ``concurrent.futures.Executor``.

Its folder holds Optuna's storage, a folder for each trial's runs, and ``best.json``. A search that was interrupted
goes on: trials that have ended are not repeated, the others resume from checkpoints.
"""

import contextlib
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor, Executor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..areapo.config import HYPERPARAMETERS, format_value, parse_value
from ..benchmark.values import interquartile_mean
from ..common.arrays import write_json
from ..common.checks import is_number, one_of, whole_number
from ..common.errors import SwingupError, needing, one_line, quoted
from ..learner.run_folder import RunFolder
from ..learner.run_settings import SETTINGS, RunSettings, make_run_settings
from .runs import (
    MAX_RUNS,
    Row,
    check_varied,
    describe_error,
    executor_for,
    parse_alternatives,
    plan_variant,
    run_length,
    train_one,
)

if TYPE_CHECKING:
    from optuna import Study, Trial
    from optuna.trial import FrozenTrial

STORAGE = "study.db"  # Optuna's SQLite file
RUNGS = 10  # Intermediate scores of a run: one a tenth


@dataclass(frozen=True)
class SearchPlan:
    """What is searched, in a form that travels between processes."""

    base: RunSettings
    space: Mapping[str, str]
    out: Path
    frames: int
    seeds: range
    pruning: bool


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
    progress: Callable[["FrozenTrial"], None] = lambda trial: None,
    **settings: Any,
) -> "Study":
    """Search for hyperparameters with Optuna; the same call again goes on.

    Workers are fresh processes, which import the calling script: call this below ``if __name__ == "__main__":``.

    Args:
        env: ``acrobot``, ``pendubot`` or a Gymnasium id, also ``your.module:Task-v0``.
        space: what varies, by the name of a hyperparameter or ``preset``: alternatives such as ``64x64,128x128``,
            or a range such as ``1e-4:1e-2``, or ``1e-4:1e-2:log``, in which equal ratios are equally likely.
        trials: number of trials, with the trials of earlier calls.
        out: the folder of the search.
        frames: length of each run; by default the preset's, of several presets the longest.
        seed: the first seed of each trial, from which the suggestions follow as well.
        seeds: how many seeds each trial trains, one after the other.
        pruning: whether trials that are worse than the median of the others are cut short.
        workers: trials side by side in local processes; by default one for every two cores.
        executor: runs the trials instead, such as Dask's ``Client.get_executor()``.
        progress: called with each trial that ends.
        settings: ``preset`` and ``plant`` of what does not vary, by default those of the task, and
            ``evaluate_every``, ``checkpoint_every`` and ``evaluation_episodes``.

    Returns:
        Optuna's study. A trial's value is the interquartile mean of its seeds' last scores; of a pruned one, the
        last intermediate score. Its user attributes are ``folder`` (in ``out``), ``preset``, ``hyperparameters``
        (keywords of :class:`swingup.AREAPO`), ``command`` (trains its first seed again) and, where it failed,
        ``error``.
        A trial that was interrupted stays as a failed one; the trial that continues it has its folder.

    Raises:
        SwingupError: an argument cannot work, Optuna is not installed, its file is damaged, the folder holds
            another search or is in use, or the executor ran no trial.
    """
    if not isinstance(env, str) or not isinstance(space, Mapping) or not space:
        raise SwingupError(f"env = {quoted(env)}, space = {quoted(space)}: name a Gymnasium id, and what varies")
    for name, text in space.items():
        if not isinstance(text, str):
            raise SwingupError(f"space has {name} = {quoted(text)}: write a text, such as '1e-4:1e-2:log'")
        _parse_range(name, text)
    for name, value in settings.items():
        if name in HYPERPARAMETERS:
            raise SwingupError(f"{name} = {quoted(value)}: put it into the space, as a text with one alternative")
        one_of("setting", name, SETTINGS)
    base = make_run_settings(env, **settings)
    presets = space.get("preset", base.preset).split(",")
    check_varied(space, presets, base)
    length = run_length(frames, presets)
    seeds, trials = whole_number("seeds", seeds, 1, MAX_RUNS), whole_number("trials", trials, 1, MAX_RUNS)
    first = whole_number("seed", seed, 0, 2**32 - seeds)
    plan = SearchPlan(base, dict(space), Path(out).absolute(), length, range(first, first + seeds), pruning)
    processes = executor_for(workers=workers) if executor is None else contextlib.nullcontext(executor)
    with processes as pool, RunFolder(plan.out).exclusive():
        study = _begin(plan)
        _note_best(plan, study)  # a kill may have come between a trial's end and the file
        places = range(sum(trial.state.is_finished() for trial in trials_of(study)), trials)
        futures = [pool.submit(run_trial, plan, place) for place in places]
        failures: list[BaseException] = []
        for future in as_completed(futures):
            if (error := future.exception()) is None:
                _note_best(plan, study)
                progress(study.trials[future.result()])
            # A worker's death says nothing of the settings: the next call continues its trial.
            elif not isinstance(error, BrokenExecutor):
                failures.append(error)
        if failures:
            raise SwingupError(f"{len(failures)} trials did not end: {describe_error(failures[0])}")
    return study


def trials_of(study: "Study") -> list["FrozenTrial"]:
    """The trials of a search; in the place of one that was interrupted, its continuation, which has its folder."""
    return list({trial.user_attrs.get("folder", trial.number): trial for trial in study.trials}.values())


def best_trial(study: "Study") -> "FrozenTrial | None":
    """The complete trial with the best score; None if no trial is complete."""
    return study.best_trial if any(trial.state.name == "COMPLETE" for trial in study.trials) else None


def run_trial(plan: SearchPlan, place: int) -> int:
    """Run one trial in the calling process, an interrupted one first; its number.

    Random suggestions follow from the trial's ``place`` in the search: a search that goes on must not draw the
    first values again.
    """
    from optuna import TrialPruned

    numbers: list[int] = []

    def objective(trial: "Trial") -> float:
        numbers.append(trial.number)
        try:
            return train_trial(plan, trial)
        except Exception as error:
            if not isinstance(error, TrialPruned):
                trial.set_user_attr("error", describe_error(error))
            raise

    _open_study(plan, place).optimize(objective, n_trials=1, catch=Exception)
    return numbers[0]


def train_trial(plan: SearchPlan, trial: "Trial") -> float:
    """Train a trial's seeds, one after the other: the interquartile mean of their scores.

    Optuna prunes a trial of which it expects no more; settings that do not go together are refused.
    """
    from optuna import TrialPruned

    scores: list[float] = []
    # A trial that continues an interrupted trial has its attributes.
    folder = trial.user_attrs.get("folder", f"trial-{trial.number}")
    trial.set_user_attr("folder", folder)
    params = {name: _suggest(trial, name, text) for name, text in plan.space.items()}
    jobs = plan_variant(plan.base, params, plan.seeds, plan.out / folder, plan.frames)
    settings = jobs[0].settings
    chosen = {name: getattr(settings.config, name) for name in params if name != "preset"}
    trial.set_user_attr("preset", settings.preset)
    trial.set_user_attr("hyperparameters", chosen)
    trial.set_user_attr("command", settings.command(plan.frames))
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

    for job in jobs:
        scores.append(train_one(job, report)["score"])
    if not all(map(is_number, scores)):
        raise SwingupError(f"scores = {scores}: every run needs one, so let it evaluate its policies")
    return float(interquartile_mean(scores))


def _suggest(trial: "Trial", name: str, text: str) -> Any:
    if (bounds := _parse_range(name, text)) is not None:
        low, high, log = bounds
        return (trial.suggest_int if isinstance(low, int) else trial.suggest_float)(name, low, high, log=log)
    # Optuna stores alternatives as text.
    texts = list(dict.fromkeys(map(format_value, parse_alternatives(name, text))))
    chosen = trial.suggest_categorical(name, texts)
    return chosen if name == "preset" else parse_value(name, chosen)


def _parse_range(name: str, text: str) -> tuple[Any, Any, bool] | None:
    """Lowest and highest value, and whether equal ratios are equally likely; None for alternatives, checked."""
    start, colon, rest = text.partition(":")
    low, *others = parse_alternatives(name, start)
    if not colon:
        return None
    end, *scale = rest.split(":")
    high, *more = parse_alternatives(name, end)
    known = type(low) in (int, float) and not others and not more and scale in ([], ["log"])
    if not known or high <= low or (scale and low <= 0):
        bounds = "LOW:HIGH, or LOW:HIGH:log with LOW above 0, for a number with LOW below HIGH"
        raise SwingupError(f"{name} = {quoted(text)}: write {bounds}, or alternatives with commas")
    return low, high, bool(scale)


def _begin(plan: SearchPlan) -> "Study":
    """The study in the folder, or a new one, whose interrupted trials wait."""
    with needing("Optuna", "optuna", "a search"):
        from optuna import exceptions, storages
        from optuna.trial import TrialState
    seeds = [plan.seeds.start, len(plan.seeds)]
    settings = {"frames": plan.frames, **plan.base.as_dict(), "seeds": seeds, "space": dict(plan.space)}
    try:
        study = _open_study(plan)
        trials = study.trials  # reads all of them: what is damaged shows here
        if (known := study.user_attrs.get("settings")) is None:
            study.set_user_attr("settings", known := settings)
        different = ", ".join(name for name in settings if known[name] != settings[name])
    except Exception as error:  # the storage raises its own errors, which do not name the file
        damaged = f"{plan.out / STORAGE} ({one_line(error, 80)})"
        raise SwingupError(f"cannot read {damaged}: restore it, or choose another --out") from error
    if different:
        raise SwingupError(f"{plan.out} holds a search with another {different}: choose another --out")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", exceptions.ExperimentalWarning)
        retry = storages.RetryHeartbeatStaleTrialCallback(inherit_intermediate_values=True)
    for trial in trials:
        # No heartbeat is needed to know it: this process holds the folder's lock, so the trial's worker is gone.
        if trial.state == TrialState.RUNNING:
            study.tell(trial.number, state=TrialState.FAIL)
            retry(study, trial)
    return study


def _open_study(plan: SearchPlan, place: int = 0) -> "Study":
    """The study as the process sees it that runs the trial at a place in the search."""
    from optuna import create_study, logging, pruners, samplers, storages
    from sqlalchemy import pool

    logging.set_verbosity(logging.ERROR)  # no line about a new study or an ended trial
    # No trial is cut short before five others have ended, nor in the first two tenths of its first run.
    pruner = pruners.MedianPruner(n_startup_trials=5, n_warmup_steps=2) if plan.pruning else pruners.NopPruner()
    seed = np.random.SeedSequence([plan.seeds.start, place]).generate_state(1)
    # Workers report to the same file: SQLite lets them wait for one another. Each connection is closed after its
    # use, since nothing closes a pool's connections.
    options = {"connect_args": {"timeout": 60}, "poolclass": pool.NullPool}
    storage = storages.RDBStorage(f"sqlite:///{plan.out / STORAGE}", options)
    return create_study(
        study_name="search", direction="maximize", load_if_exists=True,
        storage=storage, pruner=pruner, sampler=samplers.TPESampler(seed=int(seed[0])),
    )  # fmt: skip


def _note_best(plan: SearchPlan, study: "Study") -> None:
    if (best := best_trial(study)) is not None:
        facts = best.user_attrs | {"folder": str(plan.out / best.user_attrs["folder"])}
        write_json(plan.out / "best.json", {"trial": best.number, "score": best.value, **facts})
