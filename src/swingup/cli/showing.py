"""A training run before the user's eyes: a progress bar or lines; signals stop the run cleanly."""

import contextlib
import math
import shlex
import signal
import time
from collections.abc import Iterator
from types import FrameType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from ..learner.run import Run
from .arguments import plant_note
from .parsing import program_typed
from .progress import WIDTH, Note, no_note, progress_line

PROGRESS_INTERVAL = 10.0
"""Seconds between lines where there is no terminal for a progress bar."""
BAR_WIDTH = 10


def train_shown(run: Run, note: Note = no_note) -> int:
    """Train to the goal, with the progress on standard error, and free the environments.

    Args:
        run: the run.
        note: words at the end of a report's line.

    Returns:
        0, or the exit status of the signal that stopped the run; then it is saved.
    """
    console = Console(stderr=True)
    _announce(run, console)
    console.print("compiling")
    run.compile()  # first, so that the estimate of the time left does not contain it
    with _stopped_by_signals(run) as received:
        _show(run, console, note)
    run.close()
    if not received:
        return 0
    command = f"{program_typed()} train --resume {shlex.quote(str(run.folder))}"
    console.print(
        f"stopped at {run.frames:,} frames and saved: continue with {command}", soft_wrap=True, markup=False
    )
    # The status that shells give a program ended by this signal.
    return 128 + received[0]


@contextlib.contextmanager
def _stopped_by_signals(run: Run) -> Iterator[list[int]]:
    """Ctrl-C and SIGTERM end the run after its iteration; a second one ends the program at once."""
    received: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        received.append(number)
        signal.signal(number, signal.SIG_DFL)
        run.stop()

    former = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    watched = signal.set_wakeup_fd(-1)  # the run is saved, however long its iteration takes
    try:
        yield received
    finally:
        signal.set_wakeup_fd(watched)
        for number, handler in former.items():
            signal.signal(number, handler)


def _show(run: Run, console: Console, note: Note) -> None:
    """Train with a progress bar on a terminal; elsewhere with a line every few seconds."""
    columns = (TextColumn("{task.description}", markup=False), BarColumn(bar_width=BAR_WIDTH))
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        bar = progress.add_task("training", total=run.goal, completed=run.frames)
        shown = -math.inf
        for report in run.advance():
            room = WIDTH if not console.is_terminal else min(console.width, WIDTH) - BAR_WIDTH - 1
            line = progress_line(report, run.goal, run.settings.seeds, room, note(report))
            progress.update(bar, completed=report.frames, description=line)
            due = time.monotonic() - shown >= PROGRESS_INTERVAL or report.frames >= run.goal
            if due and not console.is_terminal:
                console.print(line, soft_wrap=True, highlight=False, markup=False)
                shown = time.monotonic()


def _announce(run: Run, console: Console) -> None:
    """Print what is trained, for how long and where."""
    settings = run.settings
    on = settings.preset + ("" if settings.robot is None else plant_note(settings.plant, settings.robot))
    text = f"training {settings.name} ({on}) to {run.goal:,} frames in {run.folder}"
    console.print(text, soft_wrap=True, markup=False)
