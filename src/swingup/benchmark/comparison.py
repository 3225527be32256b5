"""Comparisons of learners over several runs on several tasks.

Scores are tables with a row for each run and a column for each task; a flat sequence is runs of a single task. An
axis in front of these is one of several tables, each of which gets a value: :func:`bootstrap_interval` makes it.
Source: Agarwal et al., Deep RL at the edge of the statistical precipice (arXiv 2108.13264), section 4.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..common.checks import whole_number
from ..common.errors import SwingupError
from ..common.text import quoted

LARGEST_BLOCK = 1_000_000
"""Scores that are resampled at once, so that a hundred runs of fifty tasks fit in memory."""


def interquartile_mean(scores: ArrayLike) -> Any:
    """Mean of the middle half of all scores: a quarter of them, rounded down, is left out at each end.

    The runs of all tasks are pooled, so their scores need a common scale.

    Args:
        scores: shape (runs,) or (..., runs, tasks).

    Raises:
        SwingupError: the scores have another shape, or one of them is not a number.
    """
    table = score_table("scores", scores)
    pooled = np.sort(table.reshape(*table.shape[:-2], -1), axis=-1)
    number = pooled.shape[-1]
    return pooled[..., number // 4 : number - number // 4].mean(axis=-1)


def probability_of_improvement(ours: ArrayLike, theirs: ArrayLike) -> Any:
    """Probability that a run of ours scores higher than one of theirs on a task drawn at random.

    For each task it is the share of pairs of runs in which ours scores higher; a tie counts half (the Mann-Whitney
    U statistic over the number of pairs). The result is the mean over the tasks. Each task may have its own scale.

    Args:
        ours: shape (runs,) or (..., runs, tasks).
        theirs: the same tasks in the same order; the number of runs may differ.

    Raises:
        SwingupError: the scores have other shapes, the tasks differ in number, or a score is not a number.
    """
    mine, other = score_table("ours", ours), score_table("theirs", theirs)
    if mine.shape[-1] != other.shape[-1]:
        numbers = f"ours has scores of {mine.shape[-1]} tasks, theirs of {other.shape[-1]}"
        raise SwingupError(f"{numbers}: give both the same tasks")
    wins = np.zeros(mine.shape[:-2])
    # Run by run: all pairs of all resamples at once would take gigabytes.
    for run in range(other.shape[-2]):
        their = other[..., run : run + 1, :]
        wins += (mine > their).mean((-2, -1)) + 0.5 * (mine == their).mean((-2, -1))
    return wins / other.shape[-2]


def performance_profile(scores: ArrayLike, thresholds: ArrayLike) -> np.ndarray:
    """Share of the runs, of all tasks, whose score is above each threshold; shape (..., thresholds).

    The runs of all tasks are pooled, so their scores need a common scale.

    Args:
        scores: shape (runs,) or (..., runs, tasks).
        thresholds: shape (thresholds,), in the scores' unit.

    Raises:
        SwingupError: the scores or the thresholds have other shapes, or one of them is not a number.
    """
    table, levels = score_table("scores", scores), score_table("thresholds", thresholds)
    if levels.shape[1:] != (1,):
        raise SwingupError(f"thresholds = {quoted(thresholds)}: use a flat sequence of numbers")
    return np.stack([(table > level).mean((-2, -1)) for level in levels[:, 0]], axis=-1)


def bootstrap_interval(statistic: Callable[..., Any], *scores: ArrayLike, resamples: int = 10_000) -> np.ndarray:
    """95 % percentile bootstrap interval of a statistic; the same scores give the same interval.

    A resample draws as many runs as there are, with replacement, for each task and each table separately. The
    interval is about other seeds on the same tasks, not about other tasks (section 4.1 of the source).

    Args:
        statistic: one of the functions above, or another one of tables (resamples, runs, tasks).
        scores: one table or more, each of the shape (runs,) or (runs, tasks).
        resamples: number of resamples; each draws from all tables.

    Returns:
        Low and high ends along the first axis, before the statistic's own axes: shape (2,) or (2, values).

    Raises:
        SwingupError: the scores have another shape, one of them is not a number, or there is no resample.
    """
    tables = [score_table("scores", each, most=2) for each in scores]
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


def score_table(name: str, scores: ArrayLike, most: int = 3) -> np.ndarray:
    """Scores of the shape (..., runs, tasks), of at most so many axes."""
    wanted = f"{name} = {quoted(scores)}: use one row for each run, with a number for each task"
    try:
        table = np.asarray(scores, float)
    except (TypeError, ValueError) as error:  # words, or rows of several lengths
        raise SwingupError(wanted) from error
    if not 1 <= table.ndim <= most or table.size == 0:
        raise SwingupError(wanted)
    if np.isnan(table).any():
        raise SwingupError(f"{name} = {quoted(scores)}: leave out runs without a score")
    return table[:, None] if table.ndim == 1 else table
