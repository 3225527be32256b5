"""The least torque that swings up, against what a swing-up with that torque does."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.controllers.swingups import least_torque as searching
from swingup.controllers.swingups.least_torque import PIECES, Effort, least_torque, switches
from swingup.controllers.swingups.transition import PendulumTransition
from swingup.plant.plant import LEADERBOARD, get_robot


def test_more_friction_and_less_gravity_change_it_as_they_must(monkeypatch):
    """By stand-ins: motions come up wherever the torque's unit is a tenth of the motor's or more.

    Steps of 0.6, and of its roots where one fails, find the tenth to 5 %.
    """

    def pump(plant, joint, dt, laws, steps):
        return np.ones(len(laws)), np.ones((len(laws), steps))

    def evolve(plant, joint, dt, members, key, steps, effort):
        distance = 0.0 if float(LEADERBOARD.m1 / plant.m1) >= 0.1 else 1.0
        return np.full(len(members), distance), np.asarray(members)[:, 0]

    monkeypatch.setattr(searching, "_pump", pump)
    monkeypatch.setattr(searching, "_evolve", evolve)
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


def test_switches_of_a_torque_are_the_lengths_of_its_signs():
    found = switches(np.array([0.0, 0.0, 3.0, 6.0, -6.0, -1.0, -2.0, 5.0]))
    assert found[:3].tolist() == [2.0, 3.0, 1.0]
    assert found.shape == (PIECES,)
    assert switches(np.tile([1.0, -1.0], 40)).tolist() == [1.0] * PIECES


def played(torques, plant=LEADERBOARD, dt=0.02):
    """The squared distances from both uprights that the torques reach from rest, by the transition alone."""
    transition, x, errors = PendulumTransition(plant, 1, dt, exact=False), (np.zeros(1),) * 4, []
    for torque in torques:
        x = transition.step(x, np.array([torque]))
        errors += [np.ravel(x) - [side * np.pi, 0.0, 0.0, 0.0] for side in (1, -1)]
    return np.min(np.square(errors) @ searching.DISTANCE)


def test_the_distance_of_a_law_is_that_of_its_torques():
    laws = np.random.default_rng(3).normal(size=(8, 5)) * searching.LAW
    with jax.enable_x64(True):
        distances, torques = searching._pump(LEADERBOARD, 1, 0.02, jnp.asarray(laws), 60)
        assert np.abs(torques).max() <= 6.0
        np.testing.assert_allclose([played(np.asarray(row)) for row in torques], distances, rtol=1e-6)


def test_evolution_keeps_its_best_and_plays_switching_torques():
    """Pieces of 10.5 steps of 6 and -6 N m: the step between them has their mean, 0. One member has no motion."""
    plant, start = LEADERBOARD.changed(m1=6.0, m2=6.0, I1=0.4, I2=0.6), np.full((2, 6, PIECES), 10.5)
    start[0, -1] = np.nan
    with jax.enable_x64(True):
        run = lambda generations: searching._evolve(  # noqa: E731
            plant, 1, 0.05, jnp.asarray(start), jax.random.key(0), 60, Effort(generations, 2, 6, 2)
        )
        first, later = run(1), run(8)
        torques = ([6.0] * 10 + [0.0] + [-6.0] * 10) * 3
        np.testing.assert_allclose(first[0], played(torques[:60], plant, 0.05), rtol=1e-6)
        assert np.all(later[0] < first[0])
        for distance, lengths in zip(*later, strict=True):
            ends = np.append(0.0, np.cumsum(lengths))
            sums = np.append(0.0, np.cumsum(lengths * 6.0 * np.array([1, -1] * (PIECES // 2))))
            torque = np.diff(np.interp(np.arange(61), ends, sums))
            assert played(torque, plant, 0.05) == pytest.approx(float(distance), rel=1e-6)


@pytest.mark.slow  # a search
def test_a_real_search_finds_a_torque_that_pumps():
    """A fifth of the torque that would hold the stretched arm level (3.8 N m) swings it up within five seconds."""
    found = least_torque(LEADERBOARD, get_robot("pendubot"), 5.0, Effort(generations=20, laws=256))
    assert 0.1 < found < 1.2
