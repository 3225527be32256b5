"""A training run before the user's eyes; signals stop it cleanly."""

import contextlib
import math
import shlex
import signal
from collections.abc import Callable, Iterator
from types import FrameType

from ..learner.progress import TrainingReport
from ..learner.rates import training_resets
from ..learner.run import Run
from .arguments import plant_note
from .parsing import program_typed
from .progress import Progress

Note = Callable[[TrainingReport], str]
"""Words among a report's figures; none where they are empty."""


def train_shown(run: Run, note: Note = lambda report: "") -> int:
    """Train to the goal, with the progress and a note on standard error, and free the environments.

    The exit status is 0, or that of the signal that stopped the run; then it is saved.
    """
    settings = run.settings
    on = settings.preset + ("" if settings.robot is None else plant_note(settings.plant, settings.robot))
    with Progress() as progress:
        progress.log(f"training {settings.name} ({on}) to {run.goal:,} frames in {run.folder}")
        progress.log("compiling")
        run.compile()  # first, so that the estimate of the time left does not contain it
        progress("frames", run.frames, run.goal)
        with _stopped_by_signals(run) as received:
            for report in run.advance():
                progress("frames", report.frames, run.goal, figures(report, note(report)))
        run.close()
        if not received:
            return 0
        command = f"{program_typed()} train --resume {shlex.quote(str(run.folder))}"
        progress.log(f"stopped at {run.frames:,} frames and saved: continue with {command}")
    # The status that shells give a program ended by this signal.
    return 128 + received[0]


def figures(report: TrainingReport, note: str = "") -> str:
    """What a report says, the most wanted first, since a narrow terminal cuts the end.

    Scores, rewards and resets are means over the seeds; resets are those per 1,000 steps, where there were some.
    """
    resets = [number for row in report.rows if (number := training_resets(row)) is not None]
    parts = [
        "" if report.best_score is None else f"best {report.best_score:.3f}",
        note,
        f"score {_mean(report, 'score'):.3f}",
        f"reward {_mean(report, 'reward'):.3f}",
        f"resets {sum(resets) / len(resets):.3g}/1k" if any(resets) else "",
        f"{report.frames_per_second / 1000:.3g}k/s",
    ]
    return "  ".join(part for part in parts if part)


def _mean(report: TrainingReport, name: str) -> float:
    values = [math.nan if row[name] is None else row[name] for row in report.rows]
    return sum(values) / len(values)


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
