"""Resets and a CloudPendulum cell's disturbances, call by call beside plain Python that follows their text."""

import math

import jax
import numpy as np
import pytest

from swingup.benchmark.boards import BOARDS
from swingup.benchmark.uptime_board import draw_cell
from swingup.loop.resolve import resolve
from swingup.loop.supervisors import (
    Cell,
    CellSettings,
    Disturbances,
    Limits,
    Resets,
    Stop,
    Thrower,
    example_disturbances,
)
from swingup.plant.plant import LEADERBOARD, get_robot

from .independent import ResetText, gravity

MODEL = LEADERBOARD.driven(get_robot("acrobot"))
ANGLE, SPEED = 3.5 * math.pi, 20.0
GOALS = np.random.default_rng(3).uniform(-math.pi, math.pi, (101, 2))
PID = Thrower(kp=2.0, ki=0.0, kd=0.3, dt=0.001, limit=6.0, proportional_limit=3.0)
CALLS = 3500


@jax.jit
def called(supervisor, times, states):
    """What it does and its memories, call by call."""

    def call(memory, given):
        after, done = supervisor(memory, *given)
        return after, (done, after)

    return jax.lax.scan(call, supervisor.start(times.dtype), (times, states))[1]


def follow(times, states, plan, goals=GOALS):
    """Torques of both, call by call (NaN where the controller drives), and the last memories."""
    count, text = len(times), ResetText(plan, goals, MODEL.values(), (ANGLE, SPEED))
    # One shape, and so one compilation, for all tests.
    plan = np.concatenate([plan, np.full(5 - len(plan), np.inf)])
    times, states = (np.pad(rows, [(0, CALLS - count)] + [(0, 0)] * (rows.ndim - 1)) for rows in (times, states))
    with jax.enable_x64(True):
        resets = Resets(plan, goals, 1.0, 10, Limits(ANGLE, SPEED), PID, MODEL, Stop(Limits(math.inf, math.inf)))
        done, memories = jax.tree.map(np.asarray, called(resets, times, states))
    answers = [text(t, x) for t, x in zip(times[:count], states, strict=False)]
    expected = np.array([np.full(2, np.nan) if u is None else u for u in answers])
    found = np.where(memories.active[:count, None], done.torque[:count], np.nan)
    return found, expected, jax.tree.map(lambda rows: rows[count - 1], memories), text


def wander(seed):
    """Uneven times of about 2.7 ms, and states that cross the limits now and then."""
    random = np.random.default_rng(seed)
    times = np.concatenate([[0.0], np.cumsum(random.uniform(0.0015, 0.004, CALLS - 1))])
    noise, states = random.normal(0, [0.95, 0.95, 1.9, 1.9], (CALLS, 4)), np.zeros((CALLS, 4))
    for k in range(1, CALLS):
        states[k] = 0.98 * states[k - 1] + noise[k]  # deviations of 5 rad and 10 rad/s
    return times, states


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_call_by_call_as_the_text_says(seed):
    # 9.6 s; the last planned reset comes after the end. Both angles and both speeds exceed their limits at times.
    times, states = wander(seed)
    assert np.all(np.abs(states).max(axis=0) > [ANGLE, ANGLE, SPEED, SPEED])
    found, expected, memory, text = follow(times, states, [1.0, 3.5, 5.0, 7.0, 30.0])
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    assert memory.begun == text.number
    assert memory.begun > memory.planned  # some were inserted
    next_one = [1.0, 3.5, 5.0, 7.0, 30.0][int(memory.planned)] + float(memory.delay)
    assert next_one == pytest.approx(text.times[text.number])


