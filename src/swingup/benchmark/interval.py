"""Intervals of means over seeds."""

import math
from collections.abc import Sequence
from statistics import fmean, stdev

Interval = tuple[float, float]


def mean_interval(values: Sequence[float], lowest: float, highest: float) -> Interval:
    """Student's 95 % interval of the mean of two or more values, cut to what is possible.

    Args:
        values: one a seed.
        lowest: least possible value.
        highest: largest possible value.
    """
    from scipy.stats import t  # imported here: slow to load, and only several seeds need it

    reach = float(t.ppf(0.975, len(values) - 1)) * stdev(values) / math.sqrt(len(values))
    return max(lowest, fmean(values) - reach), min(highest, fmean(values) + reach)
