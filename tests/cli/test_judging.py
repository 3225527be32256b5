"""The commands around the boards, as a user types them."""

import csv
import dataclasses
import io
import json
import re
import shlex
import textwrap

import pytest
import yaml

from policies import lone_policy
from swingup.benchmark.boards import BOARDS, PERFORMANCE, ROBUSTNESS
from swingup.benchmark.rules import CRITERIA
from swingup.cli import judging, main
from swingup.cli.judging import JudgingCommands
from swingup.common.errors import SwingupError
from swingup.controllers.registry import BUILT_IN
from swingup.controllers.stack.controller import save_controller
from swingup.plant.plant import load_plant

CONTROLLERS = textwrap.dedent(
    """
    import time

    import jax.numpy as jnp
    import numpy as np
    import swingup

    class Damping(swingup.AbstractController):
        def init(self):
            return None

        def __call__(self, carry, t, x):
            return None, -0.1 * x[2:] * jnp.array([0.0, 1.0])

    jax_damping = Damping()

    class Plain:
        def get_control_output(self, x, t):
            return [0.0, -0.1 * x[3]]

    plain = Plain()

    def slow(x, t):
        time.sleep(0.003)
        return [0.0, 0.0]

    def nan(x, t):
        return [0.0, np.nan]

    number = 3
    """
)


@pytest.fixture(autouse=True)
def surroundings(tmp_path, monkeypatch):
    """A working folder with a module of controllers, and no cache outside of the test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "others_controllers.py").write_text(CONTROLLERS)


@pytest.fixture(scope="session")
def brief_runs():
    """Boards of IROS 2024 with runs of half a second, for what does not depend on their end."""
    brief = {name: dataclasses.replace(BOARDS[name], duration=0.5) for name in ("performance", "robustness")}
    return JudgingCommands(BOARDS | brief)


ROBUST = ("--board", "robustness")


def run(capsys, *arguments, status=0, boards=None):
    assert main(list(arguments), boards) == status
    return capsys.readouterr().out


@pytest.mark.slow
def test_robustness_as_json(capsys, small_grid):
    boards = JudgingCommands({"robustness": small_grid})
    options = ("--controller", "ar-eapo", "--seed", "3", "--criteria", "delay,perturbations")
    result = json.loads(run(capsys, "evaluate", "pendubot", *ROBUST, "--json", *options, boards=boards))
    names = ("robot", "controller", "board", "seeds", "runs", "score")
    # 3 delays, 8 profiles of pushes
    assert [result[name] for name in names] == ["pendubot", "ar-eapo", "robustness", [3], 11, None]
    assert result["details"][0] == {"criterion": "delay", "value": 0.0, "success": True, "score": 1.0}
    assert result["command"].startswith(
        "swingup evaluate pendubot --board=robustness --controller=ar-eapo --seed=3"
    )
    # The command that the result names prints the result again; it separates values by spaces.
    again = json.loads(run(capsys, *shlex.split(result["command"])[1:], "--json", boards=boards))
    assert {**again, "call_time": 0} == {**result, "call_time": 0}


@pytest.mark.slow
def test_robustness_as_text_with_intervals(capsys, brief_runs):
    out = run(
        capsys, "evaluate", "acrobot", *ROBUST, "--controller", "lqr", "--seeds", "2", "--grid",
        "velocity_noise=0:0.5:3:3", "delay=0:0.01:2", "--criteria", "velocity_noise", "delay",
        boards=brief_runs,
    )  # fmt: skip
    name = "robustness velocity_noise=0:0.5:3:3 delay=0:0.01:2"
    assert f"acrobot, lqr (board {name}, seed 0 to 1)" in out
    assert "0 of 20" in out  # 3 values, 3 repetitions, 2 seeds; 2 delays


def test_several_boards_share_one_form(capsys, brief_runs):
    words = (
        "evaluate",
        "acrobot",
        "--controller",
        "others_controllers:plain",
        "--board",
        "performance",
        "robustness",
    )
    brief = ("--criteria", "delay", "--grid", "delay=0:0:2")
    performance, robustness = json.loads(run(capsys, *words, *brief, "--json", boards=brief_runs))
    common = {
        "command",
        "robot",
        "controller",
        "estimator",
        "board",
        "seeds",
        "runs",
        "successes",
        "score",
        "details",
    }
    assert common <= set(performance) & set(robustness)
    assert performance["call_time"] > 0
    out = run(capsys, *words, *brief, boards=brief_runs)
    assert out.count("Success") == out.count("One call [ms]") == 2


def test_a_controller_slower_than_its_loop_does_not_pass_without_a_word(capsys, brief_runs):
    name = "others_controllers:slow"
    assert "one call takes" in run(capsys, "check", "acrobot", "--controller", name)
    brief = JudgingCommands({"performance": dataclasses.replace(PERFORMANCE, duration=0.05)})
    out = run(capsys, "evaluate", "acrobot", "--controller", name, boards=brief)
    assert "warning: one call takes" in out


@pytest.mark.parametrize("name", [pytest.param("jax_damping", marks=pytest.mark.slow), "plain"])
def test_others_controllers(capsys, name, brief_runs):
    name = f"others_controllers:{name}"
    result = json.loads(run(capsys, "evaluate", "acrobot", "--controller", name, "--json", boards=brief_runs))
    assert result["successes"] == 0
    assert result["details"][0]["failure"].startswith("never up: the tip reached -0.500 m")
    assert "nothing wrong" in run(capsys, "check", "acrobot", "--controller", name)
    result = run(
        capsys, "evaluate", "acrobot", *ROBUST, "--controller", name,
        "--criteria", "delay", "--grid", "delay=0:0:2", boards=brief_runs,
    )  # fmt: skip
    assert "Time delay [%]" in result
    assert "0.0" in result


@pytest.fixture
def meant(tmp_path):
    """A file of the pendubot's policy that asks for an estimator."""
    policy, metadata = lone_policy("ar-eapo", "pendubot")
    save_controller(tmp_path / "meant.safetensors", policy, {"scores": metadata["scores"], "estimator": {}})
    return "meant.safetensors"


