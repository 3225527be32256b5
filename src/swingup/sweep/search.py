"""A search for hyperparameters: Optuna suggests trials, which train on any ``concurrent.futures.Executor``.

The folder of a search holds Optuna's storage, a folder for each trial's runs, ``search.json`` and ``best.json``. A
search that was interrupted goes on: trials that have ended are not repeated, the others resume from checkpoints.
"""

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..areapo.config import Config, format_value, parse_value
from ..benchmark.interval import interquartile_mean
from ..common.checks import is_number, whole_number
from ..common.errors import SwingupError
from ..common.files import write_atomically
from ..common.text import one_line, quoted
from ..learner.run_folder import RunFolder
from ..learner.run_settings import run_settings_from_dict
from ..plant.plant import LEADERBOARD, PlantLike
from .jobs import Job, Row, describe_error, train_one
from .plan import MOST_RUNS, base_settings, common_length, describe, parse_alternatives, plan_variant
from .summary import as_json
from .workers import Workers, workers_for

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution
    from optuna.storages import RDBStorage
    from optuna.study import Study
    from optuna.trial import FrozenTrial, Trial

Space = Mapping[str, str]
"""By the name of a hyperparameter, or ``preset``: alternatives such as ``64x64,128x128``, or a range such as
``1e-4:1e-2``, or ``1e-4:1e-2:log``, in which equal ratios are equally likely."""

STORAGE_FILE, STUDY, SEARCH_FILE, BEST_FILE = "study.db", "search", "search.json", "best.json"
SETTINGS, ERROR = "settings", "error"
"""User attributes of the study and of a failed trial."""

RUNGS = 10
"""Intermediate scores of a run: one a tenth."""
UNPRUNED_TRIALS, UNPRUNED_RUNGS = 5, 2
"""Trials before any is cut short, and tenths of the first run before it may be."""


@dataclass(frozen=True)
class TrialRow:
    """A trial that has ended."""

    trial: int
    """Its number, which its folder has as well."""
    state: str
    """``complete``, ``pruned`` or ``fail``."""
    score: float
    """Interquartile mean of its seeds' last scores; of a pruned trial the last intermediate one."""
    settings: str
    """What varies, as text."""
    error: str
    """The reason why there is no score; empty where there is one."""


@dataclass(frozen=True)
class BestTrial:
    """The trial with the best score, and how to train with its hyperparameters."""

    trial: int
    score: float
    preset: str
    hyperparameters: dict[str, Any]
    """What the search chose, as keywords of :class:`swingup.AREAPO`."""
    folder: str
    """The trial's runs, with their policies."""
    command: str
    """Trains its first seed again."""


@dataclass(frozen=True)
class SearchResult:
    """The trials of a search that have ended."""

    rows: list[TrialRow]
    best: BestTrial | None
    """None if no trial is complete."""


@dataclass(frozen=True)
class SearchPlan:
    """What is searched, in a form that travels between processes."""

    base: Mapping[str, Any]
    space: Space
    out: Path
    frames: int
    seeds: range
    pruning: bool

    def jobs(self, chosen: Mapping[str, Any], trial: int) -> list[Job]:
        """The runs of a trial."""
        return plan_variant(self.base, chosen, self.seeds, self.out / f"trial-{trial}", self.frames)

    def settings(self) -> dict[str, Any]:
        """What a search that goes on must have in common with its beginning, as JSON values by name."""
        shared = self.jobs({}, 0)[0].settings
        varied = {f"set {name}": text for name, text in self.space.items()}
        return {**shared, **shared.pop("config"), **varied, "frames": self.frames, "seeds": len(self.seeds)}


