"""The uptime boards: runs with throws, and recordings of them."""

import dataclasses
import math

import jax.numpy as jnp
import numpy as np
import pytest

from swingup import BOARDS, judge, score
from swingup.benchmark import uptime_board
from swingup.benchmark.board import Setting
from swingup.benchmark.boards import ICRA_REAL, UPTIME
from swingup.benchmark.plausibility import examine
from swingup.benchmark.rollout import Trajectory
from swingup.benchmark.uptime_board import draw_resets, draw_throws
from swingup.loop.resolve import resolve
from swingup.loop.starts import TURNS, thrown_states
from swingup.loop.supervisors import Disturbances, Limits
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, get_robot

from .controllers import FRICTION, HANGING, Counting, Memoryless, PlainCounting
from .independent import ResetText, Throw, World, closed_loop, gravity, rk4

BRIEF = dataclasses.replace(UPTIME, name="brief", duration=2.0, throws=3, first_throw=0.4, jitter=0.1)
BOTH = {"tl1": 6.0, "tl2": 6.0}
"""Torque limits (N m): both motors are there."""


def test_a_run_agrees_with_a_numpy_loop(robot):
    result = judge(Counting(), robot, BRIEF, seed=3)
    plain = PlainCounting()
    plain.init()
    p = LEADERBOARD.driven(robot).values()
    throws, pid = draw_throws(BRIEF, LEADERBOARD, 3), Throw(p, 10.0, 0.1, 1.0)

    def control(x, t):
        number = throws.number[round(t / BRIEF.dt)]
        return plain.get_control_output(x, t) if number < 0 else pid(throws.target[number], x)

    rows = closed_loop(p | BOTH, (0, 1), control, np.zeros(4), BRIEF.dt, World(BRIEF.steps))
    np.testing.assert_allclose(result.trajectory.x, rows[:, 1:5], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(result.trajectory.u, rows[:, 5:], rtol=1e-6, atol=1e-6)
    height = -0.2 * np.cos(rows[:, 1]) - 0.3 * np.cos(rows[:, 1] + rows[:, 2])
    assert result.score == pytest.approx(np.mean(height > 0.45))
    # Both motors are there, for the controller too, and the throws saturate them.
    assert np.all(np.abs(result.trajectory.u).max(axis=0) == 6.0)
    assert not np.any(result.trajectory.u[1:, 0] == 0)


@pytest.mark.parametrize(("torque", "warned"), [(0.4, []), (0.6, ["passive_torque"])])
def test_a_controller_that_drives_the_passive_joint_is_told_apart(robot, torque, warned):
    found = judge(Memoryless(lambda t, x: torque * jnp.cos(t) * jnp.ones(2)), robot, BRIEF, 1)
    assert np.abs(found.trajectory.u).max() == 6.0  # of the throws
    assert [each.partition(":")[0] for each in found.warnings] == warned


def test_a_cells_kicks_are_not_the_controllers(monkeypatch):
    """Kicks of the shoulder come at once; the controller leaves it alone."""
    monkeypatch.setattr(uptime_board, "example_disturbances", lambda random: Disturbances(KICKED, np.ones(3), ONCE))
    found = judge(HANGING, "acrobot", dataclasses.replace(BOARDS["cloudpendulum"], duration=1.0), 1)
    assert np.abs(found.trajectory.u[:, 0]).max() > 0.05
    assert found.warnings == ()


KICKED, ONCE = np.full((3, 2), np.nan), np.ones(3, bool)


def test_another_pendulum_is_thrown_in_its_own_units(similar):
    small = similar(LEADERBOARD)
    rules = dataclasses.replace(ICRA_REAL, duration=1.0, first_throw=0.2, throws=2, jitter=0.1)
    found = judge(HANGING, "acrobot", rules, 1, domain=resolve(domain={"plant": small}))
    assert np.abs(found.trajectory.u).max() == pytest.approx(0.025 * 6.0, rel=0.3)
    assert ICRA_REAL.on(Setting(get_robot("acrobot"), load_plant("C.1"))) == ICRA_REAL


TIMES = {"duration": 3.0, "throws": 2, "first_throw": 0.8, "jitter": 0.1, "throw_duration": 0.201}
BRIEF_REAL = dataclasses.replace(ICRA_REAL, name="brief", **TIMES, limits=Limits(3.0, 8.0), height=-0.97)
"""Three seconds in which the pendulum exceeds the limits, and a line that the tip passes.

A throw lasts no whole number of steps of 2 ms. Else the rounding of its clock, a sum that each compilation
rounds in its own way, decides whether it lasts one step more.
"""


@pytest.mark.parametrize(
    ("make", "name", "stop"),
    [
        (Counting, "acrobot", 25.0),
        (Counting, "pendubot", 9.0),
        pytest.param(PlainCounting, "acrobot", 9.0, marks=pytest.mark.slow),
    ],
)
def test_the_robots_rules_agree_with_a_numpy_loop(make, name, stop):
    rules = dataclasses.replace(BRIEF_REAL, stop=Limits(4 * math.pi, stop))
    found = judge(make(), name, rules, 1, seed=5, domain=FRICTION)
    planned = draw_resets(rules, FRICTION.plant, 5)
    assert planned.target.shape == (101, 2)
    model, plain = LEADERBOARD.driven(get_robot(name)).values(), PlainCounting()
    resets = ResetText(list(planned.plan), planned.target, model, (3.0, 8.0), rules.throw_duration)
    plain.init()

    def control(x, t):
        u = resets(t, x)
        return plain.get_control_output(x, t) if u is None else u

    world = World(round(3.0 / rules.dt), stop=[4 * math.pi, 4 * math.pi, stop, stop])
    rows = closed_loop(load_plant("C.1").values() | BOTH, (0, 1), control, np.zeros(4), rules.dt, world)
    # Inserted resets, and a controller that is called between them.
    assert resets.number > sum(time < rows[-1, 0] for time in planned.plan)
    assert 0 < plain.calls < len(rows)
    np.testing.assert_allclose(found.trajectory.time, rows[:, 0], rtol=1e-14)
    np.testing.assert_allclose(found.trajectory.x, rows[:, 1:5], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.trajectory.u, rows[:, 5:], rtol=1e-5, atol=1e-5)
    assert found.runs[0].stop == (None if stop == 25.0 else pytest.approx(rows[-1, 0] + rules.dt))
    height = -0.2 * np.cos(rows[:, 1]) - 0.3 * np.cos(rows[:, 1] + rows[:, 2])
    # The first row has no time before it, and what a stop cuts off counts as down.
    assert found.score == pytest.approx(0.002 * np.sum(height[1:] > -0.485) / 3.0)
    assert 0.05 < found.score < 0.95
    assert score(found.trajectory, name, rules).score == pytest.approx(found.score)


def test_the_real_boards_resets_come_at_their_times():
    plans = np.array([draw_resets(ICRA_REAL, FRICTION.plant, seed).plan for seed in range(20)])
    # Means at 60/11 s, 120/11 s, ..., 600/11 s, within 1 s.
    assert np.abs(plans - 60 / 11 * np.arange(1, 11)).max() <= 1.0


def test_throws_come_at_their_times_and_last_a_hundred_steps_or_one_more():
    lengths, targets = set(), set()
    for seed in range(20):
        throws = draw_throws(UPTIME, LEADERBOARD, seed)
        targets.add(throws.target[0, 0])
        assert throws.number.shape == (30_000,)
        for index in range(15):
            steps = np.flatnonzero(throws.number == index)
            assert np.all(np.diff(steps) == 1)
            lengths.add(len(steps))
            # Means at 3.75 s, 7.5 s, ..., 56.25 s, within 1 s.
            assert abs(steps[0] * 0.002 - 3.75 * (index + 1)) <= 1.002
        assert np.all(np.abs(throws.target) <= np.pi)
        assert throws.target.shape == (15, 2)
    assert (lengths, len(targets)) == ({100, 101}, 20)


def test_thrown_states_are_ends_of_throws(either_robot):
    found = thrown_states(np.random.default_rng(5), LEADERBOARD.driven(either_robot), 40)
    assert found.shape == (40, 4)
    # The same numbers, thrown one by one by the independent loop: calls before give the PID its last error.
    random, p = np.random.default_rng(5), LEADERBOARD.driven(either_robot).values()
    turns = [random.choice(len(odds), 40, p=odds) - len(odds) // 2 for odds in TURNS]
    upright = np.stack([np.pi * (2 * turns[0] + 1), 2 * np.pi * turns[1], np.zeros(40), np.zeros(40)], axis=1)
    starts = upright + 0.05 * random.normal(size=(40, 4))
    targets, lasts = random.uniform(-np.pi, np.pi, (40, 2)), random.uniform(-6, 6, (40, 2))
    for x, target, last, end in list(zip(starts, targets, lasts, found, strict=True))[:8]:
        total = np.zeros(2)
        for _ in range(100):
            error = target - x[:2]
            total = total + error
            u = np.clip(10 * error + 1e-4 * total + (error - last) / 0.001, -6, 6) - gravity(p, x)
            x, last = rk4(p, x, np.clip(u, -6, 6), 0.002), error
        np.testing.assert_allclose(end, x, rtol=2e-3, atol=2e-3)  # single precision, and fast


UP, DOWN = [np.pi, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]


def rows(times, states):
    return Trajectory(np.array(times, float), np.array(states, float), np.zeros((len(times), 2)))


def test_a_row_that_is_up_counts_with_the_time_before_it(robot):
    # Uneven times; up in rows 0, 2, 3 and 5. Row 0 has no time before it, and a gap counts as 0.1 s:
    # (0.05 - 0.02) + (0.12 - 0.05) + 0.1 = 0.2 s of 60 s.
    found = score(rows([0.0, 0.02, 0.05, 0.12, 0.2, 9.0], [UP, DOWN, UP, UP, DOWN, UP]), robot, UPTIME, force=True)
    assert found.score == pytest.approx(0.2 / 60)
    # Times need not start at 0: the first row's own time is no time up. 30 s of 60 s is half.
    time = 0.1 + 0.05 * np.arange(602)
    late = rows(time, np.where(np.arange(602)[:, None] > 1, UP, DOWN))
    assert score(late, robot, UPTIME, force=True).score == pytest.approx(0.5)
    # What a recording has beyond the board's minute does not count.
    time = 0.05 * np.arange(1800)
    longer = rows(time, np.where(time[:, None] <= 60, UP, DOWN))
    assert score(longer, robot, UPTIME, force=True).score == pytest.approx(1.0)


def test_a_shorter_board_has_fewer_throws():
    board = dataclasses.replace(UPTIME, duration=4.0, throws=1)
    throws = [draw_throws(board, LEADERBOARD, seed).number.max() for seed in range(20)]
    # It comes 2.75 to 4.75 s after the start, or never.
    assert set(throws) == {-1, 0}


def test_throws_on_the_passive_joint_are_no_warning_and_neither_is_another_rate():
    time = 0.003 * np.arange(1000)
    u = np.tile([5.0, 0.0], (1000, 1))
    found = examine(Trajectory(time, np.zeros((1000, 4)), u), get_robot("acrobot"), UPTIME)
    names = {each.name for each in found}
    assert "short_span" in names  # 3 s of 60 s
    assert not {"passive_torque", "rate", "torque_limit"} & names
    assert "the rest counts as down" in found[0].text
    strong = examine(Trajectory(time, np.zeros((1000, 4)), 2 * u), get_robot("acrobot"), UPTIME)
    assert "passive_torque" in [each.name for each in strong]
