"""95 % intervals of means and shares over seeds."""

import math
from collections.abc import Sequence
from statistics import fmean, stdev

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
