"""The shipped adaptive controllers have one clock, whose zero means nothing, and no count of their calls.

What they command follows from the state estimate, the plant found and their own memory alone: no time, no number of
calls, no exact zeros and no periods or limits of a board decide. What they score stands at the end.
"""

import numpy as np
import pytest

import swingup
from swingup.controllers.registry import get_controller
from swingup.policy.shipped import ADAPTIVE, AR_EAPO
from swingup.runtime import load_controller

from .backends import BACK_ENDS
from .references import ADAPTIVES, DT, numpy_run, policy, within

BINARY = 2.0**-9
"""A period near 2 ms (s). It has few digits: times with and without the shift differ by it to the last bit."""


@pytest.mark.slow
@pytest.mark.parametrize("name", ADAPTIVES)
def test_clocks_that_count_from_an_epoch(name, tmp_path):
    """In NumPy and C; a period that the clock rounds, by 1e-4 s at most, is rounded alike for both."""
    times, states, expected = numpy_run(name, BINARY)
    given = within(name, expected)
    numpys, cs = (BACK_ENDS[each].make(policy(name), tmp_path) for each in ("numpy", "c"))
    torques = cs.run(times, states, given)
    for epoch in (1e9, 1.76e9, 2.0**32, 1.76e12, -1e9):
        np.testing.assert_array_equal(numpy_run(name, BINARY, epoch)[2], expected)
        np.testing.assert_array_equal(cs.run(times + epoch, states, given), torques)
        rounded = (DT * np.arange(len(times)) + epoch, states, given)
        np.testing.assert_allclose(cs.run(*rounded), numpys.run(*rounded), rtol=0, atol=1e-6)


@pytest.mark.slow  # JAX compiles identifier and regulator for seconds
@pytest.mark.parametrize(("policy", "within"), [(ADAPTIVE, 1e-2), (AR_EAPO, 1e-4)])
def test_scores(either_robot, policy, within):
    name = either_robot.name
    score = swingup.judge(get_controller(policy, name), name).criteria.score
    assert score > ({"acrobot": 0.699, "pendubot": 0.694}[name] if policy == ADAPTIVE else 0.3)
    in_numpy = swingup.judge(load_controller(policy, name), name).criteria.score
    assert in_numpy == pytest.approx(score, abs=within)
