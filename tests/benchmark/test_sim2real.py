"""Judging for the real robot: what counts as success, and that seeds differ in what the domain leaves open."""

import dataclasses

import numpy as np
import pytest

from swingup.benchmark.board import Case
from swingup.benchmark.boards import SIM2REAL
from swingup.benchmark.interval import share_interval
from swingup.benchmark.judge import judge
from swingup.benchmark.rollout import Scenario, Trajectory
from swingup.controllers.registry import get_controller
from swingup.loop.domain import make_domain
from swingup.plant.plant import load_plant

from .controllers import HANGING

BRIEF = dataclasses.replace(SIM2REAL, duration=2.5)
"""Long enough for the domain's push, which comes within 2 s."""
ROBOT = {"plant": "C.1", "design": "leaderboard"}
UPRIGHT = np.array([np.pi, 0.0, 0.0, 0.0])


def verdict(change, fault=None, end=None):
    """The verdict on a run that hangs for a second and is up from then on, but for a change of its states."""
    time = SIM2REAL.dt * np.arange(SIM2REAL.steps)
    x = np.where(time[:, None] < 1.0, 0.0, UPRIGHT)
    change(x, time)
    rows = Trajectory(time[:end], x[:end], np.zeros((len(time[:end]), 2)))
    return SIM2REAL.score(Case(Scenario(load_plant("C.1")), {"seed": 7}), rows, fault)


def test_success():
    run = verdict(lambda x, time: None)
    assert (run.success, run.speed, run.fault) == (True, 0.0, None)
    assert run.angle == pytest.approx(np.pi)
    assert run.criteria.swingup_time == pytest.approx(1.0, abs=0.003)
    assert run.score == run.criteria.score > 0.9


@pytest.mark.parametrize(
    ("row", "entry", "value"),
    [(2000, 2, 20.1), (2000, 3, -20.1), (100, 1, 12.6), (4000, 0, 0.0), (4999, 0, 0.0)],
    ids=["fast shoulder", "fast elbow", "turned", "down 8 s in", "down at the end"],
)
def test_failures(row, entry, value):
    def change(x, time):
        x[row, entry] = value

    run = verdict(change)
    assert not run.success
    assert run.score == 0.0


def test_down_before_the_last_two_seconds_is_no_failure():
    def change(x, time):
        x[3900, 0] = 0.0

    assert verdict(change).success
    assert not verdict(lambda x, time: None, "it gave up").success


@pytest.mark.slow
def test_a_run_that_ends_early_fails():
    """It is up in all rows of its last two seconds, of which there are none."""
    run = verdict(lambda x, time: None, end=3000)
    assert (run.success, run.tip.cause) == (False, "stopped")


def test_a_pendulum_without_motors_fails_and_seeds_differ(either_robot):
    def judged(domain, seed, seeds):
        return judge(HANGING, either_robot, BRIEF, seeds, seed=seed, domain=domain)

    quiet = judged(make_domain(ROBOT | {"velocity_noise": 0.1}), 0, 1)
    assert (quiet.successes, quiet.score) == (0, 0.0)
    assert quiet.success_interval[0] == 0.0
    pushed = make_domain(ROBOT | {"push": 3.0, "torque_limit": 6.0})
    both, second = judged(pushed, 0, 2), judged(pushed, 1, 1)
    assert np.abs(second.trajectory.x).max() > 0.01
    speeds = [run.speed for run in both.runs]
    assert speeds[0] != speeds[1] == pytest.approx(second.runs[0].speed, rel=1e-9)


@pytest.mark.slow
def test_the_shipped_policies_swing_up_and_stay(either_robot):
    """Late calls, as of ``recorded``, must not spoil what the identifier finds: once they cost 1 run in 7."""
    judged = judge(get_controller("adaptive", either_robot), either_robot, "sim2real", 24, seed=40_000)
    least, score = {"acrobot": (20, 0.55), "pendubot": (23, 0.69)}[either_robot.name]
    assert judged.successes >= least
    assert judged.score > score
    assert sorted(run.speed for run in judged.runs)[12] < 16


def test_wilsons_interval():
    """(p + z²/2n ± z sqrt(p (1 - p)/n + z²/4n²)) / (1 + z²/n) with z = 1.96."""
    z, n, p = 1.959963984540054, 100, 0.95
    middle, reach = p + z * z / (2 * n), z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    expected = [(middle - reach) / (1 + z * z / n), (middle + reach) / (1 + z * z / n)]
    assert share_interval(95, 100) == pytest.approx(expected)
