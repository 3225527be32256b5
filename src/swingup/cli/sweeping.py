"""The command ``sweep``: many runs and one table, or a search with Optuna."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import UseAppendAction, arg

from ..common.checks import whole_number
from ..common.errors import SwingupError
from ..common.files import write_atomically
from ..learner.rates import shown_rate
from ..learner.run_folder import RunFolder
from ..plant.robots import get_robot
from ..sweep.jobs import JobOutcome, run_jobs
from ..sweep.plan import base_settings, parse_alternatives, plan_jobs, split_assignments
from ..sweep.search import SearchResult, TrialRow, search
from ..sweep.summary import VariantRow, as_json, summarise_variants
from ..sweep.workers import workers_for
from .arguments import NO_PLANT, PlantFlags, RobotOrNone
from .output import log, show_table, tell

TRIALS_SHOWN = 10
"""Trials in the table: the best ones."""
ENDED = {"pruned": "pruned", "fail": "failed"}
"""Optuna's states of trials without a score, in words."""

Assignments = Annotated[
    UseAppendAction[tuple[tuple[str, ...], ...]],
    arg(
        name="set",
        metavar="NAME=VALUE,...",
        help="alternatives of hyperparameters or of preset; with --trials also ranges LOW:HIGH or LOW:HIGH:log.",
    ),
]
"""One option may name several; given again, it adds to them."""


def sweep(
    robot: RobotOrNone = None,
    /,
    env: str | None = None,
    assignments: Assignments = (),
    preset: str | None = None,
    trials: int | None = None,
    no_pruning: bool = False,
    seeds: int | None = None,
    seed: int = 0,
    frames: int | None = None,
    out: str | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    plant: PlantFlags = NO_PLANT,
    evaluate_every: int | None = None,
    checkpoint_every: int | None = None,
    evaluation_episodes: int | None = None,
    json: bool = False,
) -> int:
    """Train every combination of settings with several seeds; one table with intervals. Or search with --trials.

    Given again, the command repeats nothing: finished runs are read, runs that were cut off resume.

    With --trials Optuna suggests the settings, from ranges and alternatives. best.json then has the best.

    Args:
        robot: the robot; leave it out with --env.
        env: Gymnasium id of another task.
        assignments: what varies, such as learning_rate=3e-4,5e-4 policy_layers=64x64,128x128.
        preset: named settings that the runs share.
        trials: search with so many trials instead, those of earlier calls included; needs swingup[optuna].
        no_pruning: with --trials, train all runs to their end, also those that are worse than the median.
        seeds: seeds per setting (default 8; with --trials 1).
        seed: the first seed.
        frames: frames of each run; default: the preset's.
        out: folder of the sweep; default sweeps/ROBOT-PRESET, or searches/ROBOT-PRESET with --trials.
        workers: runs side by side; default one for every two cores.
        scheduler: address of a Dask scheduler to run on instead; it needs to see the same files.
        plant: the pendulum to train on, in whose units the task is.
        evaluate_every: frames between evaluations; default as for train.
        checkpoint_every: frames between checkpoints; default as for train.
        evaluation_episodes: episodes of an evaluation with --env; default 5.
        json: print JSON instead of the table.
    """
    if (robot is None) == (env is None):
        raise SwingupError(f"robot = {robot!r} and env = {env!r}: give one of the two")
    task = env or get_robot(str(robot)).name
    given: dict[str, Any] = {"preset": preset, "plant": plant.make(), "evaluate_every": evaluate_every}
    given |= {"checkpoint_every": checkpoint_every, "evaluation_episodes": evaluation_episodes}
    base = base_settings(task, **given)
    # Ids of Gymnasium environments may contain slashes.
    name = f"{task.replace('/', '-')}-{base['preset']}"
    texts = split_assignments([word for words in assignments for word in words])

    def tell_run(run: JobOutcome) -> None:
        log(f"{run.job.variant} seed {run.job.settings['seed']}: {run.error or format(run.number('score'), '.6g')}")

    def tell_trial(row: TrialRow) -> None:
        outcome = row.error or ("pruned" if row.state == "pruned" else f"{row.score:.6g}")
        log(f"trial {row.trial}, {row.settings}: {outcome}")

    if trials is not None:
        result = search(
            task, texts, trials, out or f"searches/{name}", frames=frames, seed=seed,
            seeds=1 if seeds is None else seeds, pruning=not no_pruning, workers=workers, scheduler=scheduler,
            progress=tell_trial, **given,
        )  # fmt: skip
        print(as_json([asdict(row) for row in result.rows]).decode(), end="") if json else _show_search(result)
        return 0 if result.best is not None else 1
    if no_pruning:
        raise SwingupError("--no-pruning goes with --trials: a sweep trains all runs to their end")
    grid = {each: parse_alternatives(each, text) for each, text in texts.items()}
    number = whole_number("seeds", 8 if seeds is None else seeds, 1, 2**32)
    folder = Path(out or f"sweeps/{name}")
    jobs = plan_jobs(base, grid, range(seed, seed + number), folder, frames)
    with workers_for(scheduler, workers) as pool, RunFolder(folder).exclusive():
        rows = summarise_variants(run_jobs(jobs, pool.executor, tell_run))
        content = as_json([asdict(row) for row in rows])
        write_atomically(folder / "sweep.json", content)
    print(content.decode(), end="") if json else _show_variants(rows)
    return 1 if any(row.failed for row in rows) else 0


def _show_variants(rows: list[VariantRow]) -> None:
    # Only tasks that are judged by episodes have rates.
    rated = any(not math.isnan(row.reward_rate) for row in rows)
    headings = ["Settings", "Runs", "Score (IQM)", "95 % interval", "Best"]
    cells = []
    for row in rows:
        low, high = row.interval
        cells.append([row.variant or "as the preset has it", str(row.runs), f"{row.score:.4g}"])
        cells[-1] += [f"{low:.4g} to {high:.4g}", f"{row.best:.4g}"]
        cells[-1] += [shown_rate(row.reward_rate), shown_rate(row.resets_per_1000_steps)] if rated else []
    show_table(headings + (["Reward rate", "Resets per 1,000 steps"] if rated else []), cells)


def _show_search(result: SearchResult) -> None:
    complete = sorted((row for row in result.rows if row.state == "complete"), key=lambda row: -row.score)
    cells = [[row.settings, str(row.trial), f"{row.score:.4g}"] for row in complete[:TRIALS_SHOWN]]
    show_table(["Settings", "Trial", "Score"], cells)
    counts = [f"{sum(row.state == state for row in result.rows)} {word}" for state, word in ENDED.items()]
    tell(f"{len(complete)} trials complete, {', '.join(counts)}")
    if result.best is not None:
        tell("The best one again, with another --seed or more --frames:", result.best.command)
