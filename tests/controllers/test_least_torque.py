"""The least torque that swings up, against what a swing-up with that torque does."""

import dataclasses

import pytest

from swingup.controllers.swingups import least_torque as searching
from swingup.controllers.swingups.least_torque import SEARCH, least_torque
from swingup.plant.plant import LEADERBOARD, get_robot


def test_more_friction_and_less_gravity_change_it_as_they_must(monkeypatch):
    """By a stand-in for the search that comes up wherever the torque's unit is a tenth of the motor's or more.

    From 6 N m down by 0.6: 3.6, 2.16, 1.296, 0.7776; then 0.5 fails, and steps of its roots find the tenth to 5 %.
    """
    limits = []

    def solve(plant, joint, dt, torques, settings):
        level = float(LEADERBOARD.m1 / plant.m1)
        limits.append(level)
        ends = searching.np.tile([searching.np.pi if level >= 0.1 else 0.0, 0.0, 0.0, 0.0], (len(torques), 1))
        return dataclasses.make_dataclass("Found", ["states", "torque"])(
            ends[:, None], searching.np.asarray(torques)
        )

    monkeypatch.setattr(searching, "_solve", solve)
    found = least_torque(LEADERBOARD, get_robot("pendubot"), 5.0)
    assert 0.6 <= found <= 0.6 / 0.95
    assert max(limits) == 1.0
    # Dry friction of the driven joint, at most cf π/2, is overcome beside it.
    rough = least_torque(LEADERBOARD.changed(cf1=0.1, cf2=3.0), get_robot("pendubot"), 5.0)
    assert rough - found == pytest.approx(0.1 * searching.np.pi / 2, rel=0.01)
    # A motor that is too weak is told by how much.
    weak = least_torque(LEADERBOARD.changed(tl1=0.5, tl2=0.5), get_robot("pendubot"), 5.0)
    assert weak == pytest.approx(0.6, rel=0.06) or weak < 0.6


@pytest.mark.slow  # a search
def test_a_real_search_finds_a_torque_that_pumps():
    """A fifth of the torque that would hold the stretched arm level (3.8 N m) swings it up within five seconds."""
    search = dataclasses.replace(SEARCH, starts=6)
    assert 0.1 < least_torque(LEADERBOARD, get_robot("pendubot"), 5.0, search) < 1.2