@pytest.mark.parametrize(
    ("flags", "judged"),
    [
        pytest.param((), True, marks=pytest.mark.slow),
        pytest.param(("--estimator",), True, marks=pytest.mark.slow),
        (("--no-estimator",), False),
    ],
)
def test_with_and_without_an_estimator(capsys, meant, flags, judged, brief_runs):
    words = f"meant.safetensors, {'with estimator' if judged else 'policy alone'}"
    options = ("pendubot", "--controller", meant, *flags)
    assert json.loads(run(capsys, "evaluate", *options, "--json", boards=brief_runs))["estimator"] is judged
    assert f"pendubot, {words} (board performance)" in run(capsys, "evaluate", *options, boards=brief_runs)
    assert f"{words}: nothing wrong was found" in run(capsys, "check", *options)


@pytest.mark.slow
def test_robustness_with_an_estimator(capsys, meant):
    # Three seconds are enough for a swing-up.
    boards = JudgingCommands({"robustness": dataclasses.replace(ROBUSTNESS, duration=3.0)})
    base = ("pendubot", "--controller", "ar-eapo")
    brief = ("pendubot", "--criteria", "delay", "--grid", "delay=0.03:0.04:2", "--json")
    alone, estimating = (
        json.loads(run(capsys, "evaluate", *brief, *ROBUST, *base[1:], *flags, boards=boards))
        for flags in ((), ("--estimator",))
    )
    assert (alone["estimator"], estimating["estimator"]) == (False, True)
    assert alone["delay"] < estimating["delay"]
    assert "estimator" not in alone["command"]
    assert " --estimator " in estimating["command"]
    held = json.loads(
        run(capsys, "evaluate", *brief, *ROBUST, "--controller", meant, "--no-estimator", boards=boards)
    )
    assert held["estimator"] is False
    assert " --no-estimator " in held["command"]


