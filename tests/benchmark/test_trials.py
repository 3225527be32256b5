"""Judging for the real robots: their rules beside NumPy's loop, success, and what domains leave open."""

import dataclasses
import json
import math

import jax.numpy as jnp
import numpy as np
import pytest

from refusals import refusal
from swingup import BOARDS, get_controller, judge, load_plant, score
from swingup.benchmark.board import Case, Setting
from swingup.benchmark.boards import IROS_REAL, SIM2REAL
from swingup.benchmark.recording import recorded, save_trajectory
from swingup.benchmark.rollout import Record, Scenario, Trajectory
from swingup.benchmark.swing_up_board import realai_score
from swingup.benchmark.values import interquartile_interval, interquartile_mean, share_interval
from swingup.controllers.interface import from_zeros
from swingup.loop.resolve import resolve
from swingup.loop.supervisors import Limits
from swingup.plant.plant import get_robot

from .controllers import FRICTION, HANGING, SWINGING, Memoryless, swinging
from .independent import World, closed_loop

IROS = IROS_REAL
HASTY = {name: dataclasses.replace(each, spacing=0.3) for name, each in IROS.pushes.items()}
BRIEF = dataclasses.replace(IROS, duration=2.0, pushes=HASTY, height=-1.01)
"""With a line that the tip is above from the start, so that runs succeed."""


@pytest.mark.parametrize(("name", "least", "most"), [("acrobot", 0.5, 0.75), ("pendubot", 0.2, 0.5)])
def test_the_ten_sets_of_pushes(name, least, most):
    sets = [IROS.trial_pushes(get_robot(name), trial) for trial in range(20)]
    centre, width, peak = (
        np.array([getattr(each, of) for each in sets]) for of in ("centre", "width", "amplitude")
    )
    assert centre.shape == (20, 2, 2)  # two on each of the two joints
    assert np.diff(np.sort(centre.reshape(20, 4))).min() >= 1.0
    assert 0.0 < centre.min() <= centre.max() < 10.0
    assert 0.05 <= width.min() <= width.max() <= 0.1
    assert least <= np.abs(peak).min() <= np.abs(peak).max() <= most
    # Both signs come, no two of ten are alike, and trial 10 has the pushes of trial 0.
    assert {*np.sign(peak).ravel()} == {-1.0, 1.0}
    assert len({each.tobytes() for each in centre}) == 10
    np.testing.assert_array_equal(peak[3], peak[13])
    assert BOARDS["v2-real"].pushes == {}  # the calm board


def test_a_trial_agrees_with_a_numpy_loop(robot):
    # The controller pumps beyond the robot's limits within 0.3 s.
    rules = dataclasses.replace(BRIEF, limits=Limits(angle=1e3, speed=1e3))
    found = judge(SWINGING, robot, rules, 1, seed=4, domain=FRICTION)
    limits, drawn = np.where(np.array(robot.actuation) > 0, 6.0, 0.5), BRIEF.trial_pushes(robot, 4)
    plant = load_plant("C.1").values() | {"tl1": limits[0], "tl2": limits[1]}
    calm, rows = (
        closed_loop(plant, (0, 1), swinging, np.zeros(4), 0.002, World(1000, pushes=each)) for each in (None, drawn)
    )
    time, x = rows[:, 0], rows[:, 1:5]
    np.testing.assert_allclose(found.trajectory.x, x, rtol=1e-7, atol=1e-7)
    # What is recorded and scored is what was asked for, within the limits and without the pushes.
    u = np.clip([swinging(*row) for row in zip(x, time, strict=True)], -limits, limits)
    np.testing.assert_allclose(found.trajectory.u, u, rtol=1e-7, atol=1e-7)
    recording = Trajectory(time, x, u)
    assert found.score == pytest.approx(score(recording, robot, rules).score, rel=1e-6)
    # A robot with its own limits stops at the first row beyond them, and so does the score of a recording.
    limited = score(recording, robot, BRIEF)
    beyond = (np.abs(x) > [4 * math.pi, 4 * math.pi, 20, 20]).any(axis=1)
    assert (limited.score, limited.runs[0].stop) == (0.0, time[np.argmax(beyond)])
    shorter = dataclasses.replace(BRIEF, duration=time[np.argmax(beyond)])
    assert score(recording, robot, shorter).runs[0].stop is None
    assert 0.2 < found.score == found.values["best"] < 1
    assert (found.successes, found.runs[0].stop) == (1, None)
    # Calm, the trial goes otherwise: the pushes act.
    assert np.abs(calm[:, 1:5] - found.trajectory.x).max() > 0.05


def test_a_robot_that_stops_scores_nothing():
    rules = dataclasses.replace(BRIEF, limits=Limits(angle=4 * math.pi, speed=1.5))
    found = judge(SWINGING, "acrobot", rules, 1, domain=FRICTION)
    assert found.score == 0.0
    assert found.runs[0].stop is not None
    # The record ends before the state that exceeds the limit.
    assert np.abs(found.trajectory.x[:, 2:]).max() <= 1.5
    assert found.trajectory.time[-1] == pytest.approx(found.runs[0].stop - 0.002)
    row = json.loads(json.dumps(found.as_dict()))
    assert (row["board"], row["successes"], row["best"], row["score"]) == ("iros-real", 0, 0.0, 0.0)
    assert row["details"][0]["stop"] == found.runs[0].stop


