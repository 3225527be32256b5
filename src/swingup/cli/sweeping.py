"""The command ``sweep``: many runs and one table, or a search with Optuna."""

import itertools
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import arg

from ..common.arrays import finite, write_json
from ..common.checks import is_number, whole_number
from ..common.errors import SwingupError, quoted
from ..common.files import file_name
from ..learner.metrics import RESETS, REWARD_RATE, shown_rate
from ..learner.run_folder import RunFolder
from ..learner.run_settings import make_run_settings
from ..sweep.runs import Job, Row, describe, executor_for, parse_alternatives, plan_jobs, run_jobs, summarise
from ..sweep.search import best_trial, search, trials_of
from .arguments import NO_OPTIONS, PlantOptions, RobotName, facts_of, task_name
from .output import Progress, tell, tell_json, tell_table
from .training import RunOptions

MAX_TRIALS_SHOWN = 10
"""Maximum number of trials in the table: the best ones."""
STATE_WORDS = {"complete": "", "pruned": "pruned", "fail": "failed"}
"""Optuna's states in words."""


def sweep_command(
    robot: RobotName | None = None,
    /,
    set: Annotated[tuple[str, ...], arg(metavar="NAME=VALUE,...")] = (),
    trials: int | None = None,
    pruning: bool = True,
    seeds: int | None = None,
    seed: int = 0,
    frames: int | None = None,
    out: str | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    run: RunOptions = NO_OPTIONS,
    plant: PlantOptions = NO_OPTIONS,
    json: bool = False,
) -> int:
    """Train every combination of settings with several seeds; one table with intervals. Or search with --trials.

    Given again, the command repeats nothing: finished runs are read, runs that were cut off resume.

    With --trials Optuna suggests the settings, from ranges and alternatives. best.json then has the best.

    Args:
        robot: acrobot or pendubot.
        set: alternatives of hyperparameters or of preset, as learning_rate=3e-4,5e-4 policy_layers=64x64,128x128;
            with --trials also ranges LOW:HIGH or LOW:HIGH:log. Repeatable.
        trials: number of trials of a search, with those of earlier calls; needs swingup[optuna].
        pruning: with --trials, cut runs short that are worse than the median.
        seeds: seeds per setting (default 8; with --trials 1).
        seed: the first seed.
        frames: frames of each run; default: the preset's.
        out: folder of the sweep; default sweeps/ROBOT-PRESET, or searches/ROBOT-PRESET with --trials.
        workers: runs side by side; default one for every two cores.
        scheduler: address of a Dask scheduler to run on instead; it needs to see the same files.
        run: what is trained, and how often it is evaluated.
        plant: the pendulum to train on, in whose units the task is.
        json: print JSON instead of the table.
    """
    given: dict[str, Any] = {"plant": facts_of(plant), **run}
    task = task_name(robot, given.pop("env", None))
    base = make_run_settings(task, **given)
    name = f"{file_name(task)}-{base.preset}"
    texts = _alternatives(set)
    if trials is not None:
        with Progress() as progress, executor_for(scheduler, workers) as pool:

            def show_trial(trial: Any) -> None:
                row = _trial_row(trial)
                score = f"{row['error'] or row['state']} {shown_rate(row['score'])}"
                progress.log(f"trial {row['trial']}, {row['settings']}: {score}")
                progress("trials", min(trial.number + 1, trials), trials)

            study = search(
                task, texts, trials, out or f"searches/{name}", frames=frames, seed=seed,
                seeds=1 if seeds is None else seeds, pruning=pruning, executor=pool, progress=show_trial, **given,
            )  # fmt: skip
        best, trial_rows = best_trial(study), [_trial_row(trial) for trial in trials_of(study)]
        tell_json(trial_rows, indent=2) if json else _show_search(trial_rows)
        if best is not None and not json:
            tell("The best one again, with another --seed or more --frames:", best.user_attrs["command"])
        return 0 if best is not None else 1
    if not pruning:
        raise SwingupError("--no-pruning goes with --trials: a sweep trains all runs to their end")
    grid = {each: parse_alternatives(each, text) for each, text in texts.items()}
    number = whole_number("seeds", 8 if seeds is None else seeds, 1, 2**32)
    folder = Path(out or f"sweeps/{name}")
    jobs, ended = plan_jobs(base, grid, range(seed, seed + number), folder, frames), itertools.count(1)
    with Progress() as progress, executor_for(scheduler, workers) as pool, RunFolder(folder).exclusive():

        def show_run(job: Job, row: Row) -> None:
            score = row.get("error") or shown_rate(row["score"])
            progress.log(f"{job.variant or 'as the preset has it'}, seed {job.settings.seed}: {score}")
            progress("runs", next(ended), len(jobs))

        rows = summarise(jobs, run_jobs(jobs, pool, show_run))
        write_json(folder / "sweep.json", rows)
    tell_json(finite(rows), indent=2) if json else _show_variants(rows)
    return 1 if any(row["failed"] for row in rows) else 0


def _alternatives(assignments: Sequence[str]) -> dict[str, str]:
    """The text of what varies by name, from words like ``learning_rate=3e-4,5e-4``; a repeated name adds to it."""
    texts: dict[str, str] = {}
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        name = name.replace("-", "_")
        if not equals:
            raise SwingupError(f"--set {quoted(assignment)}: write NAME=VALUE,VALUE with a hyperparameter's name")
        texts[name] = f"{texts[name]},{text}" if name in texts else text
    return texts


def _trial_row(trial: Any) -> dict[str, Any]:
    row = {"trial": trial.number, "state": trial.state.name.lower(), "score": trial.value}
    return row | {"settings": describe(trial.params), "error": trial.user_attrs.get("error", "")}


def _show_variants(rows: list[dict[str, Any]]) -> None:
    # Only tasks that are judged by episodes have rates.
    rates = {REWARD_RATE: "Reward rate", RESETS: "Resets per 1,000 steps"}
    rates = {name: title for name, title in rates.items() if any(is_number(row[name]) for row in rows)}
    cells = []
    for row in rows:
        variant = row["variant"] or "as the preset has it"
        interval = " to ".join(map(shown_rate, row["interval"] or [None]))
        runs = f"{row['runs']} of {row['runs'] + row['failed']}" if row["failed"] else str(row["runs"])
        score, *others = [shown_rate(row[name]) for name in ("score", "best_score", *rates)]
        cells.append([variant, runs, score, interval, *others])
    tell_table(["Settings", "Runs", "Score (IQM)", "95 % interval", "Best", *rates.values()], cells)


def _show_search(rows: list[dict[str, Any]]) -> None:
    complete = sorted((row for row in rows if row["state"] == "complete"), key=lambda row: -row["score"])
    cells = [[row["settings"], str(row["trial"]), shown_rate(row["score"])] for row in complete[:MAX_TRIALS_SHOWN]]
    tell_table(["Settings", "Trial", "Score"], cells)
    counts = Counter(STATE_WORDS.get(row["state"], "unfinished") for row in rows)
    tell(", ".join([f"{len(complete)} trials complete", *(f"{counts[word]} {word}" for word in counts if word)]))