@pytest.mark.slow
def test_uptime_with_an_estimator(capsys, brief_minute):
    boards = JudgingCommands({"uptime": dataclasses.replace(brief_minute, duration=8.0)})
    base = ("evaluate", "pendubot", "--board", "uptime", "--controller", "lqr", "--estimator")
    assert "lqr, with estimator (board uptime" in run(capsys, *base, boards=boards)
    assert json.loads(run(capsys, *base, "--json", boards=boards))["estimator"] is True


def test_check_names_the_fault(capsys):
    out = run(capsys, "check", "acrobot", "--controller", "others_controllers:nan", status=1)
    assert "gave a torque that is not finite at t = 0 s" in out


@pytest.mark.slow
def test_uptime(capsys, tmp_path, brief_minute):
    boards = JudgingCommands({"uptime": brief_minute})
    options = ("evaluate", "pendubot", "--board", "uptime", "--controller", "ar-eapo", "--seeds", "2")
    out = run(capsys, *options, "--save", "minute.csv", boards=boards)
    assert "Score" in out
    assert " to " in out
    assert len((tmp_path / "minute.csv").read_text().splitlines()) == 4_501  # rows, each of 2 ms, and a head
    result = json.loads(run(capsys, *options, "--json", boards=boards))
    assert 0 < result["score"] < 1
    assert result["seeds"] == [0, 1]


@pytest.mark.slow
def test_sim2real(capsys, tmp_path):
    out = run(
        capsys,
        "evaluate",
        "pendubot",
        "--board",
        "sim2real",
        "--controller",
        "lqr",
        "--seeds",
        "2",
        "--save",
        "run.csv",
    )
    assert "pendubot, lqr (board sim2real, domain identified, seed 0 to 1)" in out
    assert "Swing-up time [s]                    –   (median of the successes)" in out
    assert "Success                         0 of 2   (0% to 66%)" in out
    assert len((tmp_path / "run.csv").read_text().splitlines()) == 5001
    result = json.loads(
        run(capsys, "evaluate", "pendubot", "--board", "sim2real", "--controller", "lqr", "--seeds", "2", "--json")
    )
    assert (result["successes"], result["estimator"], result["domain"]["delay"]) == (0, False, [0.01, 0.01])
    assert [row["seed"] for row in result["details"]] == [0, 1]


@pytest.mark.slow
def test_disturbed_runs_differ_and_repeat(capsys):
    policy = ("evaluate", "pendubot", "--controller", "ar-eapo", "--json")
    options = shlex.split("--velocity-noise 0.1 --torque-noise 0.2 --torque-response 0.8 --delay 0.004 --pushes")
    # Seven gaps of 1 s between the pushes.
    boards = JudgingCommands({"performance": dataclasses.replace(PERFORMANCE, duration=7.5)})
    calm = json.loads(run(capsys, *policy, boards=boards))
    first = json.loads(run(capsys, *policy, *options, "--seed", "1", boards=boards))
    again = json.loads(run(capsys, *policy, *options, "--seed", "1", boards=boards))
    other = json.loads(run(capsys, *policy, *options, "--seed", "2", boards=boards))
    assert first["details"] == again["details"]
    assert len({result["torque_smoothness"] for result in (calm, first, other)}) == 3
    assert first["torque_smoothness"] > 10 * calm["torque_smoothness"]


