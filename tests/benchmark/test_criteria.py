"""Criteria and scores of a swing-up by hand; the leaderboards: order, sources, failing rows."""

import csv
import json
import math
from importlib import resources
from statistics import fmean

import equinox as eqx
import numpy as np
import pytest

from refusals import refusal
from swingup import benchmark, get_controller
from swingup.benchmark.board import Setting
from swingup.benchmark.boards import BOARDS, PERFORMANCE
from swingup.benchmark.leaderboard import ENTRANTS, FURTHER_ENTRANTS, entrants_for, leaderboard, published_rows
from swingup.benchmark.robustness_board import CRITERIA
from swingup.benchmark.swing_up_board import Normalisers, SwingUpBoard, compute_criteria, realai_score
from swingup.controllers.stack.estimator import EstimatingController
from swingup.controllers.stack.policy import PolicyController
from swingup.controllers.stack.regulator import RegulatingController
from swingup.plant.plant import LEADERBOARD, get_robot
from swingup.policy.shipped import ADAPTIVE, AR_EAPO

from .controllers import HANGING

V2 = PERFORMANCE
L1, L2 = 0.2, 0.3
NAMES = ("swingup_time", "energy", "torque_cost", "torque_smoothness", "velocity_cost")


def rules(duration, height=0.9):
    return SwingUpBoard(name="test", normalisers=V2.normalisers, duration=duration, height=height)


def judge_heights(up, duration=None, dt=0.1):
    """Judge a run that is upright where ``up`` is 1 and hangs where it is 0, one row each dt."""
    time = dt * np.arange(len(up))
    x = np.zeros((len(up), 4))
    x[:, 0] = np.pi * np.array(up)
    run = rules(time[-1] if duration is None else duration)
    return compute_criteria(time, x, np.zeros((len(up), 2)), L1, L2, run)


def test_five_rows_by_hand():
    time = np.array([0.0, 0.1, 0.2, 0.4, 0.5])
    q1 = [0.0, 1.0, 3.0, math.pi, math.pi]
    q2 = [0.0, -0.5, 0.1, 0.0, 0.2]
    x = np.array([q1, q2, [0, 2, 3, -1, 9], [1, 0, -2, 0, 9]]).T
    u = np.array([[1, 0, 2, 2, 7], [2.0, -3, 1, -1, 5]]).T
    found = compute_criteria(time, x, u, L1, L2, rules(0.5))
    # Heights -0.2 cos q1 - 0.3 cos(q1 + q2): -0.5; -0.108 - 0.263; 0.198 + 0.3 = 0.498; 0.5; not looked at.
    # The line is 0.45, so that the tip is up from the third row on.
    assert found.success
    assert found.swingup_time == pytest.approx(0.2)
    # |Δq1 u1| = 1*1, 2*0, (π - 3)*2, 0*2; |Δq2 u2| = 0.5*2, 0.6*3, 0.1*1, 0.2*1; the last torques move nothing.
    energy = 1.0 + 2 * (math.pi - 3) + 1.0 + 1.8 + 0.1 + 0.2
    assert found.energy == pytest.approx(energy)
    # u² Δt = 5*0.1 + 9*0.1 + 5*0.2 + 5*0.1
    assert found.torque_cost == pytest.approx(0.5 + 0.9 + 1.0 + 0.5)
    # Δu1 = -1, 2, 0, 5: mean 1.5, mean square 30/4, variance 7.5 - 2.25 = 5.25 over the population.
    # Δu2 = -5, 4, -2, 6: mean 0.75, mean square 81/4 = 20.25, variance 20.25 - 0.5625 = 19.6875.
    smoothness = math.sqrt(5.25) + math.sqrt(19.6875)
    assert found.torque_smoothness == pytest.approx(smoothness)
    # q̇ᵀq̇ Δt = 1*0.1 + 4*0.1 + 13*0.2 + 1*0.1
    assert found.velocity_cost == pytest.approx(0.1 + 0.4 + 2.6 + 0.1)
    ratios = [0.2 / 20, energy / 60, 2.9 / 20, smoothness / 0.1, 3.2 / 400]
    assert found.score == pytest.approx(1 - sum(math.tanh(math.pi * ratio) for ratio in ratios) / 5)


