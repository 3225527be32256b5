"""A search for hyperparameters: Optuna suggests trials, which are runs on any ``concurrent.futures.Executor``.

The folder of a search holds Optuna's journal, a folder for each trial's runs, ``search.json`` and ``best.json``. A
search that was killed goes on with what has ended; trials that were cut off resume from their checkpoints.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..areapo.words import format_value
from ..common.checks import whole_number
from ..common.errors import SwingupError
from ..common.text import quoted
from ..learner.presets import choose_preset
from ..learner.run_folder import RunFolder
from ..learner.run_settings import default_intervals
from ..plant.plant import LEADERBOARD, PlantLike, load_plant
from ..plant.robots import ROBOTS
from .executors import workers_for
from .found import SearchResult, found, write_found
from .jobs import PRUNED, Job, JobOutcome, train_one
from .plan import MOST_RUNS
from .search_plan import SearchPlan, plan_search
from .study import PLACE, begin_again, chosen_values, latest_trials, next_trial, open_study
from .trials import RunningTrial, TrialRow, end_trial

if TYPE_CHECKING:
    from optuna.study import Study
    from optuna.trial import Trial

POLL = 1.0
"""Seconds between two looks at the intermediate scores."""


def search(
    env: str,
    space: Mapping[str, Any],
    trials: int,
    out: str | Path,
    *,
    preset: str | None = None,
    frames: int | None = None,
    seed: int = 0,
    seeds: int = 1,
    plant: PlantLike = LEADERBOARD,
    evaluate_every: int | None = None,
    checkpoint_every: int | None = None,
    evaluation_episodes: int | None = None,
    pruning: bool = True,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[TrialRow], None] | None = None,
) -> SearchResult:
    """Search for hyperparameters with Optuna; the same call again goes on.

    Workers are fresh processes, which import the calling script: call this below ``if __name__ == "__main__":``.

    Args:
        env: ``acrobot``, ``pendubot`` or a Gymnasium id, also ``your.module:Task-v0``.
        space: by the name of a hyperparameter, or ``preset``: a :class:`.Range`, a list of alternatives, or text as
            ``1e-4:1e-2:log`` or ``64x64,128x128``.
        trials: number of trials, those of earlier calls included.
        out: the folder of the search.
        preset: named settings of what does not vary; by default those of the task.
        frames: length of each run; by default the preset's.
        seed: the first seed of each trial, from which the suggestions follow as well.
        seeds: how many seeds each trial trains.
        plant: the robot's pendulum.
        evaluate_every: frames between evaluations.
        checkpoint_every: frames between checkpoints.
        evaluation_episodes: episodes of an evaluation on another task than the pendulum's.
        pruning: whether trials that are worse than the median of the others are cut short.
        workers: local processes; by default one for every two cores.
        scheduler: address of a Dask scheduler to run on instead.
        progress: called with each trial that ends.

    Raises:
        SwingupError: an argument cannot work, Optuna is not installed, or the folder holds another search.
    """
    if not isinstance(env, str):
        raise SwingupError(f"env = {quoted(env)}: a search runs in other processes: name a Gymnasium id")
    robot = env if env in ROBOTS else None
    given = {
        "plant": load_plant(plant), "evaluate_every": evaluate_every, "checkpoint_every": checkpoint_every,
        "evaluation_episodes": evaluation_episodes,
    }  # fmt: skip
    base: dict[str, Any] = {"robot": robot, "env": None if robot else env, "preset": choose_preset(preset, env)}
    base |= default_intervals(robot) | {name: value for name, value in given.items() if value is not None}
    plan = plan_search(base, space, out, frames, seed, seeds)
    with workers_for(scheduler, workers) as pool:
        return run_search(plan, trials, pool.executor, pool.count, pruning, progress)


def run_search(
    plan: SearchPlan,
    trials: int,
    executor: Executor,
    at_once: int = 1,
    pruning: bool = True,
    progress: Callable[[TrialRow], None] | None = None,
    train: Callable[[Job], JobOutcome] = train_one,
    poll: float = POLL,
) -> SearchResult:
    """Search until so many trials have ended, those of earlier calls included.

    Args:
        plan: what is searched.
        trials: number of trials.
        executor: a process pool, Dask's ``Client.get_executor()``, or any other.
        at_once: runs that the executor can do side by side.
        pruning: whether trials that are worse than the median of the others are cut short.
        progress: called with each trial that ends.
        train: trains one job.
        poll: seconds between two looks at the intermediate scores.

    Raises:
        SwingupError: Optuna is not installed, the folder holds another search or is in use, or the executor lost
            its workers; the same search goes on then.
    """
    whole_number("trials", trials, 1, MOST_RUNS)
    with RunFolder(plan.out).exclusive():
        study = open_study(plan.out, plan.as_dict(), pruning)
        begin_again(study)
        running: list[RunningTrial] = []
        while True:
            while len(running) * plan.seeds < at_once and _has_next(study, trials):
                trial = next_trial(study, plan.space, plan.seed)
                begun = _begin(plan, study, trial, executor, train)
                if isinstance(begun, RunningTrial):
                    running.append(begun)
                else:
                    _tell(plan, study, begun, progress)
            if not running:
                # Again, since a kill may have come between a trial's end and its row.
                result = found(plan, study)
                write_found(plan, result)
                return result
            pending = [future for each in running for future in each.futures if not future.done()]
            wait(pending, poll, FIRST_COMPLETED)
            for each in running.copy():
                if each.report():
                    running.remove(each)
                    _tell(plan, study, each.finish(study), progress)


def _has_next(study: "Study", trials: int) -> bool:
    """Whether a trial is queued, or fewer than ``trials`` have begun."""
    from optuna.trial import TrialState

    known = latest_trials(study).values()
    return len(known) < trials or any(trial.state == TrialState.WAITING for trial in known)


def _begin(
    plan: SearchPlan, study: "Study", trial: "Trial", executor: Executor, train: Callable[[Job], JobOutcome]
) -> RunningTrial | TrialRow:
    """Submit the runs of a trial, or end it where its settings do not go together.

    Raises:
        SwingupError: a worker of a search that was killed still trains one of them.
    """
    chosen = chosen_values(trial.params)
    try:
        jobs = plan.jobs(chosen, trial.user_attrs[PLACE])
    except SwingupError as error:
        words = " ".join(f"{name}={format_value(value)}" for name, value in chosen.items())
        return end_trial(study, trial, words, "failed", error=str(error))
    for job in jobs:
        if Path(job.folder).exists():
            # Here, since a run that only finds its folder in use would be a failed trial.
            with RunFolder(job.folder).exclusive():
                # Of a trial that was killed while it was pruned: it is pruned again if that is due.
                (Path(job.folder) / PRUNED).unlink(missing_ok=True)
    return RunningTrial(trial, jobs, [executor.submit(train, job) for job in jobs])


def _tell(plan: SearchPlan, study: "Study", row: TrialRow, progress: Callable[[TrialRow], None] | None) -> None:
    """Write the results so far, and show the trial."""
    write_found(plan, found(plan, study))
    if progress is not None:
        progress(row)