def test_leaderboard_formats(capsys, small_grid):
    mine = ("--controller", "others_controllers:nan")
    quick = JudgingCommands(BOARDS | {"robustness": small_grid}, ("lqr",))
    rows = json.loads(run(capsys, "leaderboard", "acrobot", "--json", *mine, boards=quick))
    assert {row["board"] for row in rows} == {"performance", "robustness"}
    assert {"AR-EAPO", "TVLQR", "iLQR Riccati", "iLQR MPC"} <= {
        r["controller"] for r in rows if r["source"] == "paper"
    }
    failed = [row for row in rows if row["controller"] == "others_controllers:nan"]
    assert [row["board"] for row in failed] == ["performance", "robustness"]
    assert all("not finite" in row["remark"] for row in failed)
    # The other forms show the same boards; rules of one board, without a grid, will do.
    boards = JudgingCommands(quick.boards, ("lqr", "tvlqr"))
    brief = ("leaderboard", "acrobot", "--board", "hardware", *mine)
    rows = json.loads(run(capsys, *brief, "--json", boards=boards))
    table = list(csv.DictReader(io.StringIO(run(capsys, *brief, "--csv", boards=boards))))
    names = [row["controller"] for row in rows]
    assert [row["controller"] for row in table] == names
    assert names[0] == "tvlqr"
    assert set(names[1:]) == {"lqr", mine[1]}
    assert float(table[0]["score"]) == rows[0]["score"]
    few = JudgingCommands(quick.boards, ("lqr",))
    markdown = run(capsys, *brief, "--markdown", boards=few)
    assert "### Board hardware, acrobot" in markdown
    assert "| **lqr** | **ours** |" in markdown
    text = run(capsys, *brief, boards=few)
    assert "Board hardware, acrobot" in text
    assert "others_controllers:nan: " in text


@pytest.mark.slow  # benchmark/test_leaderboard.py has this board, the test above the command
def test_leaderboard_of_the_third_rules(capsys, brief_minute):
    boards = JudgingCommands({"uptime": brief_minute}, ("ar-eapo",))
    rows = json.loads(run(capsys, "leaderboard", "--board", "uptime", "--seed", "1", "--json", boards=boards))
    assert {row["robot"] for row in rows} == {"acrobot", "pendubot"}
    assert all(set(CRITERIA).isdisjoint(row) for row in rows)
    assert {row["controller"] for row in rows if row["robot"] == "pendubot"} >= {"ar-eapo", "VIMPPI"}


@pytest.mark.parametrize("values", [("plain", "nan"), ("plain,nan",)])
def test_several_values_of_one_option(capsys, values):
    names = [f"others_controllers:{name}" for name in ("plain", "nan")]
    words = [value.replace("plain", names[0]).replace("nan", names[1]) for value in values]
    boards = JudgingCommands({"hardware": dataclasses.replace(BOARDS["hardware"], duration=0.5)}, ())
    words = ["leaderboard", "acrobot", "--controller", *words, "--board", "hardware", "--json"]
    assert [row["controller"] for row in json.loads(run(capsys, *words, boards=boards))] == names


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("evaluate acrobot --sed 3", "swingup evaluate has no option --sed; did you mean --seed?"),
        (
            "train acrobot --learning_rat 3",
            "swingup train has no option --learning-rat; did you mean --learning-rate?",
        ),
        ("evalute acrobot", "unknown command 'evalute'"),
        ("evaluate", "swingup evaluate needs ROBOT: see swingup evaluate --help"),
        ("", "a command is missing: use one of demo, evaluate, leaderboard"),
        ("trajectory acrobot", "swingup trajectory needs --out FILE.safetensors"),
        ("trajectory acrobot --out x --problem foo", "--problem = 'foo': use one of 'published', 'score'"),
        ("evaluate acrobot --seed x", "--seed = 'x' is no whole number"),
        ("evaluate acrobot --delay x", "--delay = 'x' is no number"),
        ("evaluate acrobot --seed", "--seed needs a value"),
        ("evaluate acrobot extra", "unexpected extra"),
        ("evaluate acrobot --controller lqr --controller tvlqr", "--controller is given twice"),
        (
            "evaluate acrobot --board robustness --seeds 2147483648",
            "seeds = 2147483648: use a whole number from 1 to 9999",
        ),
        (
            "evaluate acrobot --board uptime --seeds 2147483648",
            "seeds = 2147483648: use a whole number from 1 to 9999",
        ),
        (
            "evaluate acrobot --board sim2real --seeds 2147483648",
            "seeds = 2147483648: use a whole number from 1 to 9999",
        ),
        ("evaluate acrobot --controller adaptiv", "module:object; did you mean adaptive?"),
    ],
)
def test_words_that_make_no_command(words, message, capsys):
    assert main(words.split()) == 2
    output = capsys.readouterr()
    assert output.err.startswith("swingup: error: ")
    assert message in output.err
    assert output.err.count("\n") == 1
    assert output.out == ""


