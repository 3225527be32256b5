"""The line that shows where a training run stands."""

import math
from collections.abc import Callable

from ..common.text import duration
from ..learner.rates import training_resets
from ..learner.report import TrainingReport

WIDTH = 80
"""Columns of a narrow terminal."""
LEAST_WANTED = ("reward", "resets", "best", "score")
"""What a line leaves out first where it would be too long."""
LEAST_WANTED_WITH_NOTE = ("reward", "resets", "rate", "score", "best")
"""The same of a line that ends with a note."""

Note = Callable[[TrainingReport], str]
"""Words at the end of a report's line; none where they are empty."""


def no_note(report: TrainingReport) -> str:
    """The note of a training that watches for nothing."""
    return ""


def progress_line(report: TrainingReport, goal: int, seeds: int, width: int = WIDTH, note: str = "") -> str:
    """Frames, speed, time left, means over the seeds, and a note of at most 24 letters, in ``width`` columns.

    The reward rate is that of training; resets are those per 1,000 steps of training, where there were some.
    """
    left = (goal - report.frames) * seeds / report.frames_per_second
    parts = {
        "frames": f"{report.frames:,} frames",
        "rate": f"{_short(report.frames_per_second)}/s",
        "left": f"{duration(left)} left",
        "reward": f"reward {_mean(report, 'reward'):.3f}",
        "resets": _resets(report),
        "score": f"score {_mean(report, 'score'):.3f}",
        "best": "" if report.best_score is None else f"best {report.best_score:.3f}",
        "note": note,
    }
    parts = {name: words for name, words in parts.items() if words}
    for name in LEAST_WANTED_WITH_NOTE if note else LEAST_WANTED:
        if name in parts and len("  ".join(parts.values())) > width:
            del parts[name]
    return "  ".join(parts.values())


def _mean(report: TrainingReport, name: str) -> float:
    values = [math.nan if row[name] is None else row[name] for row in report.rows]
    return sum(values) / len(values)


def _resets(report: TrainingReport) -> str:
    """Resets per 1,000 steps, the mean over the seeds; empty where there were none or none were counted."""
    counted = [resets for row in report.rows if (resets := training_resets(row)) is not None]
    return f"resets {sum(counted) / len(counted):.3g}/1k" if any(counted) else ""


def _short(rate: float) -> str:
    """A number in three digits."""
    for size, letter in ((1e6, "M"), (1e3, "k")):
        # From here on three digits round up to the next unit: 999.6 would be shown as 1e+03.
        if rate >= 0.9995 * size:
            return f"{rate / size:.3g}{letter}"
    return f"{rate:.3g}"