def search(
    env: str,
    space: Space,
    trials: int,
    out: str | Path,
    *,
    preset: str | None = None,
    frames: int | None = None,
    seed: int = 0,
    seeds: int = 1,
    plant: PlantLike = LEADERBOARD,
    pruning: bool = True,
    workers: int | None = None,
    scheduler: str | None = None,
    executor: Executor | None = None,
    progress: Callable[[TrialRow], None] | None = None,
    **intervals: int | None,
) -> SearchResult:
    """Search for hyperparameters with Optuna; the same call again goes on.

    Workers are fresh processes, which import the calling script: call this below ``if __name__ == "__main__":``.

    Args:
        env: ``acrobot``, ``pendubot`` or a Gymnasium id, also ``your.module:Task-v0``.
        space: what varies.
        trials: number of trials, those of earlier calls included.
        out: the folder of the search.
        preset: named settings of what does not vary; by default those of the task.
        frames: length of each run; by default the preset's.
        seed: the first seed of each trial, from which the suggestions follow as well.
        seeds: how many seeds each trial trains, one after the other.
        plant: the robot's pendulum.
        pruning: whether trials that are worse than the median of the others are cut short.
        workers: trials side by side; by default one for every two cores, or for every thread of Dask's workers.
        scheduler: address of a Dask scheduler to run on instead of local processes.
        executor: any other executor to run on; ``workers`` is then 1 by default.
        progress: called with each trial that ends.
        intervals: ``evaluate_every``, ``checkpoint_every`` and ``evaluation_episodes``.

    Raises:
        SwingupError: an argument cannot work, Optuna is not installed, or the folder holds another search or is in
            use.
    """
    if not isinstance(space, Mapping) or not space:
        raise SwingupError(f"space = {quoted(space)}: nothing varies; give a range or alternatives for a name")
    _import_optuna()
    for name, text in space.items():
        _distribution(name, text)
    base, presets = base_settings(env, preset, plant, **intervals), space.get("preset")
    length = common_length(base, presets.split(",") if presets else [], frames)
    seeds, trials = whole_number("seeds", seeds, 1, MOST_RUNS), whole_number("trials", trials, 1, MOST_RUNS)
    first = whole_number("seed", seed, 0, 2**32 - seeds)
    plan = SearchPlan(base, space, Path(out).absolute(), length, range(first, first + seeds), pruning)
    plan.settings()  # refuses what cannot work, before anything is written
    given = None if executor is None else contextlib.nullcontext(Workers(executor, workers or 1))
    with given or workers_for(scheduler, workers) as pool, RunFolder(plan.out).exclusive():
        return _run(plan, _create_study(plan), trials, pool, progress)


def train_trial(plan: SearchPlan, number: int, chosen: Mapping[str, Any]) -> float | None:
    """Train a trial's seeds, one after the other, in the calling process; stop once Optuna expects no more of it.

    Returns:
        The interquartile mean of their scores; None if the trial was cut short.

    Raises:
        SwingupError: its settings do not go together, a run failed, or it has no score.
    """
    trial = _trial(_open_study(plan), number)
    scores: list[float] = []
    reported = set(trial.storage.get_trial(trial._trial_id).intermediate_values)

    def is_hopeless(row: Row) -> bool:
        tenth = RUNGS * row["frames"] // plan.frames
        rung = RUNGS * len(scores) + tenth
        # An interrupted run has reported already; the end of a run is no reason to cut it short.
        if rung in reported or not 0 < tenth < RUNGS or not is_number(row["score"]):
            return False
        reported.add(rung)
        trial.report(interquartile_mean([*scores, row["score"]]), rung)
        return bool(trial.should_prune())

    for job in plan.jobs(chosen, number):
        outcome = train_one(job, is_hopeless)
        if outcome.error:
            raise SwingupError(outcome.error)
        if outcome.pruned:
            return None
        scores.append(outcome.number("score"))
    return interquartile_mean(scores)


def _run(
    plan: SearchPlan, study: "Study", trials: int, pool: Workers, progress: Callable[[TrialRow], None] | None
) -> SearchResult:
    interrupted = [trial.number for trial in study.trials if not trial.state.is_finished()]
    running: dict[Future[float | None], int] = {}
    while True:
        while len(running) < pool.count and (interrupted or len(study.trials) < trials):
            number = interrupted.pop(0) if interrupted else study.ask().number
            running[pool.executor.submit(train_trial, plan, number, _suggest(plan, study, number))] = number
        if not running:
            # Written again, since a kill may have come between a trial's end and the files.
            return _write_result(plan, study)
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            ended = _tell(study, running.pop(future), future)
            _write_result(plan, study)
            if progress is not None:
                progress(_row(ended))


def _suggest(plan: SearchPlan, study: "Study", number: int) -> dict[str, Any]:
    """The settings of a trial: those that it has, or new ones of the Tree-structured Parzen estimator."""
    from optuna.samplers import TPESampler

    # From the number, too: a search that goes on must not draw the first values again.
    source = np.random.SeedSequence([plan.seeds.start, number])
    study.sampler, trial = TPESampler(seed=int(source.generate_state(1)[0])), _trial(study, number)
    return _values({name: trial._suggest(name, _distribution(name, text)) for name, text in plan.space.items()})


def _tell(study: "Study", number: int, future: Future[float | None]) -> "FrozenTrial":
    """Tell the study what came of a trial."""
    from optuna.trial import TrialState

    try:
        score = future.result()
    except Exception as error:  # of the trial, or of the executor that lost its worker
        _trial(study, number).set_user_attr(ERROR, describe_error(error))
        return study.tell(number, state=TrialState.FAIL)
    return study.tell(number, score, TrialState.PRUNED if score is None else TrialState.COMPLETE)


def _row(trial: "FrozenTrial") -> TrialRow:
    score = math.nan if trial.value is None else trial.value
    error = trial.user_attrs.get(ERROR, "")
    return TrialRow(trial.number, trial.state.name.lower(), score, describe(trial.params), error)


