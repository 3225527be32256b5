"""The least torque that swings up, against what a swing-up with that torque does."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.controllers.swingups import least_torque as searching
from swingup.controllers.swingups.least_torque import Effort, least_torque
from swingup.controllers.swingups.transition import PendulumTransition
from swingup.plant.plant import LEADERBOARD, get_robot


@pytest.mark.parametrize("laws_until", [0.05, 0.3, 2.0], ids=["laws go on", "laws stop before", "laws never do"])
def test_more_friction_and_less_gravity_change_it_as_they_must(monkeypatch, laws_until):
    """By stand-ins: motions come up wherever the torque's unit is a tenth of the motor's or more.

    Steps of 0.8, and of its roots where one fails, find the tenth to 5 %.
    """

    def level_of(plant):
        return float(LEADERBOARD.m1 / plant.m1)

    def pump(plant, joint, dt, laws, steps):
        distance = 0.1 if level_of(plant) >= laws_until else 1.0
        return np.full(len(laws), distance), np.zeros((len(laws), steps))

    def solve(plant, joint, dt, torques):
        end = [np.pi if level_of(plant) >= 0.1 else 0.0, 0.0, 0.0, 0.0]
        return np.tile(end, (len(torques), 1)), np.asarray(torques)

    monkeypatch.setattr(searching, "_pump", pump)
    monkeypatch.setattr(searching, "_solve", solve)
    found = least_torque(LEADERBOARD, get_robot("pendubot"), 5.0)
    assert 0.6 <= found <= 0.6 / 0.95
    # Dry friction of the driven joint, at most cf π/2, is overcome beside it.
    rough = least_torque(LEADERBOARD.changed(cf1=0.1, cf2=3.0), get_robot("pendubot"), 5.0)
    assert rough - found == pytest.approx(0.1 * np.pi / 2, rel=0.01)
    # A motor that is too weak is told by how much.
    weak = least_torque(LEADERBOARD.changed(tl1=0.5, tl2=0.5), get_robot("pendubot"), 5.0)
    assert weak == pytest.approx(0.6, rel=0.06)
    monkeypatch.setattr(searching, "STRONGEST", 1.1)
    assert least_torque(LEADERBOARD.changed(tl1=0.5, tl2=0.5), get_robot("pendubot"), 5.0) is None


def test_torques_of_laws_end_where_their_motions_are_nearest_to_upright():
    """Played from rest, whatever side their laws came up on: the distance is that of the last state."""
    transition, steps = PendulumTransition(LEADERBOARD, 1, 0.02, exact=False), 60
    laws = np.random.default_rng(3).normal(size=(8, 5)) * [9, 9, 2, 2, 6]
    with jax.enable_x64(True):
        distances, torques = searching._pump(LEADERBOARD, 1, 0.02, jnp.asarray(laws), steps)
        x = (np.zeros(8),) * 4
        for row in np.asarray(torques).T:
            x = transition.step(x, row)
    assert np.abs(torques).max() <= 6.0
    error = np.transpose(x) - [np.pi, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(error**2 @ searching.DISTANCE, distances, rtol=1e-6)


@pytest.mark.slow  # a search
def test_a_real_search_finds_a_torque_that_pumps():
    """A fifth of the torque that would hold the stretched arm level (3.8 N m) swings it up within five seconds."""
    found = least_torque(LEADERBOARD, get_robot("pendubot"), 5.0, Effort(starts=6, tries=1, laws=256))
    assert 0.1 < found < 1.2
