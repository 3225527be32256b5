"""The command ``train``: a run with a progress bar, that signals stop cleanly."""

import math
import signal
import time
from pathlib import Path
from types import FrameType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from ..areapo.config import Config
from ..errors import SwingupError
from ..learner.presets import DEFAULT_PRESET, ENV_PRESET, get_preset
from ..learner.run import Report, Run
from ..learner.run_settings import Settings, default_intervals, read_settings
from ..physics.parameters import get_robot
from ..tasks.sim2real import Sim2RealTask
from .judging import JudgingCommands, judge_sim2real

LINE_EVERY = 10.0
"""Seconds between lines where there is no terminal for a progress bar."""


def train(frames: int | None, options: dict[str, Any], out: str | None, resume: str | None, config: Config) -> int:
    """Start or resume a run, show its progress, and score its best policy.

    Options that are None were not given. The status is 128 plus the number of the signal that stopped the run.
    """
    if frames is not None and frames < 1:
        raise SwingupError(f"frames = {frames} must be at least 1")
    if resume is None:
        run = _start(frames, options, out, config)
    else:
        run = _resume(frames, options, out, Path(resume), config)
    received = _stop_on_signals(run)
    console = Console(stderr=True)
    _show(run, console)
    run.close()
    if received:
        console.print(f"stopped at {run.frames:,} frames and saved: continue with --resume {run.folder}")
        return 128 + received[0]
    if run.settings.robot is None:
        name = "best.npz" if (run.folder / "best.npz").exists() else "last.npz"
        print(f"best score {run.best_score:.6g}, policy {run.folder / name}")
        return 0
    task, best = run.settings.task(), str(run.folder / "best.npz")
    if isinstance(task, Sim2RealTask):
        return judge_sim2real(task.domain, run.settings.robot, best)
    return JudgingCommands().evaluate(run.settings.robot, controller=best)


def default_options(options: dict[str, Any]) -> dict[str, Any]:
    """Options with the defaults of those that were not given, which differ between the pendulum and other tasks."""
    if options["robot"] is not None:
        get_robot(options["robot"])
    other = options["env"] is not None
    usual: dict[str, Any] = {"preset": ENV_PRESET if other else DEFAULT_PRESET, "seed": 0, "seeds": 1}
    usual |= default_intervals(options["robot"])
    return usual | {name: value for name, value in options.items() if value is not None}


def _start(frames: int | None, options: dict[str, Any], out: str | None, config: Config) -> Run:
    chosen = {"robot": None, **default_options(options)}
    settings = Settings(config=config, **chosen)
    name = settings.name.replace("/", "-").replace(":", "-")
    folder = out or f"runs/{name}-{settings.preset}-{settings.seed}"
    return Run(settings, folder, frames or get_preset(settings.preset).frames)


def _resume(frames: int | None, options: dict[str, Any], out: str | None, folder: Path, config: Config) -> Run:
    """Continue a run, unless what was given contradicts its configuration."""
    if out is not None:
        raise SwingupError(f"--out {out} does not go with --resume {folder}: a run stays in its folder")
    saved, _ = read_settings(folder)
    given = {name: value for name, value in options.items() if value is not None}
    usual = vars(get_preset(default_options(options)["preset"]).config)
    given |= {name: value for name, value in vars(config).items() if value != usual[name]}
    known = vars(saved) | vars(saved.config)
    for name, value in given.items():
        if value != known[name]:
            raise SwingupError(
                f"{folder} was trained with {name} = {known[name]}, not {value}: resume it without "
                f"that option, or train anew with another --out"
            )
    return Run.resume(folder, frames)


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
    """A progress bar on a terminal; elsewhere a line every few seconds."""
    settings, domain = run.settings, run.settings.domain
    on = settings.preset if domain is None else f"{settings.preset}, domain {domain.name}"
    console.print(f"training {settings.name} ({on}) to {run.goal:,} frames in {run.folder}", soft_wrap=True)
    task = None if domain is None else settings.task()
    if isinstance(task, Sim2RealTask) and task.unseen:
        note = f"a policy behind an estimator trains without the domain's {' and '.join(task.unseen)}"
        console.print(f"note: {note}; its evaluations have them", soft_wrap=True, highlight=False)
    shown = -math.inf
    columns = (TextColumn("{task.description}"), BarColumn(bar_width=12), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        bar = progress.add_task("compiling", total=run.goal, completed=run.frames)
        for report in run.advance():
            first, second = _lines(report)
            progress.update(bar, completed=report.frames, description=f"{first}\n{second}")
            due = time.monotonic() - shown >= LINE_EVERY or report.frames >= run.goal
            if due and not console.is_terminal:
                left = (run.goal - report.frames) * run.settings.seeds / report.frames_per_second
                console.print(f"{first}  {max(0.0, left):.0f} s left  {second}", soft_wrap=True, highlight=False)
                shown = time.monotonic()


def _lines(report: Report) -> tuple[str, str]:
    """Where the run stands, in two lines that fit a narrow terminal; means over the seeds."""

    def mean(name: str) -> float:
        values = [math.nan if row[name] is None else row[name] for row in report.rows]
        return sum(values) / len(values)

    return (
        f"{report.frames:,} frames  {report.frames_per_second:,.0f}/s  reward {mean('reward'):.3f}",
        f"gains {mean('gain'):.3f} {mean('entropy_gain'):.3f}  entropy {mean('entropy'):.2f}  "
        f"score {mean('score'):.3f} (best {report.best_score:.3f})",
    )
