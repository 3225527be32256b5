"""The commands around the boards, as a user types them."""

import csv
import dataclasses
import io
import json
import shlex
import textwrap

import pytest

import swingup
from swingup.benchmark import leaderboard as boards
from swingup.benchmark.rules import CRITERIA, PERFORMANCE_RULES, ROBUSTNESS_RULES
from swingup.cli import main
from swingup.policy.jax_backend.controller import save_controller

CONTROLLERS = textwrap.dedent(
    """
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

    def nan(x, t):
        return [0.0, np.nan]

    number = 3
    """
)


@pytest.fixture(autouse=True)
def surroundings(tmp_path, monkeypatch):
    """A working folder with a module of controllers, entrants that are quick, and no cache outside of the test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(boards, "ENTRANTS", ("refined",))
    monkeypatch.setattr(boards, "FURTHER", ())
    (tmp_path / "others_controllers.py").write_text(CONTROLLERS)


@pytest.fixture
def brief_runs(monkeypatch):
    """Boards of IROS 2024 with runs of half a second, for what does not depend on their end."""
    for versions in (PERFORMANCE_RULES, ROBUSTNESS_RULES):
        monkeypatch.setitem(versions, "v2", dataclasses.replace(versions["v2"], duration=0.5))


def once(function):
    """Judges each controller once by each version of the rules."""
    known = {}

    def remembered(controller, robot, name, rules):
        if (robot.name, name, rules) not in known:
            known[robot.name, name, rules] = function(controller, robot, name, rules)
        return known[robot.name, name, rules]

    return remembered


def run(capsys, *arguments, status=0):
    assert main(list(arguments)) == status
    return capsys.readouterr().out


@pytest.mark.usefixtures("small_grid")
def test_robustness_as_json(capsys):
    result = json.loads(
        run(capsys, "robustness", "pendubot", "--json", "--seed", "3", "--criteria", "delay,perturbations")
    )
    assert list(result) == [
        "command", "robot", "controller", "estimator", "rules", "seed", "version", "delay", "perturbations",
        "overall", "details",
    ]  # fmt: skip
    assert (result["robot"], result["controller"], result["rules"], result["seed"]) == (
        "pendubot",
        "refined",
        "v2",
        3,
    )
    assert result["overall"] is None
    assert len(result["details"]) == 11  # 3 delays, 8 profiles of pushes
    assert result["details"][0] == {"criterion": "delay", "value": 0.0, "success": True}
    assert result["command"].startswith("swingup robustness pendubot --controller=refined --rules=v2 --seed=3")
    # The command that the result names prints the result again.
    again = json.loads(run(capsys, *result["command"].split()[1:], "--json"))
    assert again == result


def test_robustness_as_text_with_intervals(capsys):
    out = run(
        capsys, "robustness", "acrobot", "--seeds", "2", "--grid", "velocity_noise=0:0.5:3:3", "--criteria",
        "velocity_noise",
    )  # fmt: skip
    assert "acrobot, refined, with estimator (rules v2 velocity_noise=0:0.5:3:3, seed 0 to 1)" in out
    assert " to " in out.splitlines()[1]
    assert "18" in out  # 3 values, 3 repetitions, 2 seeds


@pytest.mark.usefixtures("brief_runs")
@pytest.mark.parametrize("name", ["jax_damping", "plain"])
def test_others_controllers(capsys, name):
    name = f"others_controllers:{name}"
    assert json.loads(run(capsys, "evaluate", "acrobot", "--controller", name, "--json"))["success"] is False
    assert "nothing wrong" in run(capsys, "check", "acrobot", "--controller", name)
    result = run(
        capsys, "robustness", "acrobot", "--controller", name, "--criteria", "delay", "--grid", "delay=0:0:2"
    )
    assert "Time delay [%]" in result
    assert "0.0" in result


@pytest.fixture
def meant(tmp_path):
    """A file of the pendubot's policy that asks for an estimator."""
    policy, metadata = swingup.shipped_policy("pendubot")
    save_controller(tmp_path / "meant.npz", policy, {"scores": metadata["scores"], "estimator": {}})
    return "meant.npz"


