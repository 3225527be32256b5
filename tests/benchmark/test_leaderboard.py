"""The boards: order, sources, failing rows, and the published numbers' own arithmetic."""

import json
from statistics import fmean

import pytest

from refusals import refusal
from swingup.benchmark.leaderboard import ENTRANTS, FURTHER_ENTRANTS, entrants_for, leaderboard, published_rows
from swingup.benchmark.robustness_board import CRITERIA
from swingup.controllers.stack.estimator import EstimatingController
from swingup.controllers.stack.policy import PolicyController
from swingup.controllers.stack.regulator import RegulatingController
from swingup.policy.shipped import ADAPTIVE, AR_EAPO

from .controllers import HANGING


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


def test_names_on_the_board_are_taken(brief_minute):
    """Ours, and `global` on the uptime board alone."""
    for name in (*FURTHER_ENTRANTS, "ilqr-mpc"):
        assert f"'{name}' is on the board already" in refusal(leaderboard, "acrobot", {name: HANGING})
    taken = refusal(leaderboard, "acrobot", {"global": HANGING}, (brief_minute,))
    assert "'global' is on the board already" in taken
    # The report animates the paper's alone.
    assert set(entrants_for("acrobot", {})) == set(ENTRANTS)


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
