"""The uptime of recordings, from sums done by hand."""

import json

import numpy as np
import pytest

from swingup.benchmark.plausibility import examine
from swingup.benchmark.recorded_uptime import recorded_uptime
from swingup.benchmark.rollout import Trajectory
from swingup.benchmark.rules import UPTIME_RULES
from swingup.benchmark.trajectory_file import save_trajectory
from swingup.cli import main
from swingup.common.errors import SwingupError
from swingup.plant.robots import get_robot

UP, DOWN = [np.pi, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]


def rows(times, states):
    return Trajectory(np.array(times, float), np.array(states, float), np.zeros((len(times), 2)))


def test_a_row_that_is_up_counts_with_the_time_before_it(robot):
    # Uneven times; up in rows 0, 2, 3 and 5. Row 0 has no time before it:
    # (0.5 - 0.2) + (1.5 - 0.5) + (9.0 - 4.0) = 6.3 s of 60 s.
    found = recorded_uptime(rows([0.0, 0.2, 0.5, 1.5, 4.0, 9.0], [UP, DOWN, UP, UP, DOWN, UP]), robot)
    assert found.time_up == pytest.approx(6.3)
    assert found.uptime == pytest.approx(6.3 / 60)
    assert found.span == 9.0


def test_up_is_strictly_above_nine_tenths_of_both_links():
    # Upright but for the elbow: 0.2 - 0.3 cos(π + q2) passes 0.45 m where cos q2 = 5/6.
    bend = np.arccos(0.25 / 0.3)
    states = [DOWN, [np.pi, bend - 1e-6, 0, 0], [np.pi, bend + 1e-6, 0, 0], [-3 * np.pi, 2 * np.pi, 0, 0]]
    found = recorded_uptime(rows([0.0, 1.0, 3.0, 7.0], states), "acrobot")
    # Rows 1 (1 s) and 3 (4 s, full turns away) are up, row 2 is not.
    assert found.time_up == pytest.approx(5.0)
    assert found.highest_tip == pytest.approx(0.5)
    assert found.highest_tip_percent == pytest.approx(100.0)


def test_late_starts_and_other_lengths_of_the_run():
    # Times need not start at 0: the first row's own time is no time up. 30 s of 60 s is half.
    late = rows([0.1, 0.2, 30.2], [UP, DOWN, UP])
    assert recorded_uptime(late, "pendubot").uptime == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("times", "message"), [([0.0, 1.0, 1.0], "do not increase"), ([1.0, 2.0, 3.0], "starts at t = 1 s")]
)
def test_recordings_that_cannot_be_scored(times, message):
    with pytest.raises(SwingupError, match=message):
        recorded_uptime(rows(times, [DOWN] * 3), "acrobot")


def test_throws_on_the_passive_joint_are_no_warning_and_neither_is_another_rate():
    time = 0.003 * np.arange(1000)
    u = np.tile([5.0, 0.0], (1000, 1))
    found = examine(Trajectory(time, np.zeros((1000, 4)), u), get_robot("acrobot"), UPTIME_RULES["v3"])
    names = [each.name for each in found.warnings]
    assert "short_span" in names  # 3 s of 60 s
    assert not {"passive_torque", "rate", "torque_limit"} & set(names)
    assert "the rest counts as down" in found.warnings[0].text
    strong = examine(Trajectory(time, np.zeros((1000, 4)), 2 * u), get_robot("acrobot"), UPTIME_RULES["v3"])
    assert "passive_torque" in [each.name for each in strong.warnings]


def test_the_command(tmp_path, capsys):
    file = tmp_path / "minute.csv"
    save_trajectory(file, rows([0.0, 15.0, 60.0], [DOWN, UP, DOWN]))
    assert main(["score", str(file), "--robot", "acrobot", "--rules", "v3"]) == 0
    assert "Uptime score                 0.250   (up for 15.00 s of 60.00 s)" in capsys.readouterr().out
    assert main(["score", str(file), "--robot", "acrobot", "--rules", "v3", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["rules"], result["uptime"], result["time_up"]) == ("v3", 0.25, 15.0)
    assert main(["score", str(file), "--robot", "acrobot", "--rules", "v1"]) == 2
    assert "unknown rules of recordings 'v1': use one of v2, hardware, hardware-perturbed, v3" in (
        capsys.readouterr().err
    )