@pytest.mark.parametrize(
    ("up", "swingup_time"),
    [
        ([0, 0, 1, 1, 1, 1], 0.2),  # the first row of the stretch
        ([0, 1, 1, 0, 1, 1, 1], 0.4),  # a drop in the middle restarts it
        ([1, 1, 1, 1, 1], 0.1),  # up all the time: the first row is not looked at
        ([0, 1, 1, 1, 1], 0.1),
        ([0, 0, 1, 1, 0], 0.2),  # nor is the last
        ([0, 0, 0, 0, 1, 0], 0.4),  # one row is a stretch
        ([0, 1, 0], 0.1),
        ([0, 1, 1, 1, 0, 1], None),  # down at the last row that is looked at
        ([0, 0, 0, 0, 1], None),  # up at the last row alone
        ([1, 0, 0, 0, 0], None),
        ([0, 0, 0], None),
        ([1, 1], None),  # no row is looked at
    ],
)
def test_swingup_time_by_hand(up, swingup_time):
    found = judge_heights(up)
    assert found.success == (swingup_time is not None)
    assert found.swingup_time == (None if swingup_time is None else pytest.approx(swingup_time))
    # At rest without torque only the time costs: 1 - tanh(π t / 20) / 5.
    expected = 0.0 if swingup_time is None else 1 - math.tanh(math.pi * swingup_time / 20) / 5
    assert found.score == pytest.approx(expected)


def test_up_means_strictly_above_the_line():
    # Upright the tip is at l1 + l2 = 2 exactly: not above a line at 2, above one just below.
    time, x = np.arange(4.0), np.array([[np.pi, 0, 0, 0]] * 4)
    u = np.zeros((4, 2))
    assert not compute_criteria(time, x, u, 1.0, 1.0, rules(3.0, height=1.0)).success
    assert compute_criteria(time, x, u, 1.0, 1.0, rules(3.0, height=math.nextafter(1, 0))).success


@pytest.mark.parametrize(("last", "success"), [(9.998, True), (9.9, True), (9.899, False), (12.0, True)])
def test_run_shorter_than_99_percent_fails(last, success):
    up = [0, 1, 1, 1]
    found = judge_heights(up, duration=10.0, dt=last / 3)
    assert found.success == success
    assert found.swingup_time == (pytest.approx(last / 3) if success else None)
    assert (found.score > 0) == success


PUBLISHED = {
    f"{row['robot']} {row['controller']}": row
    for row in csv.DictReader((resources.files(benchmark) / "published_performance.csv").read_text().splitlines())
}
"""Criteria and scores as printed."""


@pytest.mark.parametrize("row", PUBLISHED)
def test_published_criteria_give_the_published_scores(row):
    *printed, score = (PUBLISHED[row][name] for name in (*NAMES, "score"))
    costs = [float(text) for text in printed]
    # Whatever was rounded: the score falls with each criterion, so that their bounds bound it.
    half_units = [0.5 * 10.0 ** -len(text.partition(".")[2]) for text in printed]
    worst, best = (
        realai_score(
            {name: c + sign * h for name, c, h in zip(NAMES, costs, half_units, strict=True)}, V2.normalisers
        )
        for sign in (1, -1)
    )
    assert worst - 0.0005 <= float(score) <= best + 0.0005


def test_with_pushes_the_acrobots_normalisers_differ(robot):
    calm, pushed = (BOARDS[name].on(Setting(robot, LEADERBOARD)) for name in ("hardware", "hardware-perturbed"))
    acrobots = Normalisers(20.0, 60.0, 20.0, 1.0, 400.0)
    assert pushed.normalisers == (acrobots if robot.name == "acrobot" else calm.normalisers)


