"""Means over seeds and tasks, and their intervals."""

import math
from collections.abc import Callable, Sequence
from statistics import fmean, stdev

import numpy as np
from numpy.typing import ArrayLike

from ..common.checks import whole_number
from ..common.errors import SwingupError
from ..common.text import quoted

Interval = tuple[float, float]

Statistic = Callable[..., np.ndarray]
"""A statistic of one table of scores or more: from shapes (..., runs, tasks) to (...) or (..., values)."""

LARGEST_BLOCK = 1_000_000
"""Scores that are resampled at once, so that a hundred runs of fifty tasks fit in memory."""


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


def share_interval(successes: int, number: int) -> Interval:
    """Wilson's 95 % interval of a share of successes."""
    from scipy.stats import binomtest  # imported here: slow to load

    interval = binomtest(successes, number).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def interquartile_mean(scores: ArrayLike) -> float:
    """Mean of the middle half of all scores: a quarter of them, rounded down, is left out at each end.

    The runs of all tasks are pooled, so their scores need a common scale.
    Source: Agarwal et al., Deep RL at the edge of the statistical precipice (arXiv 2108.13264), section 4.3.

    Args:
        scores: shape (runs,) or (runs, tasks).

    Raises:
        SwingupError: the scores have another shape, or one of them is no number.
    """
    return fmean(_middle_half(score_table("scores", scores).ravel()).tolist())


def bootstrap_interval(scores: ArrayLike, resamples: int = 10_000) -> Interval:
    """95 % interval of the interquartile mean; the same scores give the same interval.

    Args:
        scores: shape (runs,) or (runs, tasks), as ``interquartile_mean`` takes them.
        resamples: as in ``stratified_bootstrap``.

    Raises:
        SwingupError: the scores have another shape, or one of them is no number.
    """

    def means(drawn: np.ndarray) -> np.ndarray:
        mean: np.ndarray = _middle_half(drawn.reshape(len(drawn), -1)).mean(axis=-1)
        return mean

    low, high = stratified_bootstrap(means, scores, resamples=resamples)
    return float(low), float(high)


def stratified_bootstrap(statistic: Statistic, *scores: ArrayLike, resamples: int = 10_000) -> np.ndarray:
    """95 % percentile bootstrap interval of a statistic; the same scores give the same interval.

    A resample draws as many runs as there are, with replacement, for each task and each table separately. The
    interval is about other seeds on the same tasks, not about other tasks.
    Source: Agarwal et al. (arXiv 2108.13264), section 4.1.

    Args:
        statistic: computed for many resamples at once; its arguments have the shape (resamples, runs, tasks).
        scores: one table or more, each of the shape (runs,) or (runs, tasks).
        resamples: number of resamples; each draws from all tables.

    Returns:
        Low and high ends along the first axis, before the statistic's own axes: shape (2,) or (2, values).

    Raises:
        SwingupError: the scores have another shape, one of them is no number, or there is no resample.
    """
    tables = [score_table("scores", each) for each in scores]
    rng = np.random.default_rng(0)
    left = whole_number("resamples", resamples, 1)
    block = max(1, LARGEST_BLOCK // max(table.size for table in tables))
    found = []
    while left > 0:
        number = min(left, block)
        drawn = [
            np.take_along_axis(table[None], rng.integers(len(table), size=(number, *table.shape)), axis=1)
            for table in tables
        ]
        found.append(statistic(*drawn))
        left -= number
    ends: np.ndarray = np.percentile(np.concatenate(found), [2.5, 97.5], axis=0)
    return ends


def score_table(name: str, scores: ArrayLike) -> np.ndarray:
    """Scores with the shape (runs, tasks); those of a flat sequence are runs of a single task.

    Args:
        name: what the scores are called in the message.
        scores: shape (runs,) or (runs, tasks).

    Raises:
        SwingupError: the scores have another shape, or one of them is no number.
    """
    try:
        table = np.asarray(scores, float)
    except (TypeError, ValueError) as error:  # words, or rows of several lengths
        raise SwingupError(_wanted(name, scores)) from error
    if table.ndim not in (1, 2) or table.size == 0:
        raise SwingupError(_wanted(name, scores))
    if np.isnan(table).any():
        raise SwingupError(f"{name} = {quoted(scores)}: leave out runs without a score")
    return table.reshape(len(table), -1)


def _middle_half(values: np.ndarray) -> np.ndarray:
    """The values along the last axis without the least and the largest quarter, each rounded down."""
    number = values.shape[-1]
    return np.sort(values, axis=-1)[..., number // 4 : number - number // 4]


def _wanted(name: str, scores: object) -> str:
    return f"{name} = {quoted(scores)}: use one row for each run, with a number for each task"