def _write_result(plan: SearchPlan, study: "Study") -> SearchResult:
    """Write ``search.json`` and, once a trial is complete, ``best.json``."""
    ended = [trial for trial in study.trials if trial.state.is_finished()]
    result = SearchResult([_row(trial) for trial in ended], _best(plan, ended))
    write_atomically(plan.out / SEARCH_FILE, as_json([asdict(row) for row in result.rows]))
    if result.best is not None:
        write_atomically(plan.out / BEST_FILE, as_json(asdict(result.best)))
    return result


def _best(plan: SearchPlan, ended: "Sequence[FrozenTrial]") -> BestTrial | None:
    complete = [(trial.value, -trial.number, trial) for trial in ended if trial.state.name == "COMPLETE"]
    score, _, best = max(complete, default=(None, 0, None))  # of two equal ones the earlier
    if score is None or best is None:
        return None
    chosen = _values(best.params)
    job = plan.jobs(chosen, best.number)[0]
    settings = run_settings_from_dict(job.settings)
    chosen.pop("preset", None)
    folder, command = str(Path(job.folder).parent), settings.command(plan.frames)
    return BestTrial(best.number, score, settings.preset, chosen, folder, command)


def _distribution(name: str, text: str) -> "BaseDistribution":
    """Optuna's form of a range, or of alternatives, which it stores as text.

    Raises:
        SwingupError: the name is unknown, or a value cannot work.
    """
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    low, colon, rest = text.partition(":")
    if not colon:
        return CategoricalDistribution(tuple(dict.fromkeys(map(format_value, parse_alternatives(name, text)))))
    high, *scale = rest.split(":")
    (least, *_), (most, *_) = parse_alternatives(name, low), parse_alternatives(name, high)
    kind = type(getattr(Config(), name, None))
    if kind not in (int, float) or "," in text or scale not in ([], ["log"]):
        raise SwingupError(f"{name} = {quoted(text)}: write LOW:HIGH or LOW:HIGH:log for a number, or alternatives")
    try:
        return (IntDistribution if kind is int else FloatDistribution)(least, most, log=bool(scale))
    except ValueError as error:
        raise SwingupError(f"{name} = {quoted(text)}: {one_line(error)}") from error


def _values(params: Mapping[str, Any]) -> dict[str, Any]:
    """Settings from a trial's parameters, in which alternatives are text."""
    return {
        name: parse_value(name, value) if isinstance(value, str) and name != "preset" else value
        for name, value in params.items()
    }


def _create_study(plan: SearchPlan) -> "Study":
    """The study in the folder, or a new one.

    Raises:
        SwingupError: its storage is damaged, or the folder holds another search.
    """
    from optuna import create_study, logging

    verbosity = logging.get_verbosity()
    logging.set_verbosity(logging.WARNING)  # no line about a new study
    try:
        create_study(storage=_storage(plan), study_name=STUDY, direction="maximize", load_if_exists=True)
        study = _open_study(plan)
        known, settings = study.user_attrs.get(SETTINGS), plan.settings()
        len(study.trials)  # reads them all
    except Exception as error:  # the storage does not say what reading a damaged file raises
        path = plan.out / STORAGE_FILE
        raise SwingupError(
            f"cannot read {path} ({one_line(error, 80)}): restore it, or choose another --out"
        ) from error
    finally:
        logging.set_verbosity(verbosity)
    if known is None:
        study.set_user_attr(SETTINGS, settings)
    elif differences := [name for name in {**settings, **known} if settings.get(name) != known.get(name)]:
        names = ", ".join(differences[:3])
        raise SwingupError(f"{plan.out} holds a search with other settings ({names}): choose another --out")
    return study


def _open_study(plan: SearchPlan) -> "Study":
    import optuna

    pruner = (
        optuna.pruners.MedianPruner(UNPRUNED_TRIALS, UNPRUNED_RUNGS) if plan.pruning else optuna.pruners.NopPruner()
    )
    return optuna.load_study(study_name=STUDY, storage=_storage(plan), pruner=pruner)


def _storage(plan: SearchPlan) -> "RDBStorage":
    from optuna.storages import RDBStorage

    # Workers report to the same file: SQLite lets them wait for one another.
    return RDBStorage(f"sqlite:///{plan.out / STORAGE_FILE}", {"connect_args": {"timeout": 60}})


def _trial(study: "Study", number: int) -> "Trial":
    """A trial that has not ended, perhaps of an earlier call."""
    import optuna

    return optuna.Trial(study, study.trials[number]._trial_id)


def _import_optuna() -> None:
    try:
        import optuna  # noqa: F401
    except ImportError as error:
        raise SwingupError("a search needs Optuna: pip install 'swingup[optuna]'") from error
