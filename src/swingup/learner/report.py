"""The report of a run after each chunk."""

from dataclasses import dataclass
from typing import Any

import jax

from ..areapo.state import Metrics
from ..common.arrays import finite
from .progress import TrainingProgress
from .run_settings import RunSettings


@dataclass(frozen=True)
class TrainingReport:
    """The progress of a run after a chunk."""

    frames: int
    """Frames of each seed so far."""
    frames_per_second: float
    """Of all seeds together, since the last report, evaluation and files included."""
    rows: list[dict[str, Any]]
    """The rows of metrics.jsonl: one for each seed."""
    best_score: float
    """Best score of any seed so far."""


def make_report(
    settings: RunSettings,
    progress: TrainingProgress,
    rate: float,
    metrics: Metrics,
    extras: dict[str, Any],
    evaluations: list[dict[str, Any]],
) -> TrainingReport:
    """The report of a chunk.

    Args:
        settings: of the run.
        progress: after the chunk.
        rate: frames of all seeds per second.
        metrics: means over the chunk; of several seeds, with a leading axis.
        extras: further figures of the back end.
        evaluations: results of each seed's policy.
    """
    frames = progress.iterations * settings.config.rollout_size
    rows = []
    for index, result in enumerate(evaluations):
        mine = metrics if settings.seeds == 1 else jax.tree.map(lambda leaf, i=index: leaf[i], metrics)
        row = {
            "seed": settings.seed + index,
            "frames": frames,
            "seconds": round(progress.seconds, 3),
            "frames_per_second": round(rate, 1),
            **mine.as_dict(),
            **extras,
            **result,
            "best_score": progress.best[index],
        }
        # JSON has no NaN: numbers that are not finite become null.
        rows.append(finite(row))
    return TrainingReport(frames, rate, rows, progress.best_score)
