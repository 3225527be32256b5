"""The uptime of recordings, from sums done by hand."""

import numpy as np
import pytest

from swingup.benchmark.boards import UPTIME
from swingup.benchmark.plausibility import examine
from swingup.benchmark.rollout import Trajectory
from swingup.benchmark.score import score
from swingup.plant.robots import get_robot

UP, DOWN = [np.pi, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]


def rows(times, states):
    return Trajectory(np.array(times, float), np.array(states, float), np.zeros((len(times), 2)))


def test_a_row_that_is_up_counts_with_the_time_before_it(robot):
    # Uneven times; up in rows 0, 2, 3 and 5. Row 0 has no time before it:
    # (0.5 - 0.2) + (1.5 - 0.5) + (9.0 - 4.0) = 6.3 s of 60 s.
    found = score(rows([0.0, 0.2, 0.5, 1.5, 4.0, 9.0], [UP, DOWN, UP, UP, DOWN, UP]), robot, UPTIME, force=True)
    assert found.score == pytest.approx(6.3 / 60)


def test_up_is_strictly_above_nine_tenths_of_both_links():
    # Upright but for the elbow: 0.2 - 0.3 cos(π + q2) passes 0.45 m where cos q2 = 5/6.
    bend = np.arccos(0.25 / 0.3)
    states = [DOWN, [np.pi, bend - 1e-6, 0, 0], [np.pi, bend + 1e-6, 0, 0], [-3 * np.pi, 2 * np.pi, 0, 0]]
    found = score(rows([0.0, 1.0, 3.0, 7.0], states), "acrobot", UPTIME, force=True)
    # Rows 1 (1 s) and 3 (4 s, full turns away) are up, row 2 is not.
    assert 60 * found.score == pytest.approx(5.0)
    assert found.runs[0].tip.highest == pytest.approx(0.5)
    assert found.runs[0].tip.percent == pytest.approx(100.0)


def test_late_starts_and_other_lengths_of_the_run():
    # Times need not start at 0: the first row's own time is no time up. 30 s of 60 s is half.
    late = rows([0.1, 0.2, 30.2], [UP, DOWN, UP])
    assert score(late, "pendubot", UPTIME, force=True).score == pytest.approx(0.5)


def test_throws_on_the_passive_joint_are_no_warning_and_neither_is_another_rate():
    time = 0.003 * np.arange(1000)
    u = np.tile([5.0, 0.0], (1000, 1))
    found = examine(Trajectory(time, np.zeros((1000, 4)), u), get_robot("acrobot"), UPTIME)
    names = [each.name for each in found]
    assert "short_span" in names  # 3 s of 60 s
    assert not {"passive_torque", "rate", "torque_limit"} & set(names)
    assert "the rest counts as down" in found[0].text
    strong = examine(Trajectory(time, np.zeros((1000, 4)), 2 * u), get_robot("acrobot"), UPTIME)
    assert "passive_torque" in [each.name for each in strong]
