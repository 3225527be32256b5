"""The command ``train``: a run with a progress bar; signals stop it cleanly."""

import math
import signal
import time
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from tyro.conf import OmitArgPrefixes, arg

from ..areapo.config import config_from_dict
from ..checks import whole_number
from ..errors import SwingupError
from ..learner.presets import PRESETS, choose_preset, get_preset
from ..learner.run import Run
from ..learner.run_settings import RunSettings, default_intervals, read_run_settings
from ..learner.start import resume_run, start_run
from ..physics.parameters import get_robot
from ..plants.domain import load_domain
from ..tasks.sim2real import Sim2RealTask
from .arguments import NO_PLANT, PlantFlags, RobotOrNone, plant_note
from .hyperparameters import HyperparameterOptions, given_hyperparameters
from .judging import judge_performance, judge_sim2real
from .progress import WIDTH, progress_line

PROGRESS_INTERVAL = 10.0
"""Seconds between lines where there is no terminal for a progress bar."""
BAR_WIDTH = 10

FROM_PRESET = HyperparameterOptions()
"""No hyperparameter given: the preset has them all."""

PresetName = Annotated[str | None, arg(metavar="NAME", help=f"named settings: {', '.join(PRESETS)}.")]


def train_command(
    robot: RobotOrNone = None,
    /,
    env: str | None = None,
    preset: PresetName = None,
    frames: int | None = None,
    seed: int | None = None,
    seeds: int | None = None,
    out: str | None = None,
    resume: str | None = None,
    evaluate_every: int | None = None,
    checkpoint_every: int | None = None,
    evaluation_episodes: int | None = None,
    domain: Annotated[str | None, arg(metavar="DOMAIN")] = None,
    plant: PlantFlags = NO_PLANT,
    hyperparameters: OmitArgPrefixes[HyperparameterOptions] = FROM_PRESET,
) -> int:
    """Train a policy, show the progress, and end with the score of the best one.

    The folder holds config.json, metrics.jsonl, tensorboard/, checkpoints/, best.npz and last.npz.

    Args:
        robot: the robot; none with --env or --resume.
        env: Gymnasium id of another task, such as Swimmer-v5 or your.module:Task-v0.
        preset: named settings.
        frames: frames to train each seed for; default: the preset's.
        seed: the first seed; default 0.
        seeds: how many seeds to train side by side; default 1.
        out: folder of the run, new or empty; default runs/ROBOT-PRESET-SEED, or the id's name for the robot's.
        resume: folder of a run to continue from its last checkpoint, bit for bit.
        evaluate_every: frames between evaluations, metrics and progress; default 65536.
        checkpoint_every: frames between checkpoints; default 1048576, or 262144 with --env.
        evaluation_episodes: episodes of an evaluation with --env; default 5.
        domain: domain of the preset sim2real, which plants and loops are drawn from: identified (the default),
            randomised, recorded, a session of the robot, as session-acrobot, or a YAML file.
        plant: the pendulum to train on, in whose units the task is; for the preset sim2real a domain names it.
        hyperparameters: those that are left out are the preset's. In brackets: the value in the preset default,
            then in presets that differ.
    """
    options = {
        "robot": robot, "env": env, "preset": preset, "seed": seed, "seeds": seeds,
        "evaluate_every": evaluate_every, "checkpoint_every": checkpoint_every,
        "evaluation_episodes": evaluation_episodes,
        "domain": None if domain is None else load_domain(domain),
        "plant": plant.make(),
    }  # fmt: skip
    if frames is not None:
        whole_number("frames", frames, 1)
    changes = given_hyperparameters(hyperparameters)
    if resume is None:
        run = _start(frames, options, out, changes)
    else:
        run = _resume(frames, options, out, Path(resume), changes)
    received = _stop_on_signals(run)
    console = Console(stderr=True)
    _show(run, console)
    run.close()
    if received:
        console.print(f"stopped at {run.frames:,} frames and saved: continue with --resume {run.folder}")
        # The status that shells give a program ended by this signal.
        return 128 + received[0]
    return _score(run)


