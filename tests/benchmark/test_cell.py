"""A CloudPendulum cell's disturbances, call by call beside plain Python, and the board's four cells."""

import math

import jax
import numpy as np
import pytest

from swingup.benchmark.boards import BOARDS
from swingup.benchmark.uptime_board import draw_cell
from swingup.loop.domain import load_domain
from swingup.loop.supervisors.cell import Cell, CellSettings, Disturbances, example_disturbances
from swingup.loop.supervisors.limits import Limits, Stop

from .independent import gravity

RULES, CELLS = BOARDS["cloudpendulum"], load_domain("cells")
CALLS = 4000


class Text:
    """The example in plain Python: a list of (kind, value, anywhere), taken in turn."""

    def __init__(self, events):
        self.events, self.now, self.since, self.began, self.last = list(events), None, 0.0, 0.0, 0.0

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
        self.last = t
        if self.now is None:
            return "none", np.zeros(2)
        if self.now[0] == "kick":
            return "kick", np.array([self.now[1], 0.0])
        error = np.array([turned(self.now[1][i] - x[i]) for i in range(2)])
        return "move", 0.1 * error - 0.004 * x[2:] - gravity(CELLS.plant.values(), x)


def turned(angle):
    return math.remainder(angle, 2 * math.pi)


def near(x, target):
    return all(abs(turned(target[i] - x[i])) < 0.3 for i in range(2))


def events_of(given):
    return [
        ("kick", float(kick), bool(anywhere)) if kick else ("move", tuple(target), bool(anywhere))
        for target, kick, anywhere in zip(given.target, given.kick, given.anywhere, strict=True)
    ]


@jax.jit
def called(cell, times, states):
    def call(memory, given):
        return cell(memory, *given)

    return jax.lax.scan(call, cell.start(times.dtype), (times, states))[1]


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


@pytest.mark.parametrize("seed", [0, 1])
def test_call_by_call_as_the_example(seed):
    given = example_disturbances(np.random.default_rng(seed))
    times, states = visits(seed)
    with jax.enable_x64(True):
        cell = Cell(given, CellSettings(), CELLS.plant, Stop(Limits(math.inf, 50.0)))
        found = jax.tree.map(np.asarray, called(cell, times, states))
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
    other = example_disturbances(np.random.default_rng(1))
    assert not np.array_equal(given.kick, other.kick)


def test_a_cell_stops_at_its_speed_limit():
    never = Disturbances(np.zeros((1, 2)), np.zeros(1), np.zeros(1, bool))
    with jax.enable_x64(True):
        cell = Cell(never, CellSettings(), CELLS.plant, Stop(Limits(math.inf, 50.0)))
        states = np.array([[900.0, 0, 49.9, 0], [0, 0, 0, -50.1], [0, 0, 0, 0]])
        found = jax.tree.map(np.asarray, called(cell, np.array([0.0, 0.002, 0.004]), states))
    assert found.stops.tolist() == found.takes.tolist() == [False, True, True]


def test_the_board_has_four_cells_of_thirty_seconds():
    assert (RULES.runs, RULES.duration, RULES.domain) == (4, 30.0, "cells")
    assert "Ours" in RULES.note
    drawn = [draw_cell(RULES, CELLS.plant, seed).disturbances.kick for seed in range(4)]
    assert len({each.tobytes() for each in drawn}) == 4
