"""The table of a sweep: one row for each variant, over its seeds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..benchmark.interval import Interval, bootstrap_interval, interquartile_mean
from .jobs import JobOutcome


@dataclass(frozen=True)
class VariantRow:
    """A variant's runs."""

    variant: str
    runs: int
    """Runs with a score."""
    failed: int
    score: float
    """Interquartile mean of the last scores."""
    interval: Interval
    """Its 95 % bootstrap interval."""
    best: float
    """Interquartile mean of the best scores."""
    reward_rate: float
    """Interquartile mean of the last policies' reward rates; NaN where none was recorded."""
    resets_per_1000_steps: float
    """Likewise of their resets per 1,000 steps."""


def summarise_variants(outcomes: Sequence[JobOutcome]) -> list[VariantRow]:
    """One row a variant, in the order of the jobs."""
    rows = []
    for variant in dict.fromkeys(outcome.job.variant for outcome in outcomes):
        mine = [outcome for outcome in outcomes if outcome.job.variant == variant]
        # A failed run has the score NaN, which differs from itself.
        good = [outcome for outcome in mine if outcome.score == outcome.score]
        scores, best = [o.score for o in good], [o.best_score for o in good]
        rows.append(
            VariantRow(
                variant=variant,
                runs=len(good),
                failed=len(mine) - len(good),
                score=_middle(scores),
                interval=bootstrap_interval(scores) if scores else (math.nan, math.nan),
                best=_middle(best),
                reward_rate=_middle([o.reward_rate for o in good]),
                resets_per_1000_steps=_middle([o.resets_per_1000_steps for o in good]),
            )
        )
    return rows


def _middle(values: Sequence[float]) -> float:
    """The interquartile mean; NaN where a run lacks the value: a mean of the others would hide it."""
    return interquartile_mean(values) if values and not any(map(math.isnan, values)) else math.nan
