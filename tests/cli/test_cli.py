"""The commands as a user types them: output, files, exit statuses and errors."""

import json
import os
import shlex
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from safetensors.numpy import load_file

from policies import lone_policy
from swingup.cli import main
from swingup.learner.metrics import read_metrics
from swingup.policy.shipped import DEFAULT

KEYS = [
    "command", "robot", "controller", "estimator", "board", "plant", "torque_over_gravity", "seeds", "version",
    "runs", "successes", "success_interval", "swingup_time", "energy", "torque_cost", "torque_smoothness",
    "velocity_cost", "score", "intervals", "call_time", "warnings", "details",
]  # fmt: skip
TINY = shlex.split(
    "--num-envs 4 --num-steps 16 --batch-size 64 --num-epochs 1 --policy-layers 8 8 --value-layers 8 8 "
    "--evaluate-every 128 --checkpoint-every 256"
)


pytestmark = pytest.mark.usefixtures("surroundings")


def run_json(capsys, *arguments):
    assert main([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("robot", ["acrobot", pytest.param("pendubot", marks=pytest.mark.slow)])
def test_evaluate_then_score_the_same_trajectory(robot, capsys, tmp_path):
    result = run_json(capsys, "evaluate", robot, "--save", "t.csv")
    assert list(result) == KEYS
    assert result["successes"] == 1
    # The paper's scores.
    assert result["score"] >= {"acrobot": 0.633, "pendubot": 0.659}[robot]
    again = run_json(capsys, "score", "t.csv", "--robot", robot)
    assert set(again) == {*KEYS, "rate"} - {"command", "estimator"}
    assert (round(again["rate"]), again["warnings"], again["call_time"]) == (500, [], None)
    same = [*KEYS[KEYS.index("runs") : KEYS.index("call_time")], "details"]
    assert {name: again[name] for name in same} == {name: result[name] for name in same}
    hardware = run_json(capsys, "score", "t.csv", "--robot", robot, "--board", "hardware")
    # Torque and smoothness count for less there.
    assert hardware["score"] > result["score"]


@pytest.mark.slow
def test_the_cards_score_is_the_score(either_robot, capsys):
    robot = either_robot.name
    card = lone_policy("ar-eapo", robot)[1]["scores"]["v2"]["score"]
    found = run_json(capsys, "evaluate", robot, "--controller", "ar-eapo")
    assert found["score"] == pytest.approx(card, abs=1e-6)


def test_a_failed_swingup_has_no_time(capsys):
    time_ = np.arange(5000) * 0.002
    rows = [f"{t:.3f},0,0,0,0,0,0" for t in time_]
    with open("still.csv", "w") as file:
        file.write("\n".join(["time,pos1,pos2,vel1,vel2,tau1,tau2", *rows]))
    result = run_json(capsys, "score", "still.csv", "--robot", "acrobot")
    assert (result["successes"], result["swingup_time"], result["score"]) == (0, None, 0.0)


@pytest.mark.slow
def test_text_output(capsys):
    assert main(["evaluate", "pendubot"]) == 0
    out = capsys.readouterr().out
    assert f"pendubot, {DEFAULT}, with estimator (board performance)" in out
    assert "Score" in out


def test_train_resume_and_evaluate(capsys):
    assert main(["train", "pendubot", "--frames", "300", "--seed", "5", *TINY]) == 0
    output = capsys.readouterr()
    assert "Score" in output.out
    assert "320 frames" in output.err
    assert main(["train", "pendubot", "--resume", "runs/pendubot-default-5", "--frames", "500"]) == 0
    rows = read_metrics("runs/pendubot-default-5/metrics.jsonl")
    assert [row["frames"] for row in rows] == [128, 256, 320, 384, 512]
    capsys.readouterr()
    result = run_json(capsys, "evaluate", "pendubot", "--controller", "runs/pendubot-default-5/last.safetensors")
    assert result["controller"] == "runs/pendubot-default-5/last.safetensors"


@pytest.mark.slow
def test_train_another_task_and_resume(capsys):
    options = [*TINY, "--evaluation-episodes", "1"]
    assert main(["train", "--env", "CartPole-v1", "--frames", "128", *options]) == 0
    output = capsys.readouterr()
    assert "best score" in output.out
    assert "reward rate 1 per step, resets per 1,000 steps " in output.out  # CartPole has no dt
    assert "training CartPole-v1 (mujoco) to 128 frames in runs/CartPole-v1-mujoco-0" in output.err
    assert main(["train", "--resume", "runs/CartPole-v1-mujoco-0", "--frames", "256"]) == 0
    rows = read_metrics("runs/CartPole-v1-mujoco-0/metrics.jsonl")
    assert [row["frames"] for row in rows] == [128, 256]
    assert main(["train", "acrobot", "--resume", "runs/CartPole-v1-mujoco-0"]) == 2
    assert "robot = None, not acrobot" in capsys.readouterr().err
    assert load_file("runs/CartPole-v1-mujoco-0/best.safetensors")["network.logits.weight"].shape == (2, 8)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("train", "robot = None and env = None: give one of the two"),
        ("train acrobot --env CartPole-v1", "give one of the two"),
        ("train --env NoSuchTask-v0", "making 4 of 'NoSuchTask-v0' raised NameNotFound"),
        ("evaluate cartpole", "unknown robot 'cartpole'"),
        ("evaluate acrobot --controller no-such", "unknown controller 'no-such'"),
        ("evaluate acrobot --controller missing.safetensors", "no such file: missing.safetensors"),
        (
            "evaluate acrobot --controller text.safetensors",
            "text.safetensors is not a swingup policy file, or it is truncated",
        ),
        ("evaluate acrobot --controller .", "unknown controller '.'"),
        ("evaluate acrobot --board v9", "unknown board 'v9'"),
        ("evaluate acrobot --save missing/t.csv", "cannot write missing/t.csv"),
        ("score missing.csv --robot acrobot", "missing.csv"),
        ("score text.safetensors --robot acrobot", "text.safetensors"),
        ("leaderboard cartpole", "unknown robot 'cartpole'"),
        ("train cartpole", "unknown robot 'cartpole'"),
        ("train acrobot --preset best", "unknown preset 'best'"),
        ("train acrobot --preset", "--preset needs a value"),
        ("train acrobot --frames 0", "frames = 0: use a whole number of at least 1"),
        ("train acrobot --seeds 0", "seeds = 0: use a whole number of at least 1"),
        ("evaluate acrobot --board sim2real --domain missing.yml", "cannot read domain file missing.yml"),
        (
            "evaluate acrobot --board sim2real --domain moon",
            "unknown domain 'moon': use identified, randomised, recorded, cells, ",
        ),
        ("evaluate acrobot --board sim2real --seeds 0", "seeds = 0"),
        ("evaluate acrobot --board sim2real --save missing/t.csv", "cannot write missing/t.csv"),
        ("train acrobot --batch-size 1000", "batch_size = 1000 does not divide"),
        ("train acrobot --out text.safetensors/run", "cannot create text.safetensors/run"),
        ("train acrobot --out full", "full exists"),
        ("train acrobot --resume missing", "missing is not a run's folder"),
        ("train acrobot --resume missing --out other", "does not go with --resume"),
    ],
)
def test_bad_input(arguments, message, capsys, tmp_path):
    (tmp_path / "text.safetensors").write_text("not an archive")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("precious")
    before = {path for path in tmp_path.rglob("*") if "cache" not in path.parts}
    assert main(arguments.split()) == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("swingup: error: ")
    assert message in error
    assert "\n" not in error
    assert {path for path in tmp_path.rglob("*") if "cache" not in path.parts} == before


