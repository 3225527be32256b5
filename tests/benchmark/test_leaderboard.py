"""The boards: order, sources, failing rows, and the published numbers' own arithmetic."""

import json
from statistics import fmean

import jax.numpy as jnp
import pytest

from swingup.benchmark import leaderboard as boards
from swingup.benchmark.columns import BOARDS
from swingup.benchmark.criteria import realai_score
from swingup.benchmark.leaderboard import ENTRANTS, leaderboard, published_rows, shipped_robustness
from swingup.benchmark.rules import CRITERIA, PERFORMANCE_RULES
from swingup.control.controller import AbstractController
from swingup.errors import SwingupError
from swingup.physics.parameters import get_robot


class Hanging(AbstractController):
    def init(self):
        return None

    def __call__(self, carry, t, x):
        return None, jnp.zeros(2)


class Failing(Hanging):
    def __call__(self, carry, t, x):
        return None, jnp.nan * jnp.zeros(2)


def raising(x, t):
    raise RuntimeError("no idea")


@pytest.fixture
def only_the_policy(monkeypatch):
    """The paper's baselines stay out: their boards are for the slow tests and the README's first command."""
    monkeypatch.setattr(boards, "ENTRANTS", ("ar-eapo",))


def ours(board):
    return {row.controller: row for row in board.rows if row.source == "ours"}


@pytest.mark.usefixtures("only_the_policy")
def test_boards_are_sorted_and_mark_what_is_ours(robot):
    performance, robustness = leaderboard(robot, {"hanging": Hanging()})
    assert (performance.measure, performance.seed) == ("performance", None)
    assert (robustness.measure, robustness.seed) == ("robustness", 0)
    for board in (performance, robustness):
        scores = [row.values[board.columns[-1]] for row in board.rows]
        assert scores == sorted(scores, reverse=True)
        assert set(ours(board)) == {"ar-eapo", "hanging"}
        assert {row.source for row in board.rows} == {"ours", "paper", "board"}
        assert len(board.rows) == 2 + len(published_rows(robot, board.measure, "v2"))
    assert ours(performance)["hanging"].remark == "no swing-up"
    assert ours(performance)["hanging"].values["swingup_time"] is None
    assert ours(robustness)["hanging"].values["overall"] == 0.0
    rows = json.loads(json.dumps(robustness.as_dicts()))
    assert {"robot", "measure", "rules", "seed", "controller", "source", "remark", *BOARDS["robustness"]} == set(
        rows[0]
    )


@pytest.mark.usefixtures("only_the_policy")
def test_a_controller_that_fails_gets_a_row_that_says_so():
    boards = leaderboard("acrobot", {"nan": Failing(), "raising": raising}, rules="hardware")
    rows = ours(boards[0])
    assert [board.measure for board in boards] == ["performance"]
    assert rows["ar-eapo"].values["score"] > 0.6
    assert "not finite at t = 0 s" in rows["nan"].remark
    assert "RuntimeError (no idea)" in rows["raising"].remark
    assert rows["raising"].values["score"] == 0.0


@pytest.mark.usefixtures("only_the_policy")
def test_the_third_rules_have_a_board_of_their_own(robot):
    (board,) = leaderboard(robot, {"raising": raising}, rules="v3", seed=4)
    assert (board.measure, board.rules, board.seed, board.columns) == ("uptime", "v3", 4, ("uptime",))
    assert len(board.rows) == 6
    assert 0 < ours(board)["ar-eapo"].values["uptime"] < 1
    assert "no idea" in ours(board)["raising"].remark


def test_names_on_the_board_are_taken():
    with pytest.raises(SwingupError, match="'ilqr-mpc' is on the board already"):
        leaderboard("acrobot", {"ilqr-mpc": Hanging()})


def test_unknown_rules():
    with pytest.raises(SwingupError, match="unknown rules 'v9': use one of v2, hardware, v3"):
        leaderboard("acrobot", rules="v9")


def test_published_scores_follow_from_the_published_criteria(robot):
    # Criteria are printed with 2 or 3 digits: scores repeat to 0.01, and to 0.02 where smoothness has one digit.
    normalisers = PERFORMANCE_RULES["v2"].normalisers
    for row in published_rows(robot, "performance", "v2"):
        costs = {name: value for name, value in row.values.items() if name != "score"}
        assert realai_score(costs, normalisers) == pytest.approx(row.values["score"], abs=0.02), row.controller
    for row in published_rows(robot, "robustness", "v2"):
        assert fmean(row.values[name] for name in CRITERIA) / 100 == pytest.approx(row.values["overall"], abs=1e-3)


def test_published_rows_belong_to_their_rules():
    acrobot = get_robot("acrobot")
    assert published_rows(acrobot, "performance", "hardware") == []
    assert len(published_rows(acrobot, "uptime", "v3")) == 4


def test_the_shipped_row_says_how_it_was_made(robot):
    row = shipped_robustness(robot, "ilqr-mpc")
    assert fmean(row.values[name] for name in CRITERIA) / 100 == pytest.approx(row.values["overall"])
    assert "seed 0" in row.remark
    assert f"swingup robustness {robot.name} --controller=ilqr-mpc" in row.remark


@pytest.mark.slow
def test_the_papers_boards(robot):
    performance, robustness = leaderboard(robot)
    assert set(ours(performance)) == set(ours(robustness)) == set(ENTRANTS)
    assert all(row.values["score"] > 0.33 for row in ours(performance).values())