def test_without_violations_resets_come_by_plan_and_last_a_second():
    times = 0.002 * np.arange(3000)
    found, expected, memory, _ = follow(times, np.zeros((3000, 4)), [1.0, 2.5])
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    driven = ~np.isnan(found[:, 0])
    starts = np.flatnonzero(np.diff(driven.astype(int), prepend=0) == 1)
    np.testing.assert_allclose(times[starts], [1.0, 2.5])
    # The clock is 0.002 k in call k after the first, and the first call above 1.0 s drives no more.
    assert driven.sum() in (1000, 1001, 1002)
    assert (memory.begun, memory.planned, memory.delay) == (2, 2, 0.0)
    # Hanging at rest: P clipped to 3 N m where 2 |goal| is more, no D, and no gravity torque. The first call of
    # the second reset spans the change of goals: its D saturates.
    np.testing.assert_allclose(found[starts[0]], np.clip(2 * GOALS[0], -3, 3), atol=1e-12)
    np.testing.assert_allclose(found[starts[1]], 6 * np.sign(GOALS[1] - GOALS[0]), atol=1e-12)
    np.testing.assert_allclose(found[starts[1] + 1], np.clip(2 * GOALS[1], -3, 3), atol=1e-12)


@pytest.mark.parametrize(
    ("plan", "samples", "joint", "value", "times"),
    [
        # One fast sample at t = 3 inserts a reset and moves the plan to 7 and 12.
        ([4.0, 9.0], [300], 3, -20.1, [3.0, 7.0, 12.0]),
        # Planned at 1 s; a violation at 3 s moves 4 and 9 by 3 - 1 = 2 s; one at 4.5 s by another 4.5 - 3 = 1.5 s.
        ([1.0, 4.0, 9.0], [300, 450], 0, 11.0, [1.0, 3.0, 4.5, 7.5, 12.5]),  # 3.5 π is 10.996
    ],
)
def test_violations_delay_the_plan_by_the_time_since_the_reset_before(plan, samples, joint, value, times):
    clock, states = 0.01 * np.arange(800), np.zeros((800, 4))
    states[samples, joint] = value
    _, _, memory, text = follow(clock, states, plan)
    assert text.times == pytest.approx([*times, math.inf])
    come = sum(each < 8.0 for each in times)
    assert (memory.begun, memory.planned) == (come, come - len(samples))
    assert memory.delay == pytest.approx(times[-1] - plan[-1])


def test_the_robot_stops_at_wider_limits_and_brakes():
    stop = Stop(Limits(4 * math.pi, 25.0))
    supervisor = Resets(np.array([30.0]), GOALS, 1.0, 10, Limits(ANGLE, SPEED), PID, MODEL, stop)
    with jax.enable_x64(True):
        memory, step = supervisor.start(np.dtype(float)), jax.jit(lambda *given: supervisor(*given))
        seen = []
        for t, speed in [(0.0, 5.0), (0.002, 24.9), (0.004, 25.1), (0.006, 1.0)]:
            memory, done = step(memory, t, np.array([0.0, 0.0, speed, -2.0]))
            seen.append((bool(done.takes), bool(done.stops)))
    # 24.9 rad/s throws, 25.1 stops, for good.
    assert seen == [(False, False), (True, False), (True, True), (True, True)]
    np.testing.assert_allclose(done.torque, [-1.0, 2.0])  # 1 N m s/rad against the velocities


RULES = BOARDS["cloudpendulum"]
CELLS = resolve(domain=RULES.domain)


class Text:
    """The example in plain Python: a list of (kind, value, anywhere), taken in turn."""

    def __init__(self, events):
        self.events, self.now, self.since, self.began = list(events), None, 0.0, 0.0

    def __call__(self, t, x):
        """What acts now, and the torque of a move."""
        if self.now is not None:
            kind, value, _ = self.now
            if kind == "kick":
                over = t - self.began >= 0.1
            else:
                over = (near(x, value) and max(abs(x[2]), abs(x[3])) < 2.0) or t - self.began > 2.0
            if over:
                self.now, self.since = None, t
        elif self.events:
            anywhere = self.events[0][2]
            if not anywhere and not near(x, (math.pi, 0.0)):
                self.since = t
            if t - self.since >= (0.2 if anywhere else 3.0):
                self.now, self.began = self.events.pop(0), t
        if self.now is None:
            return "none", np.zeros(2)
        if self.now[0] == "kick":
            return "kick", np.array([self.now[1], 0.0])
        return "move", 0.1 * errors(x, self.now[1]) - 0.004 * x[2:] - gravity(CELLS.plant.values(), x)


