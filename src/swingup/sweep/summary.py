"""The table of a sweep: one row for each variant, over its seeds."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..benchmark.interval import Interval, bootstrap_interval, interquartile_mean
from ..common.arrays import finite
from ..learner.rates import RESETS, REWARD_RATE
from .jobs import JobOutcome


@dataclass(frozen=True)
class VariantRow:
    """A variant's runs; each number is an interquartile mean, or NaN where a run lacks it."""

    variant: str
    runs: int
    """Runs with a score."""
    failed: int
    score: float
    """Mean of the last scores."""
    interval: Interval
    """Its 95 % bootstrap interval."""
    best: float
    """Mean of the best scores."""
    reward_rate: float
    """Mean of the last policies' reward rates."""
    resets_per_1000_steps: float
    """Mean of the last policies' resets."""


def summarise_variants(outcomes: Sequence[JobOutcome]) -> list[VariantRow]:
    """One row a variant, in the order of the jobs."""
    rows = []
    for variant in dict.fromkeys(outcome.job.variant for outcome in outcomes):
        mine = [outcome for outcome in outcomes if outcome.job.variant == variant]
        good = [outcome for outcome in mine if not math.isnan(outcome.number("score"))]
        scores, *others = (
            [outcome.number(name) for outcome in good] for name in ("score", "best_score", REWARD_RATE, RESETS)
        )
        interval = bootstrap_interval(scores) if scores else (math.nan, math.nan)
        failed = len(mine) - len(good)
        rows.append(VariantRow(variant, len(good), failed, _middle(scores), interval, *map(_middle, others)))
    return rows


def as_json(content: Any) -> bytes:
    """JSON, in which null stands for NaN."""
    return (json.dumps(finite(content), indent=2) + "\n").encode()


def _middle(values: Sequence[float]) -> float:
    # A mean of the runs that have the value would hide the others.
    return interquartile_mean(values) if values and not any(map(math.isnan, values)) else math.nan