def test_help_and_errors_list_the_same_controllers(capsys):
    with pytest.raises(SystemExit):
        main(["evaluate", "--help"])
    told = " ".join(re.sub("[│╭╰─╮╯]", " ", capsys.readouterr().out).split())
    known = ", ".join(BUILT_IN)
    assert known in told.replace("- ", "-")
    assert main(["evaluate", "acrobot", "--controller", "nothing"]) == 2
    assert known in capsys.readouterr().err


HOSTILE = "a\nb\x1b[31m|<b>`*=1\udcff.safetensors"
"""A file name with a line end, an escape sequence, markup, and a byte that is no UTF-8."""


def test_hostile_names_reach_no_terminal(capsys, tmp_path):
    policy, metadata = lone_policy("ar-eapo", "acrobot")
    save_controller(tmp_path / HOSTILE, policy, metadata)
    for words in (("evaluate", "acrobot"), ("check", "acrobot")):
        out = run(capsys, *words, "--controller", HOSTILE)
        assert "a\\nb\\x1b[31m|<b>`*=1\\udcff.safetensors" in out
        assert "\x1b" not in out
    assert main(["evaluate", "acrobot", "--controller", HOSTILE[:-4] + "none.safetensors"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "\x1b" not in error


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("evaluate cartpole", "unknown robot 'cartpole'"),
        ("evaluate acrobot --board robustness --criteria speed", "unknown criterion 'speed'"),
        ("evaluate acrobot --board robustness --grid delay=0:1", "grid 'delay=0:1' is malformed"),
        ("evaluate acrobot --board v3", "unknown board 'v3'"),
        ("evaluate acrobot --board robustness --seed -1", "seed = -1"),
        ("evaluate acrobot --criteria delay", "are those of --board robustness"),
        ("leaderboard cartpole", "unknown robot 'cartpole'"),
        ("leaderboard acrobot --board v9", "unknown board 'v9'"),
        ("leaderboard acrobot --json --csv", "--json and --csv exclude each other"),
        ("evaluate acrobot --controller others_controllers:nan", "not finite at t = 0 s"),
        ("evaluate acrobot --controller others_controllers:missing", "cannot load controller"),
        ("evaluate acrobot --controller no_such_module:it", "cannot load controller 'no_such_module:it'"),
        ("evaluate acrobot --controller others_controllers:number", "3 is no controller"),
        ("evaluate acrobot --velocity-noise -1", "velocity_noise = -1.0: use a number from 0"),
        ("evaluate acrobot --delay nan", "delay = nan: use a number"),
        ("evaluate acrobot --delay 9", "delay = 9 s is above 2 s"),
        ("evaluate acrobot --torque-response inf", "torque_response = inf"),
        ("evaluate acrobot --pushes --seed -1", "seed = -1"),
        ("evaluate acrobot --estimator --no-estimator", "--estimator and --no-estimator exclude each other"),
        ("evaluate acrobot --controller others_controllers:nan --estimator", "is in plain Python"),
        ("check acrobot --controller nothing", "unknown controller 'nothing'"),
        ("plot trajectory missing.csv --out t.png", "missing.csv"),
        ("plot shape others_controllers.py --out t.png", "unknown kind of plot 'shape'"),
        ("plot animation others_controllers.py --out missing/t.gif", "cannot write missing/t.gif"),
        ("report acrobot --out missing/report.html", "cannot write missing/report.html"),
        ("trajectory acrobot --out missing/t.safetensors", "cannot write missing/t.safetensors"),
    ],
)
def test_bad_input(arguments, message, capsys):
    assert main(arguments.split()) == 2
    output = capsys.readouterr()
    assert message in output.err
    assert output.err.count("\n") == 1
    assert output.out == ""