def test_a_policy_of_the_other_robot(capsys, tmp_path):
    from importlib import resources

    with resources.as_file(resources.files("swingup") / "zoo" / "pendubot-ar-eapo.safetensors") as path:
        assert main(["evaluate", "acrobot", "--controller", str(path)]) == 2
    assert "is for 'pendubot', not the acrobot" in capsys.readouterr().err


@pytest.mark.slow
def test_resuming_with_other_settings(capsys):
    assert main(["train", "acrobot", "--frames", "64", "--out", "r", *TINY]) == 0
    for arguments, message in (
        (["pendubot"], "robot = acrobot, not pendubot"),
        (["acrobot", "--preset", "paper"], "preset = default, not paper"),
        (["acrobot", "--seed", "1"], "seed = 0, not 1"),
        (["acrobot", "--clip-range", "0.3"], "clip_range = 0.05, not 0.3"),
    ):
        assert main(["train", *arguments, "--resume", "r"]) == 2
        assert message in capsys.readouterr().err


ENDLESS = ["train", "acrobot", "--frames", "100000000", "--out", "r", *TINY]


@pytest.mark.slow
def test_a_signal_ends_the_process(tmp_path):
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    command = [sys.executable, "-m", "swingup", *ENDLESS]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment) as process:
        _wait_for_a_report()
        process.send_signal(signal.SIGTERM)
        _, error = process.communicate(timeout=120)
    assert process.returncode == 143
    _check_stopped(error)


def test_ctrl_c_ends_the_command(capsys):
    def press():
        _wait_for_a_report()  # by then the command handles signals
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=press)
    thread.start()
    status = main(ENDLESS)
    thread.join()
    assert status == 130
    _check_stopped(capsys.readouterr().err)


def _wait_for_a_report():
    deadline = time.monotonic() + 300
    while time.monotonic() < deadline and not _lines("r/metrics.jsonl"):
        time.sleep(0.1)


def _check_stopped(error):
    assert "stopped at" in error
    assert "train --resume r" in error
    frames = read_metrics("r/metrics.jsonl")[-1]["frames"]
    assert f"{frames:012d}.safetensors" in os.listdir("r/checkpoints")
    assert os.path.exists("r/last.safetensors")


def _lines(path):
    return os.path.exists(path) and os.path.getsize(path) > 0


@pytest.mark.parametrize("command", ["train", "sweep", "export"])
def test_the_help_shows_no_default_that_nobody_types(command, capsys):
    with pytest.raises(SystemExit):
        main([command, "--help"])
    shown = capsys.readouterr().out
    assert "None" not in shown
    assert "(default: " in shown
