"""The board that starts near the top, and a tip that only passes it."""

import numpy as np
import pytest

import swingup
from swingup.benchmark.boards import PERFORMANCE
from swingup.benchmark.swing_up_board import follow_tip
from swingup.plant.plant import LEADERBOARD, get_robot
from swingup.plant.upright import upright_needs


def test_an_lqr_is_judged_near_the_top():
    """Each run leans by at most a fifth of what the motor catches; the same law with the other sign falls."""
    lqr = swingup.get_controller("lqr", "acrobot")
    found = swingup.judge(lqr, "acrobot", "balance", 4)
    assert found.successes == 4
    leans = np.array([run.case.settings["lean"] for run in found.runs])
    assert 0 < np.abs(leans).max() <= 0.2 * upright_needs(LEADERBOARD, get_robot("acrobot")).tilt
    assert len(np.unique(leans)) == 4
    assert swingup.judge(lambda x, t: [0.0, 0.0], "acrobot", "balance", 2).successes == 0
    # Its record is scored again, from near the top.
    assert swingup.score(found.trajectory, "acrobot", "balance").successes == 1


@pytest.mark.parametrize(
    ("angle", "said"),
    [
        (lambda t: 8.0 * t, "never caught: the tip passes the top 13 times, for 0.11 s at most"),
        (lambda t: np.pi * np.clip(np.minimum(t, 8.0 - t), 0.0, 1.0), "up at t = 0.858 s, fell at t = 7.144 s"),
    ],
)
def test_what_spins_through_the_top_did_not_fall(angle, said):
    """At 8 rad/s the tip is up, within acos(0.9) = 0.451 rad of upright, for 0.113 s; 80 rad pass it 13 times."""
    t = np.arange(0.0, 10.002, 0.002)
    x = np.stack([angle(t), 0.0 * t, 0.0 * t, 0.0 * t], axis=1)
    found = follow_tip(t, x, 0.2, 0.3, PERFORMANCE)
    assert found.failure.startswith(said)
    assert found.cause == ("no swing-up" if "never" in said else "fell")
