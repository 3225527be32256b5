"""The command ``sweep``: many runs, one table."""

import dataclasses
import json
import math
from typing import Annotated, Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from tyro.conf import UseAppendAction, arg

from ..common.arrays import finite
from ..common.checks import whole_number
from ..common.errors import SwingupError
from ..common.files import make_folder, write_atomically
from ..learner.rates import shown_rate
from ..sweep.executors import executor_for
from ..sweep.jobs import JobOutcome, run_jobs
from ..sweep.plan import parse_grid, plan_jobs
from ..sweep.search_plan import plan_search
from ..sweep.space import parse_space
from ..sweep.summary import VariantRow, summarise_variants
from .arguments import NO_PLANT, PlantFlags, RobotOrNone
from .searching import show_search
from .training import default_options

RATE_HEADINGS = ("Reward rate", "Resets per 1,000 steps")
"""Columns of tasks that are judged by episodes: of the last policies' evaluations."""

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
        robot: the robot; none with --env.
        env: Gymnasium id of another task.
        assignments: what varies, such as learning_rate=3e-4,5e-4 policy_layers=64x64,128x128; with --trials also
            ranges, such as learning_rate=1e-4:1e-2:log num_epochs=2:20.
        preset: named settings that the runs share.
        trials: search with so many trials instead, those of earlier calls included; needs swingup[optuna].
        no_pruning: with --trials, train all runs to their end, also those that are worse than the median.
        seeds: seeds of each combination, default 8; of each trial, default 1.
        seed: the first seed.
        frames: frames of each run; default: the preset's.
        out: folder of the sweep; default sweeps/ROBOT-PRESET, or searches/ROBOT-PRESET with --trials.
        workers: local processes; default one for every two cores. With --scheduler and --trials: runs side by
            side.
        scheduler: address of a Dask scheduler to run on instead; it needs to see the same files.
        plant: the pendulum to train on, in whose units the task is.
        evaluate_every: frames between evaluations; default as for train.
        checkpoint_every: frames between checkpoints; default as for train.
        evaluation_episodes: episodes of an evaluation with --env; default 5.
        json: print JSON instead of the table.
    """
    if seeds is not None:
        whole_number("seeds", seeds, 1, 2**32)
    options: dict[str, Any] = {"robot": robot, "env": env, "preset": preset, "evaluate_every": evaluate_every}
    options |= {"checkpoint_every": checkpoint_every, "evaluation_episodes": evaluation_episodes}
    options["plant"] = plant.make()
    base = default_options(options)
    # Ids of Gymnasium environments may contain slashes.
    name = f"{str(robot or env).replace('/', '-')}-{base['preset']}"
    given = [word for words in assignments for word in words]
    if trials is not None:
        plan = plan_search(base, parse_space(given), out or f"searches/{name}", frames, seed, seeds or 1)
        return show_search(plan, trials, not no_pruning, scheduler, workers, json)
    if no_pruning:
        raise SwingupError("--no-pruning goes with --trials: a sweep trains all runs to their end")
    folder = out or f"sweeps/{name}"
    jobs = plan_jobs(base, parse_grid(given), range(seed, seed + (seeds or 8)), folder, frames)
    console = Console(stderr=True)

    def tell(outcome: JobOutcome) -> None:
        name = f"{outcome.job.variant} seed {outcome.job.settings['seed']}".strip()
        console.print(escape(f"{name}: {outcome.error or f'{outcome.score:.6g}'}"), soft_wrap=True, highlight=False)

    with executor_for(scheduler, workers) as executor:
        make_folder(folder)
        rows = summarise_variants(run_jobs(jobs, executor, tell))
    # In a function of its own: here the option json hides the module.
    text = rows_as_json(rows)
    write_atomically(f"{folder}/sweep.json", (text + "\n").encode())
    if json:
        print(text)
    else:
        show_variants(rows)
    return 1 if any(row.failed for row in rows) else 0


def rows_as_json(rows: list[VariantRow]) -> str:
    """One list of rows."""
    return json.dumps(finite([dataclasses.asdict(row) for row in rows]), indent=2)


def show_variants(rows: list[VariantRow]) -> None:
    """Print one line a variant."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("Settings", no_wrap=True)
    # Tasks that are not judged by episodes have no rates, and neither have runs of older versions.
    rated = any(not math.isnan(row.reward_rate) for row in rows)
    for heading in ("Runs", "Score (IQM)", "95 % interval", "Best", *(RATE_HEADINGS if rated else ())):
        table.add_column(heading, justify="right")
    for row in rows:
        low, high = row.interval
        cells = (str(row.runs), f"{row.score:.4g}", f"{low:.4g} to {high:.4g}", f"{row.best:.4g}")
        rates = (shown_rate(row.reward_rate), shown_rate(row.resets_per_1000_steps))
        table.add_row(escape(row.variant or "as the preset has it"), *cells, *(rates if rated else ()))
    Console().print(table)
