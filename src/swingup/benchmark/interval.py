"""Means over seeds, and their intervals."""

import math
from collections.abc import Sequence
from statistics import fmean, stdev

import numpy as np

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


def interquartile_mean(values: Sequence[float]) -> float:
    """Mean of the middle half: a quarter of the values, rounded down, is left out at each end.

    Source: Agarwal et al., Deep RL at the edge of the statistical precipice (arXiv 2108.13264).
    """
    cut = len(values) // 4
    return fmean(sorted(values)[cut : len(values) - cut])


def bootstrap_interval(values: Sequence[float], resamples: int = 10_000) -> Interval:
    """95 % percentile bootstrap interval of the interquartile mean; the same values give the same interval."""
    drawn = np.random.default_rng(0).choice(np.asarray(values, float), (resamples, len(values)))
    cut = len(values) // 4
    means = np.sort(drawn, axis=1)[:, cut : len(values) - cut].mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)
