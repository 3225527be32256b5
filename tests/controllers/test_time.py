"""Times of calls in single precision: whatever a clock's zero is, a controller answers alike."""

import equinox as eqx
import numpy as np
import pytest

from swingup.controllers.interface.time import split_time
from swingup.controllers.registry import get_controller

DT, HOURS, EPOCH = 0.002, 1e6, 1.76e9


def answers(controller, start):
    """Torques (40, 2) along a motion, in float32, on a clock that starts at a time (s)."""
    call, memory, torques = eqx.filter_jit(controller), controller.init(), []
    for t in DT * np.arange(40):
        x = np.array([np.sin(3 * t), np.cos(4 * t) - 1, 3 * np.cos(3 * t), -4 * np.sin(4 * t)], np.float32)
        memory, u = call(memory, split_time(start + t), x)
        torques.append(u)
    return np.array(torques)


def test_a_clock_may_start_anywhere():
    """Of a trajectory's follower behind an estimator."""
    found = get_controller("tvlqr", "acrobot", estimator=True)
    expected = answers(found, 0.0)
    assert np.ptp(expected) > 0.1
    for start in (HOURS, EPOCH):
        # The clock itself, in float64, resolves 2e-7 s at most.
        np.testing.assert_allclose(answers(found, start), expected, rtol=0, atol=1e-3)


def test_differences_of_split_times():
    first, second = split_time(EPOCH + 0.998), split_time(EPOCH + 1.0)
    assert float(second - first) == pytest.approx(DT, abs=3e-7)
    assert np.isnan(float(split_time(np.nan) - first))