def ours(board):
    return {row.controller: row for row in board.rows if row.source == "ours"}


def test_policies_that_ship_with_an_estimator_enter_without_it_too(either_robot):
    entered = entrants_for(either_robot, {}, (ADAPTIVE, AR_EAPO), alone=True)
    assert {name: type(controller) for name, controller in entered.items()} == {
        "adaptive": EstimatingController,
        "ar-eapo": PolicyController,
        "adaptive --no-estimator": RegulatingController,
    }
    assert set(entrants_for(either_robot, {}, (ADAPTIVE,))) == {"adaptive"}
    again = refusal(leaderboard, either_robot, {"adaptive --no-estimator": HANGING}, entrants=(ADAPTIVE,))
    assert "'adaptive --no-estimator' is on the board already" in again


def test_on_a_plant_that_was_given_adaptive_begins_with_it_as_evaluate_does(either_robot):
    heavier, as_shipped = LEADERBOARD.changed(m2=0.55), get_controller(ADAPTIVE, either_robot)
    entered = entrants_for(either_robot, {}, (ADAPTIVE,), heavier, given=True)[ADAPTIVE]
    assert eqx.tree_equal(entered, get_controller(ADAPTIVE, either_robot, plant=heavier))
    assert not eqx.tree_equal(entered, as_shipped)
    untold = LEADERBOARD.changed(l1=0.3, r1=0.3)
    for plant, given in ((heavier, False), (untold, True)):
        entered = entrants_for(either_robot, {}, (ADAPTIVE,), plant, given)[ADAPTIVE]
        assert eqx.tree_equal(entered, as_shipped)


def test_names_on_the_board_are_taken(brief_minute):
    """Ours, and `global` on the uptime board alone."""
    for name in (*FURTHER_ENTRANTS, "ilqr-mpc"):
        assert f"'{name}' is on the board already" in refusal(leaderboard, "acrobot", {name: HANGING})
    taken = refusal(leaderboard, "acrobot", {"global": HANGING}, (brief_minute,))
    assert "'global' is on the board already" in taken
    # The report animates the paper's alone.
    assert set(entrants_for("acrobot", {})) == set(ENTRANTS)


def test_a_board_that_was_changed_has_no_published_rows(brief_minute):
    (table,) = leaderboard("acrobot", boards=(brief_minute,), entrants=())
    assert table.rows == ()
    assert published_rows(get_robot("acrobot"), brief_minute.name)


def test_published_robustness_is_the_mean_of_its_criteria(robot):
    for row in published_rows(robot, "robustness"):
        assert fmean(row.values[name] for name in CRITERIA) / 100 == pytest.approx(row.values["score"], abs=1e-3)


@pytest.mark.slow  # the command has a default test
def test_the_papers_boards_are_sorted_and_mark_what_is_ours(robot):
    performance, robustness = boards = leaderboard(robot, {"hanging": HANGING})
    assert [(each.board, each.seed) for each in boards] == [("performance", None), ("robustness", 0)]
    for board in boards:
        scores = [row.values[board.columns[-1]] for row in board.rows]
        assert scores == sorted(scores, reverse=True)
        assert set(ours(board)) == {*ENTRANTS, *FURTHER_ENTRANTS, "adaptive --no-estimator", "hanging"}
        assert len(board.rows) == len(ours(board)) + len(published_rows(robot, board.board))
    found = ours(performance)
    hanging = found.pop("hanging")
    assert (hanging.remark, hanging.values["swingup_time"]) == ("no swing-up", None)
    assert all(row.values["score"] > 0.33 for row in found.values())
    assert ours(robustness)["hanging"].values["score"] == 0.0
    rows = json.loads(json.dumps(robustness.as_dicts()))
    assert {row["source"] for row in rows} == {"ours", "paper", "board"}
    head = {"robot", "board", "seed", "plant", "torque_over_gravity", "controller", "source", "remark", "score"}
    assert set(rows[0]) == {*head, *CRITERIA}