def test_a_record_ends_with_the_time_of_the_rules():
    # Turns that come late make a simulation of 6 steps longer than 1 s: rows at 1.0 s and 1.3 s are left out.
    time = np.array([0.0, 0.3, 0.6, 0.8, 1.0, 1.3])
    over = np.array([False, False, False, False, False, True])
    x, u = np.arange(24.0).reshape(6, 4), np.arange(12.0).reshape(6, 2)
    rows = Trajectory(time, np.zeros((6, 4)), np.zeros((6, 2)), Record(x, u, over, over))
    record, stop = recorded(rows, 1.0)
    assert record.time.tolist() == [0.0, 0.3, 0.6, 0.8]
    np.testing.assert_array_equal(record.x, x[:4])
    np.testing.assert_array_equal(record.u, u[:4])
    # It stopped after the time of the rules, which does not count.
    assert stop is None
    assert recorded(rows, 2.0)[1] == 1.3


@pytest.mark.parametrize(
    ("name", "criteria", "best"),
    [("acrobot", (1.43, 15.95, 6.16, 0.23, 125.23), 0.594), ("pendubot", (0.77, 11.7, 7.33, 0.237, 49.53), 0.711)],
)
def test_published_criteria_give_the_published_scores(name, criteria, best):
    """AR-EAPO's best runs of IROS 2024 on the robot, as its public board prints them."""
    names = ("swingup_time", "energy", "torque_cost", "torque_smoothness", "velocity_cost")
    rules = IROS.on(Setting(get_robot(name), load_plant("C.1")))
    found = realai_score(dict(zip(names, criteria, strict=True)), rules.normalisers)
    assert found == pytest.approx(best, abs=0.001)


PUSHED = dataclasses.replace(SIM2REAL, duration=2.5)
"""Long enough for the domain's push, which comes within 2 s."""
ROBOT = {"plant": "C.1", "design": "leaderboard"}


def verdict(row=0, entry=0, value=0.0, fault=None, end=None):
    """The verdict on a run that hangs for a second and is up from then on, but for one entry of its states."""
    time = SIM2REAL.dt * np.arange(SIM2REAL.steps)
    x = np.where(time[:, None] < 1.0, 0.0, [np.pi, 0.0, 0.0, 0.0])
    x[row, entry] = value
    rows = Trajectory(time[:end], x[:end], np.zeros((len(time[:end]), 2)))
    return SIM2REAL.score(Case(Scenario(load_plant("C.1")), {"seed": 7}), rows, fault)


def test_success():
    run = verdict()
    assert (run.success, run.speed, run.fault) == (True, 0.0, None)
    assert run.angle == pytest.approx(np.pi)
    assert run.criteria.swingup_time == pytest.approx(1.0, abs=0.003)
    assert run.score == run.criteria.score > 0.9
    assert verdict(row=3900, value=0.0).score > 0.0  # down before the last 2 s


FAILURES = {
    "a fast shoulder": {"row": 2000, "entry": 2, "value": 20.1},
    "a fast elbow": {"row": 2000, "entry": 3, "value": -20.1},
    "turned": {"row": 100, "entry": 1, "value": 12.6},
    "down 8 s in": {"row": 4000},
    "down at the end": {"row": 4999},
    "a fault": {"fault": "it gave up"},
    # It is up in all rows of its last two seconds, of which there are none.
    "ended early": {"end": 3000},
}


@pytest.mark.parametrize("kind", FAILURES)
def test_failures(kind):
    run = verdict(**FAILURES[kind])
    assert (run.success, run.score, run.criteria.score, run.criteria.swingup_time) == (False, 0.0, 0.0, None)
    assert kind != "ended early" or run.tip.cause == "stopped"


def test_a_pendulum_without_motors_fails_and_seeds_differ(either_robot):
    def judged(domain, seed, seeds):
        return judge(HANGING, either_robot, PUSHED, seeds, seed=seed, domain=domain)

    quiet = judged(resolve(domain=ROBOT | {"velocity_noise": 0.1}), 0, 1)
    assert (quiet.successes, quiet.score, quiet.success_interval[0]) == (0, 0.0, 0.0)
    pushed = resolve(domain=ROBOT | {"push": 3.0, "torque_limit": 6.0})
    both, second = judged(pushed, 0, 2), judged(pushed, 1, 1)
    assert np.abs(second.trajectory.x).max() > 0.01
    speeds = [run.speed for run in both.runs]
    assert speeds[0] != speeds[1] == pytest.approx(second.runs[0].speed, rel=1e-9)


