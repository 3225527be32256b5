"""The commands that judge, with short boards: results, forms of output, options that pass through, and names."""

import csv
import io

import pytest
import yaml

from policies import lone_policy
from swingup import SwingupError, load_plant
from swingup.benchmark.leaderboard import Row, Table
from swingup.cli import judging, main
from swingup.cli.results import TABLE_FORMATS, show_tables
from swingup.controllers.stack.policy import save_controller

KEYS = [
    "command", "robot", "controller", "estimator", "board", "plant", "torque_over_gravity", "seeds", "version",
    "runs", "successes", "success_interval", "swingup_time", "energy", "torque_cost", "torque_smoothness",
    "velocity_cost", "score", "intervals", "call_time", "warnings", "details",
]  # fmt: skip
CONTROLLERS = """
import time

def both(x, t):
    return [2.0, 0.5]


def plain(x, t):
    return [0.0, -0.1 * x[3]]

def slow(x, t):
    time.sleep(0.003)
    return [0.0, 0.0]

def nan(x, t):
    return [0.0, float("nan")]
"""
PLAIN, NAN = "evaluate acrobot --controller mine:plain", "mine:nan"


@pytest.fixture(autouse=True)
def mine(tmp_path, change_boards):
    """A module of controllers, and boards with runs of half a second, for what does not depend on their end."""
    (tmp_path / "mine.py").write_text(CONTROLLERS)
    change_boards("performance robustness hardware", duration=0.5)


@pytest.mark.parametrize("robot", ["acrobot", pytest.param("pendubot", marks=pytest.mark.slow)])
def test_evaluate_then_score_the_same_trajectory(robot, run_json, change_boards):
    change_boards("performance hardware", duration=10.0)
    result = run_json(f"evaluate {robot} --controller ar-eapo --save t.csv")
    assert list(result) == KEYS
    # The paper's scores.
    assert result["successes"] == 1
    assert result["score"] >= {"acrobot": 0.633, "pendubot": 0.659}[robot]
    again = run_json(f"score t.csv --robot {robot}")
    assert set(again) == {*KEYS, "rate"} - {"command", "estimator"}
    assert (round(again["rate"]), again["warnings"], again["call_time"]) == (500, [], None)
    same = [*KEYS[KEYS.index("runs") : KEYS.index("call_time")], "details"]
    assert {name: again[name] for name in same} == {name: result[name] for name in same}
    # Torque and smoothness count for less there.
    assert run_json(f"score t.csv --robot {robot} --board hardware")["score"] > result["score"]


def test_the_command_of_a_result_repeats_it(run_json):
    words = f"{PLAIN} --board robustness --plant A.0 --criteria delay,torque_noise --seed 3"
    result = run_json(words, "--grid", "delay=0:0:2", "torque_noise=0:0.1:2:1")
    assert (result["plant"], result["seeds"], result["runs"]) == ("A.0", [3], 4)
    again = run_json(result["command"].removeprefix("swingup "))
    assert {**again, "call_time": 0} == {**result, "call_time": 0}


def test_the_commands_of_several_boards_repeat_them(run_json, change_boards):
    change_boards("robustness", duration=0.1)
    change_boards("uptime", duration=1.0, throws=1, first_throw=0.5, jitter=0.1)
    for each in run_json(f"{PLAIN} --board performance uptime --seeds 2"):
        assert ("--seeds=2" in each["command"]) == (each["board"] == "uptime")
        assert run_json(each["command"].removeprefix("swingup "))["score"] == each["score"]
    words = f"{PLAIN} --board performance robustness --criteria delay --grid delay=0:0:2"
    for each in run_json(words):
        assert ("--criteria" in each["command"]) == (each["board"] != "performance")
        again = run_json(each["command"].removeprefix("swingup "))
        assert again["score"] == each["score"]


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("--seeds 5", "--seeds 5: nothing on performance is random: leave it out"),
        ("--board robustness --criteria delay --grid torque_noise=0:1:5", "torque_noise, which is not measured"),
    ],
)
def test_options_that_would_change_nothing_are_refused(words, named, capsys):
    assert main(f"{PLAIN} {words}".split()) == 2
    assert named in capsys.readouterr().err


def test_check_names_faults_and_slowness(run):
    assert "not finite at t = 0 s" in run(f"evaluate acrobot --check --controller {NAN}", status=1)
    assert "mine:plain: nothing wrong was found" in run(PLAIN, "--check")
    assert "one call takes" in run("evaluate acrobot --check --controller mine:slow")


@pytest.mark.parametrize(
    "flag", ["--no-estimator", *(pytest.param(each, marks=pytest.mark.slow) for each in ("", "--estimator"))]
)
def test_with_and_without_an_estimator(run, run_json, tmp_path, flag):
    """A file of the pendubot's policy that asks for an estimator."""
    judged = flag != "--no-estimator"
    policy, metadata = lone_policy("ar-eapo", "pendubot")
    save_controller(tmp_path / "meant.safetensors", policy, {"scores": metadata["scores"], "estimator": {}})
    words = f"evaluate pendubot --controller meant.safetensors {flag}"
    result = run_json(words)
    assert result["estimator"] is judged
    assert result["command"].endswith(flag)
    named = f"meant.safetensors, {'with estimator' if judged else 'policy alone'}"
    assert f"{named}: nothing wrong was found" in run(words, "--check")