def errors(x, target):
    return np.array([math.remainder(target[i] - x[i], 2 * math.pi) for i in range(2)])


def near(x, target):
    return np.abs(errors(x, target)).max() < 0.3


def events_of(given):
    return [
        ("kick", float(kick), bool(anywhere)) if kick else ("move", tuple(target), bool(anywhere))
        for target, kick, anywhere in zip(given.target, given.kick, given.anywhere, strict=True)
    ]


def visits(seed):
    """Uneven times, and states that go from one of the example's postures to another, mostly to the goal."""
    random = np.random.default_rng(seed)
    times = np.concatenate([[0.0], np.cumsum(random.uniform(0.002, 0.02, CALLS - 1))])
    states = np.zeros((CALLS, 4))
    for start in range(0, CALLS, 100):
        goal = (math.pi, 0.0) if random.uniform() < 0.8 else random.uniform(-math.pi, math.pi, 2)
        states[start : start + 100, :2] = goal + 2 * math.pi * random.integers(-1, 2, 2)
    states[:, :2] += random.uniform(-0.2, 0.2, (CALLS, 2))
    states[:, 2:] = random.uniform(-3, 3, (CALLS, 2))
    return times, states


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_call_by_call_as_the_example(seed):
    given = example_disturbances(np.random.default_rng(seed))
    times, states = visits(seed)
    with jax.enable_x64(True):
        cell = Cell(given, CellSettings(), CELLS.plant, Stop(Limits(math.inf, 50.0)))
        found, _ = jax.tree.map(np.asarray, called(cell, times, states))
    text = Text(events_of(given))
    for k, (t, x) in enumerate(zip(times, states, strict=True)):
        kind, torque = text(t, x)
        assert found.takes[k] == (kind == "move"), k
        np.testing.assert_allclose(found.push[k], torque if kind == "kick" else 0.0, atol=1e-15)
        if kind == "move":
            np.testing.assert_allclose(found.torque[k], torque, rtol=1e-12, atol=1e-12)
    # Some of each kind have come, and not all.
    assert 5 < len(text.events) < 50
    assert not found.stops.any()


def test_the_examples_disturbances():
    given = example_disturbances(np.random.default_rng(0))
    moves, weak = given.kick == 0, np.abs(given.kick) == 0.01
    assert (moves.sum(), weak.sum(), (~moves & ~weak).sum()) == (24, 20, 10)
    np.testing.assert_array_equal(given.anywhere, weak)
    postures = {(round(q1 / (math.pi / 4)), round(q2 / (math.pi / 2))) for q1, q2 in given.target[moves]}
    assert postures == {(i, j) for i in range(8) for j in (-1, 0, 1)}
    strong = sorted(given.kick[~moves & ~weak])
    assert strong == [-0.1, -0.08, -0.06, -0.04, -0.02, 0.02, 0.04, 0.06, 0.08, 0.1]


def test_a_cell_stops_at_its_speed_limit():
    never = Disturbances(np.zeros((1, 2)), np.zeros(1), np.zeros(1, bool))
    with jax.enable_x64(True):
        cell = Cell(never, CellSettings(), CELLS.plant, Stop(Limits(math.inf, 50.0)))
        states = np.array([[900.0, 0, 49.9, 0], [0, 0, 0, -50.1], [0, 0, 0, 0]])
        found, _ = jax.tree.map(np.asarray, called(cell, np.array([0.0, 0.002, 0.004]), states))
    assert found.stops.tolist() == found.takes.tolist() == [False, True, True]


def test_the_boards_cells_have_disturbances_of_their_own():
    drawn = {draw_cell(RULES, CELLS.plant, seed).disturbances.kick.tobytes() for seed in range(RULES.runs)}
    assert len(drawn) == 4
