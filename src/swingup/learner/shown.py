"""Progress on standard error, for ``verbose`` and ``progress_bar``."""

import logging
import sys
from types import TracebackType
from typing import Any

from .rates import shown_rate, training_resets
from .report import TrainingReport

BAR_WIDTH = 30
"""Characters of the bar."""

_LOGGER = logging.getLogger(__name__)


def tell(report: TrainingReport, aloud: bool) -> None:
    """Log a report's line; ``aloud`` it is shown where the log does not show it."""
    row = report.rows[0]
    line = (
        f"{report.frames:,} frames, {report.frames_per_second:.0f}/s, reward {_short(row['reward'])}, "
        f"gain {_short(row['gain'])}, resets per 1,000 steps {shown_rate(training_resets(row))}, "
        f"score {_short(row['score'])}"
    )
    if aloud and not _LOGGER.isEnabledFor(logging.INFO):
        sys.stderr.write(line + "\n")
    else:
        _LOGGER.info("%s", line)


class ProgressBar:
    """A bar of one call of ``learn``, drawn anew in its line with each report."""

    def __init__(self, start: int, goal: int, wanted: bool) -> None:
        """A bar from ``start`` to ``goal`` frames; nothing is drawn where none is wanted."""
        self._start, self._goal, self._wanted = start, goal, wanted

    def __enter__(self) -> "ProgressBar":
        self.draw(self._start)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._wanted:
            sys.stderr.write("\n")

    def draw(self, frames: int, rate: float | None = None) -> None:
        """Draw the bar after so many frames, learned at this rate (frames per second)."""
        if not self._wanted:
            return
        # The last iteration may go beyond the goal.
        part = min(1.0, (frames - self._start) / (self._goal - self._start))
        filled = round(part * BAR_WIDTH)
        speed = "" if rate is None else f", {rate:.0f}/s"
        bar = "#" * filled + "." * (BAR_WIDTH - filled)
        sys.stderr.write(f"\r[{bar}] {part:4.0%}  {frames:,} frames{speed}   ")
        sys.stderr.flush()


def _short(value: Any) -> str:
    return "none" if value is None else f"{value:.4g}"