def test_limits_and_records_do_not_see_the_encoders_zeros(tmp_path):
    around, plant = FRICTION.content, FRICTION.plant.changed(zero1=3.1, zero2=-0.7)
    turned_about = resolve(domain=around | {"zero1": 3.1, "zero2": -0.7, "design": "leaderboard"})
    rules = dataclasses.replace(BRIEF, limits=Limits(angle=3.0, speed=1e3))
    plain, found = (
        judge(each, "acrobot", rules, 1, seed=4, domain=on)
        for each, on in ((SWINGING, FRICTION), (from_zeros(SWINGING, plant), turned_about))
    )
    assert plain.runs[0].stop == found.runs[0].stop is not None
    np.testing.assert_allclose(found.trajectory.x, plain.trajectory.x, atol=1e-7)
    # A file shows what the encoders do, and is read so.
    save_trajectory(tmp_path / "run.csv", plain.trajectory, plant.zeros)
    read, expected = (
        score(each, "acrobot", "uptime", plant=plant) for each in (tmp_path / "run.csv", plain.trajectory)
    )
    np.testing.assert_allclose(read.trajectory.x, plain.trajectory.x, atol=1e-12)
    assert read.score == expected.score


def test_a_fast_loop_runs_as_long_as_a_slow_one():
    found = judge(HANGING, "acrobot", PUSHED, 1, domain=resolve(domain=ROBOT | {"period": 0.001}))
    assert found.trajectory.time[-1] == pytest.approx(PUSHED.duration, abs=0.0011)
    assert "never up" in found.tip.failure


def test_nobody_is_judged_on_calls_after_the_end():
    """A loop of 4 ms takes as many steps as one of 2 ms, and so twice the time."""
    domain, rules, table = (
        resolve(domain=ROBOT | {"period": 0.004}),
        dataclasses.replace(PUSHED, duration=0.4),
        [0.1] * 100,
    )

    def plain(x, t):
        return np.array([0.0, table[round(t / 0.004)]])

    def ends(t, x):
        return jnp.array([0.0, 1.0]) * jnp.where(t < 0.399, 0.1, jnp.nan)

    for controller in (plain, Memoryless(ends)):
        found = judge(controller, "acrobot", rules, 1, domain=domain)
        assert not found.faults
        assert len(found.trajectory.time) == 100
    told = refusal(judge, Memoryless(lambda t, x: ends(t + 0.2, x)), "acrobot", rules, 1, domain=domain)
    assert "not finite at t = 0.2 s" in told


def test_spoilt_samples_reach_controllers_of_both_kinds():
    def held(t, x):
        return jnp.array([0.0, 1.0]) * x[2]  # NaN for a spoilt sample

    domain = resolve(domain=ROBOT | {"spoilt": 0.05, "push": 3.0, "torque_limit": 6.0})
    asked, rules = [], dataclasses.replace(PUSHED, duration=0.4)

    def plain(x, t):
        asked.append(np.isfinite(x).all())
        return np.array([0.0, x[2]])

    first, second = (judge(each, "acrobot", rules, 1, domain=domain) for each in (Memoryless(held), plain))
    np.testing.assert_allclose(first.trajectory.x, second.trajectory.x, atol=1e-9)
    assert len(first.trajectory.time) == 200
    assert 0 < asked.count(False) < 40
    # A robot's record lacks them, also among its first rows, and goes on.
    whole = judge(Memoryless(held), "acrobot", BRIEF, 1, domain=resolve(domain=ROBOT | {"spoilt": 0.5}))
    assert whole.trajectory.time[-1] > 0.9 * BRIEF.duration
    assert len(whole.trajectory.time) == pytest.approx(500, abs=80)
    assert np.isfinite(whole.trajectory.x).all()


@pytest.mark.slow
def test_the_shipped_policies_swing_up_and_stay(either_robot):
    """Late calls, as of ``recorded``, must not spoil what the identifier finds: once they cost 1 run in 7."""
    judged = judge(get_controller("adaptive", either_robot), either_robot, "sim2real", 24, seed=40_000)
    least, score = {"acrobot": (20, 0.55), "pendubot": (23, 0.69)}[either_robot.name]
    assert judged.successes >= least
    assert judged.score > score
    assert sorted(run.speed for run in judged.runs)[12] < 16


def test_wilsons_interval():
    # (0.95 + z²/200 ± z sqrt(0.0475/100 + z²/40,000)) / (1 + z²/100), z = 1.96: (0.9692 ± 0.0468) / 1.0384.
    assert share_interval(95, 100) == pytest.approx((0.8882, 0.9785), abs=1e-4)


def test_the_middle_half():
    # Of 0, 1, 2, 3, 4, 5, 6, 70 two are left out at each end: the mean of 2, 3, 4, 5.
    assert interquartile_mean([[70, 1], [3, 5], [2, 0], [6, 4]]) == 3.5
    # Three times the worst has the probability 1/27, more than 2.5 %.
    assert interquartile_interval([1.0, 5.0, 3.0]) == (1.0, 5.0)
    assert interquartile_interval([2.0]) is None
