"""95 % intervals of means and shares over seeds, and the mean of the middle half of them."""

import math
from collections.abc import Sequence
from statistics import fmean, stdev
from typing import Any

Interval = tuple[float, float]


def mean_interval(values: Sequence[float], lowest: float, highest: float) -> Interval:
    """Student's 95 % interval of the mean of two or more values, one a seed, cut to what is possible."""
    from scipy.stats import t  # imported here: slow to load, and only several seeds need it

    reach = float(t.ppf(0.975, len(values) - 1)) * stdev(values) / math.sqrt(len(values))
    return max(lowest, fmean(values) - reach), min(highest, fmean(values) + reach)


def share_interval(successes: int, number: int) -> Interval:
    """Wilson's 95 % interval of a share of successes."""
    from scipy.stats import binomtest  # imported here: slow to load

    interval = binomtest(successes, number).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def interquartile_mean(scores: Any, axis: int | None = None) -> Any:
    """Mean of the middle half: a quarter, rounded down, is left out at each end.

    Source: Agarwal et al., Deep RL at the edge of the statistical precipice (arXiv 2108.13264), section 4.
    """
    from scipy.stats import trim_mean  # imported here: slow to load

    return trim_mean(scores, 0.25, axis)


def interquartile_interval(scores: Sequence[float]) -> Interval:
    """Percentile bootstrap interval of the interquartile mean; a single score is both ends."""
    from scipy.stats import bootstrap  # imported here: slow to load

    if len(scores) == 1:
        return scores[0], scores[0]
    found = bootstrap((scores,), interquartile_mean, method="percentile", rng=0).confidence_interval
    return float(found.low), float(found.high)
