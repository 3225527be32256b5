"""Comparisons of learners over several runs on several tasks.

Scores are tables with a row for each run and a column for each task; a flat sequence is runs of a single task. The
intervals are 95 % stratified bootstrap intervals (``swingup.benchmark.interval.stratified_bootstrap``).
Source: Agarwal et al., Deep RL at the edge of the statistical precipice (arXiv 2108.13264), section 4.
"""

import numpy as np
from numpy.typing import ArrayLike

from ..common.errors import SwingupError
from ..common.text import quoted
from .interval import Interval, score_table, stratified_bootstrap


def probability_of_improvement(ours: ArrayLike, theirs: ArrayLike) -> float:
    """Probability that a run of ours scores higher than one of theirs on a task drawn at random.

    For each task it is the share of pairs of runs in which ours scores higher; a tie counts half (the Mann-Whitney
    U statistic over the number of pairs). The result is the mean over the tasks. Each task may have its own scale.

    Args:
        ours: shape (runs,) or (runs, tasks).
        theirs: the same tasks in the same order; the number of runs may differ.

    Raises:
        SwingupError: the scores have other shapes, the tasks differ in number, or a score is no number.
    """
    return float(_improvement(*_two_tables(ours, theirs)))


def improvement_interval(ours: ArrayLike, theirs: ArrayLike, resamples: int = 10_000) -> Interval:
    """95 % interval of the probability of improvement: the runs of both learners are resampled.

    Args:
        ours: as in ``probability_of_improvement``.
        theirs: scores of the other learner, in the same form.
        resamples: as in ``stratified_bootstrap``.

    Raises:
        SwingupError: as ``probability_of_improvement``.
    """
    low, high = stratified_bootstrap(_improvement, *_two_tables(ours, theirs), resamples=resamples)
    return float(low), float(high)


def performance_profile(scores: ArrayLike, thresholds: ArrayLike) -> np.ndarray:
    """Share of the runs, of all tasks, whose score is above each threshold.

    The runs of all tasks are pooled, so their scores need a common scale.

    Args:
        scores: shape (runs,) or (runs, tasks).
        thresholds: shape (thresholds,), in the scores' unit.

    Returns:
        Shape (thresholds,).

    Raises:
        SwingupError: the scores or the thresholds have other shapes, or one of them is no number.
    """
    return _profile(score_table("scores", scores), _levels(thresholds))


def profile_interval(scores: ArrayLike, thresholds: ArrayLike, resamples: int = 10_000) -> np.ndarray:
    """95 % interval of the performance profile at each threshold by itself.

    Args:
        scores: as in ``performance_profile``.
        thresholds: as in ``performance_profile``.
        resamples: as in ``stratified_bootstrap``.

    Returns:
        Low and high ends, shape (2, thresholds).

    Raises:
        SwingupError: as ``performance_profile``.
    """
    levels = _levels(thresholds)
    return stratified_bootstrap(lambda drawn: _profile(drawn, levels), scores, resamples=resamples)


def _improvement(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """From shapes (..., runs, tasks) to (...)."""
    wins: np.ndarray = np.zeros(ours.shape[:-2])
    # Run by run: all pairs of all resamples at once would take gigabytes.
    for run in range(theirs.shape[-2]):
        their = theirs[..., run : run + 1, :]
        wins += (ours > their).mean((-2, -1)) + 0.5 * (ours == their).mean((-2, -1))
    return wins / theirs.shape[-2]


def _profile(scores: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """From the shape (..., runs, tasks) to (..., thresholds)."""
    return np.stack([(scores > level).mean((-2, -1)) for level in levels], axis=-1)


def _levels(thresholds: ArrayLike) -> np.ndarray:
    """Thresholds in one dimension."""
    table = score_table("thresholds", thresholds)
    if table.shape[1] != 1:
        raise SwingupError(f"thresholds = {quoted(thresholds)}: use a flat sequence of numbers")
    return table[:, 0]


def _two_tables(ours: ArrayLike, theirs: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Two learners' tables with the same tasks."""
    tables = score_table("ours", ours), score_table("theirs", theirs)
    numbers = [table.shape[1] for table in tables]
    if numbers[0] != numbers[1]:
        raise SwingupError(
            f"ours has scores of {numbers[0]} tasks, theirs of {numbers[1]}: give both the same tasks"
        )
    return tables
