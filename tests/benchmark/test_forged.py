"""Scores of forged recordings: none without an error; and recordings of a robot keep theirs."""

from pathlib import Path

import numpy as np
import pytest

from refusals import refusal
from swingup.benchmark.boards import BOARDS
from swingup.benchmark.judge import judge
from swingup.benchmark.score import score
from swingup.benchmark.trajectory_file import load_trajectory
from swingup.common.errors import SwingupError
from swingup.controllers.registry import get_controller

from .forged import changed, invented, scaled

WORTH = 0.3
"""A forged score above this has to be refused."""


def kept_scores(forged, robot, board):
    """What forged recordings score without an error, by name, with the names of their warnings."""
    found = {}
    for name, rows in forged.items():
        try:
            result = score(rows, robot, board)
        except SwingupError:
            continue
        found[name] = (result.score, {each.partition(":")[0] for each in result.warnings})
    return found


def test_some_inventions_get_no_score():
    forged = invented(np.random.default_rng(0), joint=1)
    some = {name: rows for name, rows in list(forged.items())[::5] if len(rows.time) == 5000}
    assert len(some) >= 10
    assert all(kept == 0 for kept, _ in kept_scores(some, "acrobot", "performance").values())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("board", ["performance", "hardware"])
def test_forged_recordings_get_no_score(robot, board, seed):
    random = np.random.default_rng(seed)
    honest = judge(get_controller("tvlqr-score", robot), robot).trajectory
    gross, fine = changed(honest, random)
    forged = gross | invented(random, robot.joint)
    assert len(forged) >= 60
    worth = {name for name, rows in forged.items() if score(rows, robot, board, force=True).score > WORTH}
    assert len(worth) >= 50
    assert {name for name, (kept, _) in kept_scores(forged, robot, board).items() if kept > WORTH} == set()
    # Small gains are warned of, where there are any.
    for name, (kept, warnings) in kept_scores(fine, robot, board).items():
        assert warnings or kept < score(honest, robot, board).score + 0.001, name


def test_a_robots_recording_keeps_its_score_and_its_forgery_gets_none():
    """At 33 Hz, where energy agrees only because each torque acts from the next row on."""
    rows = load_trajectory(Path(__file__).parents[2] / "examples/logs/C1-acrobot-mcpilco.csv")
    for board, kept, warnings in (("hardware", 0.482, {"rate"}), ("performance", 0.262, {"rate", "measured"})):
        found = score(rows, "acrobot", board)
        assert found.score == pytest.approx(kept, abs=5e-4)
        assert {each.partition(":")[0] for each in found.warnings} == warnings
        for forged in (scaled(rows, torque=0.2), scaled(rows, velocity=0.97)):
            assert "scores it all the same" in refusal(score, forged, "acrobot", board)


@pytest.mark.slow
@pytest.mark.parametrize("board", ["sim2real", "iros-real", "v2-real", "icra-real", "uptime", "hardware"])
def test_own_recordings_keep_their_scores(robot, board):
    chosen = BOARDS[board]
    for seed in range(2):
        found = judge(get_controller("tvlqr", robot), robot, chosen, None if board == "hardware" else 1, seed=seed)
        again = score(found.trajectory, robot, board)
        if found.runs[0].score > 0:
            assert again.score == pytest.approx(found.runs[0].score)
