"""The boards of real robots on the command line, with rules cut down to a second."""

import dataclasses
import json

import pytest

from swingup.benchmark.boards import BOARDS as FULL
from swingup.benchmark.leaderboard import default_entrants, published_rows
from swingup.cli.commands import run_command
from swingup.cli.judging import JudgingCommands
from swingup.common.errors import SwingupError
from swingup.loop.domain import load_domain
from swingup.plant.robots import get_robot


def brief():
    """One second of each, with two trials at most."""
    icra, iros, cloud = (FULL[name] for name in ("icra-real", "iros-real", "cloudpendulum"))
    short = {"duration": 1.0, "throws": 1, "first": 0.5, "jitter": 0.1, "runs": 2}
    pushes = {name: dataclasses.replace(each, apart=0.1) for name, each in iros.pushes.items()}
    return {
        "icra-real": dataclasses.replace(icra, **short),
        "iros-real": dataclasses.replace(iros, duration=1.0, runs=2, pushes=pushes),
        "cloudpendulum": dataclasses.replace(cloud, duration=0.5),
    }


BOARDS = JudgingCommands(FULL | brief(), ("lqr",))


def run(words):
    return run_command(words.split(), BOARDS)


@pytest.mark.slow
def test_uptime_by_the_robots_rules(capsys):
    assert run("evaluate acrobot --controller lqr --board icra-real --json") == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["board"], len(result["details"])) == ("icra-real", 2)
    assert (
        result["domain"] == {"name": "recorded"} | load_domain("recorded").as_dict()
    )  # unless another domain is given
    assert result["best"] >= result["score"]
    assert run("evaluate acrobot --controller lqr --board icra-real --domain identified --seeds 1") == 0
    out = capsys.readouterr().out
    assert "acrobot, lqr (board icra-real, domain identified, seed 0)" in out
    assert "Stopped by the robot" in out


@pytest.mark.slow
def test_trials_by_the_robots_rules(capsys, tmp_path):
    file = tmp_path / "first.csv"
    assert run(f"evaluate pendubot --controller lqr --board iros-real --save {file}") == 0
    out = capsys.readouterr().out
    assert "pendubot, lqr (board iros-real, domain recorded, seed 0 to 1)" in out
    assert "Best score" in out
    # The saved record is scored by the same rules; a second of ten scores nothing.
    assert run(f"score {file} --robot pendubot --board iros-real --json") == 0
    assert json.loads(capsys.readouterr().out)["score"] == 0.0


@pytest.mark.slow
def test_cells_say_whose_board_they_are(capsys):
    assert run("evaluate pendubot --controller lqr --board cloudpendulum --json") == 0
    result = json.loads(capsys.readouterr().out)
    assert len(result["details"]) == 4
    assert result["domain"]["plant"] == "cloudpendulum-rods"
    assert result["note"].startswith("Ours")


@pytest.mark.slow
def test_published_results_on_robots_stand_beside_ours_and_say_so(capsys):
    assert run("leaderboard pendubot --board icra-real") == 0
    out = capsys.readouterr().out
    assert "Board icra-real, pendubot" in out
    sources = {tuple(line.split()[:2]) for line in out.splitlines()}
    assert {("lqr", "ours"), ("AR-EAPO", "robot"), ("VIMPPI", "robot")} <= sources
    assert "Rows of source 'robot' were measured on the real robot; ours are simulated." in out


@pytest.mark.slow
@pytest.mark.parametrize("board", ["icra-real", "iros-real"])
def test_rows_of_the_robots_boards(board, capsys):
    assert run(f"leaderboard pendubot --board {board} --json") == 0
    rows = json.loads(capsys.readouterr().out)
    assert {row["board"] for row in rows} == {board}
    sources = {row["controller"]: row["source"] for row in rows}
    assert (sources["lqr"], sources["AR-EAPO"]) == ("ours", "robot")


def test_published_figures():
    """Best and mean of the public boards: three runs in 2025, ten in 2024."""
    acrobot, pendubot = get_robot("acrobot"), get_robot("pendubot")

    def figures(robot, board):
        return {row.controller: tuple(row.values.values())[-2:] for row in published_rows(robot, board)}

    assert figures(acrobot, "icra-real")["Acados MPC"] == (0.775, 0.755)
    assert figures(pendubot, "icra-real")["Acados MPC"] == (0.721, 0.716)
    assert figures(acrobot, "iros-real")["AR-EAPO"] == (0.594, 0.343)
    assert figures(pendubot, "iros-real")["AR-EAPO"] == (0.711, 0.646)
    assert figures(acrobot, "v2-real")["TVLQR"] == (0.592, 0.587)
    assert figures(pendubot, "v2-real")["MC-PILCO"] == (0.598, 0.591)
    # Simulated boards have no rows from robots, and robots' boards no simulated ones.
    for board in ("performance", "uptime", "icra-real"):
        on_robot = {row.source == "robot" for row in published_rows(acrobot, board)}
        assert on_robot == {board == "icra-real"}


def test_who_enters_the_robots_boards():
    assert "adaptive" in default_entrants(FULL["iros-real"])
    # Throws: the policy that recovers enters as well.
    assert set(default_entrants(FULL["icra-real"])) - set(default_entrants(FULL["iros-real"])) == {"global"}
    # The shipped policies were made for another pendulum than CloudPendulum's.
    assert default_entrants(FULL["cloudpendulum"]) == ("tvlqr", "ilqr-riccati", "ilqr-mpc")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            "evaluate acrobot --board uptime --controller lqr --domain identified",
            "the board uptime draws no plants",
        ),
        ("evaluate acrobot --controller lqr --board icra-real --plant A.0", "give the plant as the domain"),
        (
            "leaderboard acrobot --board iros-real --plant A.0",
            "draws plants from a domain: leave the plant A.0 out",
        ),
        ("evaluate acrobot --board uptime --delay 0.1", "has disturbances of its own"),
    ],
)
def test_options_that_exclude_each_other(words, message):
    with pytest.raises(SwingupError, match=message):
        run(words)
