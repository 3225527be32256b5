"""The table of a sweep: one row for each variant, over its seeds."""

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


def summarise_variants(outcomes: Sequence[JobOutcome]) -> list[VariantRow]:
    """One row a variant, in the order of the jobs."""
    rows = []
    for variant in dict.fromkeys(outcome.job.variant for outcome in outcomes):
        mine = [outcome for outcome in outcomes if outcome.job.variant == variant]
        # A failed run has the score NaN, which differs from itself.
        good = [outcome for outcome in mine if outcome.score == outcome.score]
        scores, best = [o.score for o in good], [o.best_score for o in good]
        none = float("nan")
        rows.append(
            VariantRow(
                variant=variant,
                runs=len(good),
                failed=len(mine) - len(good),
                score=interquartile_mean(scores) if scores else none,
                interval=bootstrap_interval(scores) if scores else (none, none),
                best=interquartile_mean(best) if best else none,
            )
        )
    return rows
