"""The boards: order, sources, failing rows, and the published numbers' own arithmetic."""

import json
from statistics import fmean

import jax.numpy as jnp
import pytest

from swingup.benchmark import leaderboard as boards
from swingup.benchmark.columns import BOARDS
from swingup.benchmark.criteria import realai_score
from swingup.benchmark.leaderboard import (
    ENTRANTS,
    FURTHER,
    OURS,
    Row,
    entrants_for,
    leaderboard,
    published_rows,
    shipped_robustness,
)
from swingup.benchmark.robustness import Robustness
from swingup.benchmark.rules import CRITERIA, PERFORMANCE_RULES
from swingup.control.controller import AbstractController
from swingup.errors import SwingupError
from swingup.physics.parameters import get_robot
from swingup.policy import shipped
from swingup.policy.jax_backend.controller import PolicyController, save_controller, shipped_policy
from swingup.policy.jax_backend.estimator import EstimatingController
from swingup.policy.shipped import AR_EAPO


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
    """One policy, which ships without an estimator: the full boards are for the slow tests and the README."""
    monkeypatch.setattr(boards, "ENTRANTS", (AR_EAPO,))
    monkeypatch.setattr(boards, "FURTHER", ())


def ours(board):
    return {row.controller: row for row in board.rows if row.source == "ours"}


@pytest.mark.usefixtures("only_the_policy", "small_grid")
def test_boards_are_sorted_and_mark_what_is_ours(either_robot):
    performance, robustness = leaderboard(either_robot, {"hanging": Hanging()})
    assert (performance.measure, performance.seed) == ("performance", None)
    assert (robustness.measure, robustness.seed) == ("robustness", 0)
    for board in (performance, robustness):
        scores = [row.values[board.columns[-1]] for row in board.rows]
        assert scores == sorted(scores, reverse=True)
        assert set(ours(board)) == {AR_EAPO, "hanging"}
        assert {row.source for row in board.rows} == {"ours", "paper", "board"}
        assert len(board.rows) == 2 + len(published_rows(either_robot, board.measure, "v2"))
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
    assert rows[AR_EAPO].values["score"] > 0.6
    assert "not finite at t = 0 s" in rows["nan"].remark
    assert "RuntimeError (no idea)" in rows["raising"].remark
    assert rows["raising"].values["score"] == 0.0


@pytest.mark.usefixtures("only_the_policy", "brief_minute")
def test_the_third_rules_have_a_board_of_their_own(either_robot):
    (board,) = leaderboard(either_robot, {"raising": raising}, rules="v3", seed=4)
    assert (board.measure, board.rules, board.seed, board.columns) == ("uptime", "v3", 4, ("uptime",))
    assert len(board.rows) == 8
    assert 0 < ours(board)[AR_EAPO].values["uptime"] < 1
    assert "no idea" in ours(board)["raising"].remark


@pytest.fixture
def other_files(tmp_path, monkeypatch, either_robot):
    """One policy in two shipped files: one that asks for an estimator, and a global one that does not."""
    policy, metadata = shipped_policy(either_robot, "ar-eapo")
    save_controller(tmp_path / ".npz", policy, {"scores": metadata["scores"], "estimator": {}})
    save_controller(tmp_path / "global.npz", policy, {"scores": metadata["scores"]})
    monkeypatch.setattr(shipped, "_file", lambda robot, kind: tmp_path / f"{kind}.npz")
    monkeypatch.setattr(boards, "ENTRANTS", ("refined",))
    monkeypatch.setattr(boards, "FURTHER", ())


@pytest.mark.usefixtures("other_files")
def test_policies_that_ship_with_an_estimator_enter_without_it_too(either_robot, monkeypatch):
    asked = {}

    def measured(controller, robot, name, rules, seed):
        asked[name] = type(controller)
        return Robustness(robot.name, name, rules, (seed,), dict.fromkeys(CRITERIA, 50.0), 0.5, {}, ())

    monkeypatch.setattr(boards, "robustness", measured)
    for board in leaderboard(either_robot):
        assert set(ours(board)) == {"refined", "refined --no-estimator"}
    assert asked == {"refined": EstimatingController, "refined --no-estimator": PolicyController}
    with pytest.raises(SwingupError, match="'refined --no-estimator' is on the board already"):
        leaderboard(either_robot, {"refined --no-estimator": Hanging()})
    assert set(entrants_for(either_robot, {})) == {"refined"}


def test_our_further_controllers_enter_every_board_beside_the_papers(robot, monkeypatch):
    expected = {*ENTRANTS, "refined --no-estimator", "ar-eapo", "tvlqr-score"}
    makers = boards._makers

    def unmeasured(*arguments):
        def make(controller, robot, name):
            return Row(name, OURS, dict.fromkeys(("score", "overall", "uptime"), 0.5))

        return dict.fromkeys(makers(*arguments), make)

    monkeypatch.setattr(boards, "_makers", unmeasured)
    monkeypatch.setattr(boards, "get_controller", lambda name, robot, estimator=None: name)
    monkeypatch.setattr(boards, "has_estimator", lambda controller: controller == "refined")
    filled = [board for rules in ("v2", "hardware", "v3") for board in leaderboard(robot, rules=rules)]
    assert [board.measure for board in filled] == ["performance", "robustness", "performance", "uptime"]
    assert all(set(ours(board)) == expected for board in filled[:3])
    assert set(ours(filled[3])) == expected | {"global"}
    for name in FURTHER:
        with pytest.raises(SwingupError, match=f"'{name}' is on the board already"):
            leaderboard(robot, {name: Hanging()})
    # The report animates the paper's alone.
    assert set(entrants_for(robot, {})) == set(ENTRANTS)


@pytest.mark.usefixtures("only_the_policy")
def test_our_own_trajectory_scores_more_than_the_policy(robot, monkeypatch):
    monkeypatch.setattr(boards, "FURTHER", ("tvlqr-score",))
    rows = ours(leaderboard(robot, rules="hardware")[0])
    assert rows["tvlqr-score"].values["score"] > rows[AR_EAPO].values["score"]


@pytest.mark.usefixtures("other_files", "brief_minute")
def test_the_global_policy_enters_the_uptime_board(either_robot, monkeypatch):
    (board,) = leaderboard(either_robot, rules="v3")
    assert set(ours(board)) == {"refined", "refined --no-estimator", "global"}
    shares = {name: row.values["uptime"] for name, row in ours(board).items()}
    # Without an estimator both are the same policy here.
    assert shares["refined --no-estimator"] == shares["global"] > 0
    with pytest.raises(SwingupError, match="'global' is on the board already"):
        leaderboard(either_robot, {"global": Hanging()}, rules="v3")


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
    entered = {*ENTRANTS, *FURTHER, "refined --no-estimator"}
    assert set(ours(performance)) == set(ours(robustness)) == entered
    assert all(row.values["score"] > 0.33 for row in ours(performance).values())