def default_options(options: dict[str, Any]) -> dict[str, Any]:
    """Options with the defaults of those that were not given, which differ between the pendulum and other tasks."""
    if options["robot"] is not None:
        get_robot(options["robot"])
    preset = choose_preset(options["preset"], options["env"] or options["robot"])
    defaults: dict[str, Any] = {"seed": 0, "seeds": 1} | default_intervals(options["robot"])
    given = {name: value for name, value in options.items() if value is not None}
    return {"robot": None, **defaults, **given, "preset": preset}


def _start(frames: int | None, options: dict[str, Any], out: str | None, changes: dict[str, Any]) -> Run:
    chosen = default_options(options)
    preset = get_preset(chosen["preset"])
    settings = RunSettings(config=config_from_dict(vars(preset.config) | changes), **chosen)
    # Ids of Gymnasium may contain signs that a folder's name cannot.
    name = settings.name.replace("/", "-").replace(":", "-")
    folder = out or f"runs/{name}-{settings.preset}-{settings.seed}"
    return start_run(settings, folder, frames or preset.frames)


def _resume(
    frames: int | None, options: dict[str, Any], out: str | None, folder: Path, changes: dict[str, Any]
) -> Run:
    """Continue a run, unless an option contradicts its settings."""
    if out is not None:
        raise SwingupError(f"--out {out} does not go with --resume {folder}: a run stays in its folder")
    saved, _ = read_run_settings(folder)
    known = vars(saved) | vars(saved.config)
    given = {name: value for name, value in options.items() if value is not None} | changes
    for name, value in given.items():
        if value != known[name]:
            raise SwingupError(
                f"{folder} was trained with {name} = {known[name]}, not {value}: resume it without "
                f"that option, or train anew with another --out"
            )
    return resume_run(folder, frames)


def _score(run: Run) -> int:
    """Print the score of the best policy; judge that of a robot."""
    if run.settings.robot is None:
        name = "best.npz" if (run.folder / "best.npz").exists() else "last.npz"
        print(f"best score {run.best_score:.6g}, policy {run.folder / name}")
        return 0
    task, best = run.settings.task(), str(run.folder / "best.npz")
    if isinstance(task, Sim2RealTask):
        return judge_sim2real(task.domain, run.settings.robot, best)
    return judge_performance(run.settings.robot, best, run.settings.plant)


def _stop_on_signals(run: Run) -> list[int]:
    """Ctrl-C and SIGTERM end the run after its chunk; a second one ends the program at once."""
    received: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        received.append(number)
        signal.signal(number, signal.SIG_DFL)
        run.stop()

    signal.signal(signal.SIGINT, handle)
    signal.signal(signal.SIGTERM, handle)
    return received


def _show(run: Run, console: Console) -> None:
    """Train with a progress bar on a terminal; elsewhere with a line every few seconds."""
    _announce(run, console)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(bar_width=BAR_WIDTH))
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        bar = progress.add_task("compiling", total=run.goal, completed=run.frames)
        if not console.is_terminal:
            console.print("compiling")
        run.compile()  # first, so that the estimate of the time left does not contain it
        shown = -math.inf
        for report in run.advance():
            room = WIDTH if not console.is_terminal else min(console.width, WIDTH) - BAR_WIDTH - 1
            line = progress_line(report, run.goal, run.settings.seeds, room)
            progress.update(bar, completed=report.frames, description=line)
            due = time.monotonic() - shown >= PROGRESS_INTERVAL or report.frames >= run.goal
            if due and not console.is_terminal:
                console.print(line, soft_wrap=True, highlight=False, markup=False)
                shown = time.monotonic()


def _announce(run: Run, console: Console) -> None:
    """Print what is trained, for how long and where, and the parts of a domain that training leaves out."""
    settings, domain = run.settings, run.settings.domain
    on = settings.preset if domain is None else f"{settings.preset}, domain {domain.name}"
    on += "" if settings.robot is None else plant_note(settings.plant, settings.robot)
    text = f"training {settings.name} ({on}) to {run.goal:,} frames in {run.folder}"
    console.print(text, soft_wrap=True, markup=False)
    task = None if domain is None else settings.task()
    if isinstance(task, Sim2RealTask) and task.unseen:
        note = f"a policy behind an estimator trains without the domain's {' and '.join(task.unseen)}"
        console.print(f"note: {note}; its evaluations have them", soft_wrap=True, highlight=False)
