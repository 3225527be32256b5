"""Statistics over runs and tasks, by hand, by enumeration and beside those of rliable.

The numbers of rliable are of its version 1.2.0 with arch 7.2.0, after ``numpy.random.seed(0)``: 50,000 resamples,
and 20,000 for the probability of improvement. It is not installed with the tests: it needs two dozen packages, and
this arch fails to import with pandas 3.
"""

import itertools

import numpy as np
import pytest

from swingup.benchmark.comparison import (
    bootstrap_interval,
    interquartile_mean,
    performance_profile,
    probability_of_improvement,
)

OURS = np.array([[1.2, 0.4, 3.0], [0.9, 0.7, 2.0], [1.2, 0.1, 5.5], [2.5, 0.8, 4.0], [0.3, 0.4, 3.5]])
THEIRS = np.array([[1.0, 0.4, 2.0], [0.9, 0.6, 4.5], [1.4, 0.2, 1.0], [0.8, 0.4, 3.0]])
"""Five and four runs of three tasks, with ties."""
WAVES = np.sin(np.arange(60) ** 2.0).reshape(10, 6)
OTHER_WAVES = np.cos(np.arange(42) ** 2.0).reshape(7, 6)
"""Ten and seven runs of six tasks."""


@pytest.mark.parametrize(
    ("scores", "mean", "low", "high"),
    [
        (OURS, 1.4111111111111112, 1.0555555555555556, 1.8777777777777775),
        (THEIRS, 0.9500000000000002, 0.8166666666666668, 1.3),
        (WAVES, -0.057829206400635144, -0.30938263303991664, 0.20515911525794678),
    ],
    ids=["ours", "theirs", "waves"],
)
def test_interquartile_mean_is_that_of_rliable(scores, mean, low, high):
    assert interquartile_mean(scores) == pytest.approx(mean, rel=1e-12)
    # The ends are random in both programs.
    assert bootstrap_interval(interquartile_mean, scores) == pytest.approx((low, high), abs=0.04 * (high - low))


@pytest.mark.parametrize(
    ("ours", "theirs", "probability", "low", "high"),
    [
        (OURS, THEIRS, 0.6249999999999999, 0.4, 0.8333333333333334),
        (WAVES, OTHER_WAVES, 0.3928571428571428, 0.28095238095238095, 0.5095238095238095),
    ],
    ids=["ours", "waves"],
)
def test_probability_of_improvement_is_that_of_rliable(ours, theirs, probability, low, high):
    assert probability_of_improvement(ours, theirs) == pytest.approx(probability, rel=1e-12)
    found = bootstrap_interval(probability_of_improvement, ours, theirs)
    assert found == pytest.approx((low, high), abs=0.02 * (high - low))


@pytest.mark.parametrize(
    ("scores", "thresholds", "profile", "low", "high"),
    [
        (OURS, [0.0, 0.5, 1.0, 2.0, 4.0], [15, 11, 8, 5, 1], [15, 8, 6, 3, 0], [15, 14, 10, 7, 3]),
        (WAVES, [-0.9, -0.5, 0.0, 0.5, 0.9], [51, 40, 27, 18, 10], [46, 33, 20, 11, 5], [56, 47, 34, 25, 16]),
    ],
    ids=["ours", "waves"],
)
def test_performance_profile_is_that_of_rliable(scores, thresholds, profile, low, high):
    """In runs: the ends are whole numbers of them here, and the same in both programs."""
    assert performance_profile(scores, thresholds) * scores.size == pytest.approx(profile)
    found = bootstrap_interval(lambda drawn: performance_profile(drawn, thresholds), scores)
    assert found * scores.size == pytest.approx(np.array([low, high]))


def test_statistics_by_hand():
    # Runs and tasks are pooled. Of 0, 1, 2, 3, 4, 5, 6, 70 two are left out at each end: the mean of 2, 3, 4, 5.
    assert interquartile_mean([[70, 1], [3, 5], [2, 0], [6, 4]]) == 3.5
    # First task: 3 beats 1 and 2, and 2 beats 1 and ties with 2: 3.5 of 4 pairs. Second task: none of 4.
    assert probability_of_improvement([[3, 0], [2, 0]], [[1, 9], [2, 9]]) == (3.5 / 4 + 0) / 2
    assert probability_of_improvement([1.0, 4.0], [2.0, 3.0, 5.0]) == 2 / 6  # one task, unequal numbers of runs
    assert probability_of_improvement(OURS, OURS) == 0.5
    # A score at the threshold is not above it.
    assert performance_profile([[1, 2], [3, 4]], [0, 1, 2.5, 4]).tolist() == [1.0, 0.75, 0.5, 0.0]


def test_resamples_draw_the_learners_separately():
    # The probability of ours 1, 1 with theirs 0, 0 is 1/16; with common draws ours would always tie.
    assert bootstrap_interval(probability_of_improvement, [0.0, 1.0], [0.0, 1.0]).tolist() == [0.0, 1.0]
    # Three times the worst has the probability 1/27, more than 2.5 %.
    assert bootstrap_interval(interquartile_mean, [1.0, 5.0, 3.0]).tolist() == [1.0, 5.0]


def test_interval_is_that_of_all_resamples():
    """All 27 x 27 equally likely resamples of three runs of two tasks."""
    scores = np.array([[0.1, 1.7], [1.3, 2.2], [0.6, 0.9]])
    draws = list(itertools.product(range(3), repeat=3))
    means = [interquartile_mean([*scores[list(a), 0], *scores[list(b), 1]]) for a in draws for b in draws]
    exact = np.percentile(means, [2.5, 97.5])
    assert bootstrap_interval(interquartile_mean, scores, resamples=40_000) == pytest.approx(exact, abs=0.01)