def test_a_plant_is_named_with_the_ratio_of_its_torques(capsys, brief_runs, tmp_path):
    options = ("--controller", "others_controllers:plain")
    out = run(capsys, "evaluate", "acrobot", *options, "--plant", "B.0", "--frictionless", boards=brief_runs)
    assert out.startswith(
        "acrobot, others_controllers:plain (board performance, plant B.0, frictionless, torque/gravity 0.96)\n"
    )
    (tmp_path / "mine.yml").write_text(yaml.safe_dump(load_plant("B.0").values()))
    result = json.loads(
        run(capsys, "evaluate", "acrobot", *options, "--plant", "mine.yml", "--json", boards=brief_runs)
    )
    assert (result["plant"], round(result["torque_over_gravity"], 3)) == ("mine.yml", 0.961)
    (tmp_path / "run.csv").write_text(
        "time,pos1,pos2,vel1,vel2,tau1,tau2\n" + "".join(f"{t},0,0,0,0,0,0\n" for t in range(11))
    )
    out = run(capsys, "score", "run.csv", "--robot", "acrobot", "--plant", "B.0")
    assert "-0.700   (-100.0 % of l1 + l2)" in out
    out = run(capsys, "score", "run.csv", "--robot", "acrobot", "--plant", "B.0", "--board", "uptime")
    assert out.startswith("acrobot, run (board uptime, plant B.0, torque/gravity 0.96)\n")


@pytest.mark.parametrize(("domain", "plant"), [("identified", "leaderboard"), ("B.0", "B.0")])
def test_baselines_of_sim2real_are_designed_for_the_domains_plant(capsys, monkeypatch, domain, plant):
    def found(name, robot, estimator, plant):
        raise SwingupError(f"designed for {plant}")

    monkeypatch.setattr(judging, "get_controller", found)
    assert main(["evaluate", "acrobot", "--board", "sim2real", "--controller", "lqr", "--domain", domain]) == 2
    assert f"designed for {plant}\n" in capsys.readouterr().err


def test_the_command_of_a_result_names_its_plant(capsys, brief_runs):
    options = ("--controller", "lqr", "--plant", "A.0", "--criteria", "delay", "--grid", "delay=0:0:2", "--json")
    result = json.loads(run(capsys, "evaluate", "acrobot", *ROBUST, *options, boards=brief_runs))
    assert "--plant=A.0 --criteria delay" in result["command"]
    assert result["plant"] == "A.0"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("evaluate", "acrobot", "--frictionless"), "--frictionless needs --plant"),
        (("evaluate", "acrobot", "--plant", "B.9"), "unknown plant 'B.9': use A.0"),
        (("score", "none.csv", "--robot", "acrobot", "--plant", "none.yml"), "none.csv"),
        (("check", "acrobot", "--plant", "none.yml"), "plant none.yml: cannot read"),
        (("report", "acrobot", "--plant", "bad.yml"), "plant bad.yml: parameter file bad.yml lacks m2"),
        (("trajectory", "acrobot", "--out", "x.safetensors", "--plant", "bad.yml"), "lacks m2"),
        (("refine", "acrobot", "--out", "x.safetensors", "--plant", "bad.yml"), "lacks m2"),
        (("train", "acrobot", "--plant", "bad.yml"), "lacks m2"),
        (("evaluate", "acrobot", "--domain", "recorded"), "leave the domain 'recorded' out"),
        (("plot", "phase", "none.csv", "--out", "x.png", "--plant", "bad.yml"), "lacks m2"),
        (("leaderboard", "acrobot", "--plant", "bad.yml"), "lacks m2"),
    ],
)
def test_a_bad_plant_is_one_line(capsys, tmp_path, words, message):
    (tmp_path / "bad.yml").write_text("m1: 1.0\n")
    assert main(list(words)) == 2
    told = capsys.readouterr().err
    assert message in told
    assert told.count("\n") == 1