@pytest.mark.usefixtures("brief_runs")
@pytest.mark.parametrize(
    ("flags", "judged"),
    [((), True), (("--estimator",), True), (("--no-estimator",), False)],
)
def test_with_and_without_an_estimator(capsys, meant, flags, judged):
    words = f"meant.npz, {'with estimator' if judged else 'policy alone'}"
    options = ("pendubot", "--controller", meant, *flags)
    assert json.loads(run(capsys, "evaluate", *options, "--json"))["estimator"] is judged
    assert f"pendubot, {words} (rules v2)" in run(capsys, "evaluate", *options)
    assert f"{words}: nothing wrong was found" in run(capsys, "check", *options)


@pytest.mark.usefixtures("brief_minute")
def test_robustness_and_uptime_with_an_estimator(capsys, meant):
    base = ("pendubot", "--controller", "ar-eapo")
    brief = ("pendubot", "--criteria", "delay", "--grid", "delay=0.03:0.04:2", "--json")
    alone, estimating = (
        json.loads(run(capsys, "robustness", *brief, *base[1:], *flags)) for flags in ((), ("--estimator",))
    )
    assert (alone["estimator"], estimating["estimator"]) == (False, True)
    assert alone["delay"] < estimating["delay"]
    assert "estimator" not in alone["command"]
    assert " --estimator " in estimating["command"]
    assert json.loads(run(capsys, *shlex.split(estimating["command"])[1:], "--json")) == estimating
    held = json.loads(run(capsys, "robustness", *brief, "--controller", meant, "--no-estimator"))
    assert held["estimator"] is False
    assert " --no-estimator " in held["command"]
    assert "ar-eapo, with estimator (rules v3" in run(capsys, "uptime", *base, "--estimator")
    assert json.loads(run(capsys, "uptime", *base, "--estimator", "--json"))["estimator"] is True


def test_check_names_the_fault(capsys):
    out = run(capsys, "check", "acrobot", "--controller", "others_controllers:nan", status=1)
    assert "gave a torque that is not finite at t = 0 s" in out


@pytest.mark.usefixtures("brief_minute")
def test_uptime(capsys, tmp_path):
    out = run(capsys, "uptime", "pendubot", "--seeds", "2", "--save", "minute.csv")
    assert "Uptime score" in out
    assert " to " in out
    assert len((tmp_path / "minute.csv").read_text().splitlines()) == 4_501  # rows, each of 2 ms, and a head
    result = json.loads(run(capsys, "uptime", "pendubot", "--json"))
    assert 0 < result["uptime"] < 1
    assert result["seed"] == 0


def test_sim2real(capsys, tmp_path):
    out = run(capsys, "sim2real", "pendubot", "--controller", "lqr", "--seeds", "2", "--save", "run.csv")
    assert "pendubot, lqr (domain identified, seed 0 to 1)" in out
    assert "Swing-up time [s]                    –   (median of the successes)" in out
    assert "Success                         0 of 2   (0% to 66%)" in out
    assert len((tmp_path / "run.csv").read_text().splitlines()) == 5001
    result = json.loads(run(capsys, "sim2real", "pendubot", "--controller", "lqr", "--seeds", "2", "--json"))
    assert (result["successes"], result["estimator"], result["domain"]["delay"]) == (0, False, [0.01, 0.01])
    assert [row["seed"] for row in result["details"]] == [0, 1]


def test_disturbed_runs_differ_and_repeat(capsys):
    options = shlex.split(
        "--velocity-noise 0.1 --torque-noise 0.2 --torque-response 0.8 --delay 0.004 --pushes --json"
    )
    calm = json.loads(run(capsys, "evaluate", "pendubot", "--json"))
    first = json.loads(run(capsys, "evaluate", "pendubot", *options, "--seed", "1"))
    again = json.loads(run(capsys, "evaluate", "pendubot", *options, "--seed", "1"))
    other = json.loads(run(capsys, "evaluate", "pendubot", *options, "--seed", "2"))
    assert first == again
    assert len({result["torque_smoothness"] for result in (calm, first, other)}) == 3
    assert first["torque_smoothness"] > 10 * calm["torque_smoothness"]


