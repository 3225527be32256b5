"""The report of a run after each chunk."""

from dataclasses import dataclass
from typing import Any

from ..common.arrays import finite
from .progress import TrainingProgress, score_of
from .rates import shown_rate, training_resets
from .run_settings import RunSettings


@dataclass(frozen=True)
class TrainingReport:
    """The progress of a run after a chunk; its text is one line."""

    frames: int
    """Frames of each seed so far."""
    frames_per_second: float
    """Frames of all seeds together in a second, since the last report, evaluation and files included."""
    rows: list[dict[str, Any]]
    """The rows of metrics.jsonl: one for each seed."""
    best_score: float | None
    """Best score of any seed so far."""

    @property
    def score(self) -> float | None:
        """Score of the best seed in this report; None where no episode ended that gives one."""
        return max((row["score"] for row in self.rows if row["score"] is not None), default=None)

    def __str__(self) -> str:
        row = self.rows[0]
        return (
            f"{self.frames:,} frames, {self.frames_per_second:.0f}/s, reward {shown_rate(row['reward'])}, "
            f"gain {shown_rate(row['gain'])}, resets per 1,000 steps {shown_rate(training_resets(row))}, "
            f"score {shown_rate(self.score)}, best {shown_rate(self.best_score)}"
        )


def make_report(
    settings: RunSettings,
    progress: TrainingProgress,
    rate: float,
    figures: list[dict[str, Any]],
    evaluations: list[dict[str, Any]],
) -> TrainingReport:
    """The report of a chunk.

    ``rate`` counts frames of all seeds per second, figures are each seed's means over the chunk.
    """
    frames = progress.iterations * settings.config.rollout_size
    rows = []
    for index, (figure, result) in enumerate(zip(figures, evaluations, strict=True)):
        row = {
            "seed": settings.seed + index,
            "frames": frames,
            "seconds": round(progress.seconds, 3),
            "frames_per_second": round(rate, 1),
            **figure,
            **result,
            "best_score": score_of(progress.best[index]),
        }
        # JSON has no NaN: numbers that are not finite become null.
        rows.append(finite(row))
    return TrainingReport(frames, rate, rows, score_of(max(progress.best)))