def test_disturbances_pass_through_and_repeat(run_json, change_boards):
    change_boards("performance", duration=2.0)
    words = "evaluate acrobot --controller lqr --velocity-noise 0.1 --torque-noise 0.2 --delay 0.004 --seed"
    first, again, other = (run_json(words, seed) for seed in ("1", "1", "2"))
    assert first["details"] == again["details"]
    assert first["torque_smoothness"] != other["torque_smoothness"]
    assert "--velocity-noise=0.1 --torque-noise=0.2 --delay=0.004" in first["command"]


def test_a_plant_is_named_with_the_ratio_of_its_torques(run, run_json, tmp_path):
    out = run(PLAIN, "--plant", "B.0", "--frictionless")
    assert out.startswith("acrobot, mine:plain (board performance, plant B.0, frictionless, torque/gravity 0.96)\n")
    (tmp_path / "mine.yml").write_text(yaml.safe_dump(load_plant("B.0").values()))
    result = run_json(PLAIN, "--plant", "mine.yml")
    # 6 N m over (0.6870144 0.3 + 0.6018698 (0.3 + 0.4150912)) 9.81 N m = 6.2440 N m.
    assert (result["plant"], round(result["torque_over_gravity"], 4)) == ("mine.yml", 0.9609)


def test_baselines_of_sim2real_are_designed_for_the_domains_plant(capsys, monkeypatch):
    def found(name, robot, plant, estimator, given):
        raise SwingupError(f"designed for {plant}")

    monkeypatch.setattr(judging, "controller_on", found)
    for domain, plant in (("identified", "leaderboard"), ("B.0", "B.0")):
        assert main(f"evaluate acrobot --board sim2real --controller lqr --domain {domain}".split()) == 2
        assert f"designed for {plant}\n" in capsys.readouterr().err


HOSTILE = "a\nb\x1b[31m|<b>`*=1\udcff"
"""A name with a line end, an escape sequence, markup, and a byte that is no UTF-8."""


def test_hostile_names_are_text_in_every_form(capsys):
    tables = [Table("acrobot", "uptime", ("score",), 0, (Row(HOSTILE, "ours", {"score": 0.5}, remark=HOSTILE),))]
    lines = TABLE_FORMATS["markdown"](tables).splitlines()
    shown = "a b\\\\x1b\\[31m\\|&lt;b&gt;\\`\\*=1\\\\udcff"
    assert f"| **{shown}** | **ours** | **0.500** |" in lines
    assert lines[-1] == f"{shown}: {shown}"
    (row,) = csv.DictReader(io.StringIO(TABLE_FORMATS["csv"](tables)))
    assert row["controller"] == row["remark"] == "a\nb\\x1b[31m|<b>`*=1\\udcff"
    show_tables(tables)
    text = capsys.readouterr().out
    assert "\x1b" not in text
    assert "a\\nb\\x1b[31m|<b>`*=1\\udcff: a\\nb" in text


@pytest.mark.slow
def test_the_real_robots_boards(run, run_json, tmp_path, change_boards, entrants):
    words = "evaluate pendubot --board sim2real --controller lqr --seeds 2"
    out = run(words, "--save", "run.csv")
    assert "pendubot, lqr (board sim2real, domain recorded, seed 0 to 1)" in out
    last = (tmp_path / "run.csv").read_text().splitlines()[-1]
    assert float(last.partition(",")[0]) == pytest.approx(10.0, abs=0.01)  # the loop's periods vary
    result = run_json(words)
    assert (result["successes"], result["estimator"], result["domain"]["delay"]) == (0, False, [0.002, 0.002])
    change_boards("icra-real", duration=1.0, throws=1, first_throw=0.5, jitter=0.1, runs=2)
    assert "Stopped by the robot" in run("evaluate acrobot --controller lqr --board icra-real --seeds 1")
    entrants("lqr")
    sources = {tuple(line.split()[:2]) for line in run("leaderboard pendubot --board icra-real").splitlines()}
    assert {("lqr", "ours"), ("AR-EAPO", "robot"), ("VIMPPI", "robot")} <= sources


def test_a_row_says_that_it_drives_the_passive_joint(run_json, entrants, change_boards):
    entrants()
    change_boards("uptime", duration=1.0, throws=1, first_throw=0.5, jitter=0.1)
    rows = run_json("leaderboard acrobot --board uptime --controller mine:both")
    [row] = [each for each in rows if each["controller"] == "mine:both"]
    assert row["remark"].startswith("passive_torque: ")


def test_what_is_designed_for_one_plant_enters_no_board_that_draws_plants(capsys):
    assert main(["leaderboard", "acrobot", "--board", "cloudpendulum", "--controller", "lqr"]) == 2
    assert "lqr is designed for a plant, and cloudpendulum draws plants" in capsys.readouterr().err


def test_leaderboard_formats(run, run_json, entrants):
    entrants("lqr")
    brief = "leaderboard acrobot --board hardware --controller mine:plain,mine:nan"
    rows = run_json(brief)
    names = [row["controller"] for row in rows]
    assert set(names) == {"lqr", "mine:plain", NAN}
    assert "not finite" in next(row["remark"] for row in rows if row["controller"] == NAN)
    assert [row["controller"] for row in csv.DictReader(io.StringIO(run(brief, "--csv")))] == names
    markdown = run(brief, "--markdown")
    assert "### Board hardware, acrobot" in markdown
    assert "| **lqr** | **ours** |" in markdown
    assert f"{NAN}: " in markdown