@pytest.mark.usefixtures("small_grid")
def test_leaderboard_formats(capsys, monkeypatch):
    mine = ("--controller", "others_controllers:nan")
    rows = json.loads(run(capsys, "leaderboard", "acrobot", "--json", *mine))
    assert {row["measure"] for row in rows} == {"performance", "robustness"}
    assert {"AR-EAPO", "TVLQR", "iLQR Riccati", "iLQR MPC"} <= {
        r["controller"] for r in rows if r["source"] == "paper"
    }
    failed = [row for row in rows if row["controller"] == "others_controllers:nan"]
    assert [row["measure"] for row in failed] == ["performance", "robustness"]
    assert all("not finite" in row["remark"] for row in failed)
    # The other forms show the same boards; rules of one board, without a grid, will do.
    monkeypatch.setattr(boards, "evaluate", once(boards.evaluate))
    brief = ("leaderboard", "acrobot", "--rules", "hardware", *mine)
    rows = json.loads(run(capsys, *brief, "--json"))
    table = list(csv.DictReader(io.StringIO(run(capsys, *brief, "--csv"))))
    names = [row["controller"] for row in rows]
    assert [row["controller"] for row in table] == names
    assert (set(names[:2]), names[2:]) == ({"refined", "refined --no-estimator"}, [mine[1]])
    assert float(table[0]["score"]) == rows[0]["score"]
    markdown = run(capsys, *brief, "--markdown")
    assert "### Performance scores of the acrobot (rules hardware)" in markdown
    assert "| **refined** | **ours** |" in markdown
    text = run(capsys, *brief)
    assert "Performance scores of the acrobot (rules hardware)" in text
    assert "others_controllers:nan: " in text


@pytest.mark.usefixtures("brief_minute")
def test_leaderboard_of_the_third_rules(capsys):
    rows = json.loads(run(capsys, "leaderboard", "--rules", "v3", "--seed", "1", "--json"))
    assert {row["robot"] for row in rows} == {"acrobot", "pendubot"}
    assert all(set(CRITERIA).isdisjoint(row) for row in rows)
    assert {row["controller"] for row in rows if row["robot"] == "pendubot"} >= {"refined", "VIMPPI"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("robustness cartpole", "unknown robot 'cartpole'"),
        ("robustness acrobot --criteria speed", "unknown criterion 'speed'"),
        ("robustness acrobot --grid delay=0:1", "grid 'delay=0:1' is malformed"),
        ("robustness acrobot --rules v3", "unknown robustness rules 'v3'"),
        ("robustness acrobot --seed -1", "seed = -1"),
        ("uptime acrobot --rules v2", "unknown uptime rules 'v2'"),
        ("leaderboard cartpole", "unknown robot 'cartpole'"),
        ("leaderboard acrobot --rules v9", "unknown rules 'v9'"),
        ("leaderboard acrobot --json --csv", "--json and --csv exclude each other"),
        ("evaluate acrobot --controller others_controllers:nan", "not finite at t = 0 s"),
        ("evaluate acrobot --controller others_controllers:missing", "cannot load controller"),
        ("evaluate acrobot --controller no_such_module:it", "cannot load controller 'no_such_module:it'"),
        ("evaluate acrobot --controller others_controllers:number", "3 is no controller"),
        ("evaluate acrobot --velocity-noise -1", "velocity_noise = -1.0 is out of range"),
        ("evaluate acrobot --delay nan", "delay = nan is out of range"),
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
        ("trajectory acrobot --out missing/t.npz", "cannot write missing/t.npz"),
    ],
)
def test_bad_input(arguments, message, capsys):
    assert main(arguments.split()) == 2
    output = capsys.readouterr()
    assert message in output.err
    assert output.err.count("\n") == 1
    assert output.out == ""
