"""The commands ``train``, ``demo`` and ``refine``: runs of a few frames, signals, and what they print."""

import json
import math
import os
import shlex
import signal
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from safetensors.numpy import load_file

from policies import lone_policy
from swingup.benchmark.boards import BOARDS
from swingup.benchmark.leaderboard import OURS, Row, Table, published_rows
from swingup.cli import demonstrating, main, refining
from swingup.cli.commands import COMMANDS
from swingup.cli.demonstrating import Watch
from swingup.cli.parsing import parse
from swingup.common.settings import read_settings
from swingup.learner.metrics import read_metrics
from swingup.learner.progress import TrainingReport
from swingup.plant.robots import ROBOTS
from swingup.policy.estimator.settings import EstimatorSettings
from swingup.policy.shipped import DEFAULT, load_policy
from swingup.refine.analytic_policy_gradient import PolicyGradientSettings
from swingup.refine.distillation_settings import DistillationSettings
from swingup.refine.episodes import EpisodeSettings
from swingup.refine.plant_draws import PlantDraws
from swingup.refine.recipe import GradientStage

ACROBOT = ROBOTS["acrobot"]
TINY = (
    "--num-envs 4 --num-steps 16 --batch-size 64 --num-epochs 1 --policy-layers 8 8 --value-layers 8x8 "
    "--evaluate-every 128 --checkpoint-every 256"
)
ENDLESS = f"train pendubot --frames 100000000 --out r {TINY}"


def report(frames=65_536, best=0.75, **row):
    return TrainingReport(frames, 20_000.0, [{"reward": -0.25, "score": 0.5, **row}], best)


def test_train_resume_and_evaluate(run, capsys):
    assert main(f"train pendubot --frames 300 --seed 5 {TINY}".split()) == 0
    output = capsys.readouterr()
    assert "Score" in output.out
    assert "training pendubot (default) to 300 frames in runs/pendubot-default-5" in output.err
    assert "frames: 320 of 300, 0 s left  best 0.000  score 0.000  reward -" in output.err
    run("train pendubot --resume runs/pendubot-default-5 --frames 500")
    rows = read_metrics("runs/pendubot-default-5/metrics.jsonl")
    assert [row["frames"] for row in rows] == [128, 256, 320, 384, 512]
    config = json.loads(Path("runs/pendubot-default-5/config.json").read_text())["config"]
    assert (config["policy_layers"], config["value_layers"], config["temperature"]) == ([8, 8], [8, 8], 2.0)
    for words, message in (
        ("acrobot", "robot = pendubot, not acrobot"), ("--clip-range 0.3", "clip_range = 0.05, not 0.3"),
        ("--plant B.0", "plant = leaderboard, not B.0"),
    ):  # fmt: skip
        assert main(f"train {words} --resume runs/pendubot-default-5".split()) == 2
        assert message in capsys.readouterr().err


@pytest.mark.slow
def test_train_another_task_and_resume(run, capsys):
    assert main(f"train --env CartPole-v1 --frames 128 --evaluation-episodes 1 {TINY}".split()) == 0
    output = capsys.readouterr()
    assert "reward rate 1 per step, resets per 1,000 steps " in output.out  # CartPole has no dt
    assert "training CartPole-v1 (mujoco) to 128 frames in runs/CartPole-v1-mujoco-0" in output.err
    assert "best score" in run("train --resume runs/CartPole-v1-mujoco-0 --frames 256")
    rows = read_metrics("runs/CartPole-v1-mujoco-0/metrics.jsonl")
    assert [row["frames"] for row in rows] == [128, 256]
    assert load_file("runs/CartPole-v1-mujoco-0/best.safetensors")["network.logits.weight"].shape == (2, 8)


def test_ctrl_c_ends_the_command(capsys):
    def press():
        _wait_for_a_report()  # by then the command handles signals
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=press)
    thread.start()
    status = main(ENDLESS.split())
    thread.join()
    assert status == 130
    _check_stopped(capsys.readouterr().err)


def _wait_for_a_report():
    path, deadline = Path("r/metrics.jsonl"), time.monotonic() + 300
    while time.monotonic() < deadline and not (path.exists() and path.stat().st_size):
        time.sleep(0.1)


def _check_stopped(error):
    assert "stopped at" in error
    assert "train --resume r" in error
    frames = read_metrics("r/metrics.jsonl")[-1]["frames"]
    assert f"{frames:012d}.safetensors" in os.listdir("r/checkpoints")
    assert os.path.exists("r/last.safetensors")


class SavingRun:
    """A run whose policies are words."""

    def __init__(self, folder):
        self.folder, self.frames, self.saved = folder, 0, []

    def policy(self, index):
        return f"policy {index} after {self.frames} frames"

    def save_policy(self, path, index, policy, result):
        path.write_text(policy)
        self.saved.append((path.name, result))


def board(robot, mine, remark=None):
    """The published rows and one of ours, best first."""
    ours = Row("your policy", OURS, {**published_rows(robot, "performance")[0].values, "score": mine}, remark)
    rows = sorted([ours, *published_rows(robot, "performance")], key=lambda row: -row.values["score"])
    return Table(robot.name, "performance", BOARDS["performance"].columns, None, tuple(rows))


def test_the_watch_notes_when_the_papers_score_was_passed(tmp_path, monkeypatch):
    clock = iter([74.4, 99.0])
    monkeypatch.setattr(demonstrating, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    run = SavingRun(tmp_path)
    watch = Watch(run, paper=0.633, start=10.0)
    notes = []
    for run.frames, best in ((65_536, 0.0), (131_072, 0.632), (196_608, 0.633), (262_144, 0.64)):
        notes.append(watch.note(report(run.frames, best)))
    assert notes == ["paper's 0.633"] * 2 + ["paper's 0.633 at 64 s"] * 2
    # The first policy alone.
    assert run.saved == [("first.safetensors", {"score": 0.5, "frames": 65_536})]
    assert (tmp_path / "first.safetensors").read_text() == "policy 0 after 65536 frames"


@pytest.fixture
def pretended(monkeypatch):
    """The demo with a training and a page that take no time; the training's options are kept."""
    given = []

    def start(env, frames, out, **options):
        given.append((env, frames, out, options))
        Path(out).mkdir(parents=True)
        return SavingRun(Path(out))

    monkeypatch.setattr(sys, "argv", ["swingup.py"])
    monkeypatch.setattr(demonstrating, "page_template", lambda: None)
    monkeypatch.setattr(demonstrating, "start_training", start)
    monkeypatch.setattr(demonstrating, "train_shown", lambda run, note: note(report(65_536, 0.64)) and 0)
    monkeypatch.setattr(demonstrating, "load_policy", lambda path, robot: path.name)
    monkeypatch.setattr(demonstrating, "policy_alone", lambda policy: policy)
    monkeypatch.setattr(demonstrating, "trained_section", lambda *_: SimpleNamespace(tables=[board(ACROBOT, 0.64)]))
    monkeypatch.setattr(demonstrating, "render_page", lambda sections, title: title)
    return given


def test_the_demo_ends_with_three_commands(pretended, run):
    lines = run("demo --seed 3").splitlines()
    assert pretended == [("acrobot", None, "runs/demo-acrobot", {"preset": "fast", "seed": 3})]
    typed = [shlex.split(line)[3:] for line in lines if " -m swingup " in line]
    assert [words[0] for words in typed] == ["evaluate", "demo", "leaderboard"]
    for words in typed:
        parse(COMMANDS, words, "")
    # A command may be longer: a terminal wraps it, and it is still copied whole.
    assert any(line.startswith("Training passed the paper's score after ") for line in lines)
    assert Path("runs/demo-acrobot/page.html").read_text().startswith("Acrobot: ")
    run("demo")
    assert pretended[-1][2] == "runs/demo-acrobot-2"  # the first run stays


def test_a_demo_below_the_paper_or_interrupted(pretended, monkeypatch, run):
    monkeypatch.setattr(demonstrating, "train_shown", lambda run, note: note(report(65_536, 0.6)) and 0)
    assert "The best score stayed below the paper's: try more --frames" in run("demo")
    monkeypatch.setattr(demonstrating, "train_shown", lambda run, note: 130)
    assert "Next" not in run("demo --out mine", status=130)
    assert not Path("mine/page.html").exists()


@pytest.mark.slow
def test_a_short_demonstration_and_its_next_commands(capsys, monkeypatch, small_grid, entrants):
    pytest.importorskip("jinja2", reason="Jinja is not installed")
    monkeypatch.setattr(sys, "argv", ["swingup"])
    monkeypatch.setitem(BOARDS, "robustness", small_grid)
    assert main(["demo", "pendubot", "--frames", "150000"]) == 0
    output = capsys.readouterr()
    assert "training pendubot (fast) to 150,000 frames in runs/demo-pendubot" in output.err
    assert "paper's 0.659" in output.err
    folder = Path("runs/demo-pendubot")
    frames = [(row["seed"], row["frames"]) for row in read_metrics(folder / "metrics.jsonl")]
    # Whole iterations of 64 × 128 frames, of both seeds.
    assert frames == [(seed, number) for number in (65_536, 131_072, 155_648) for seed in (0, 1)]
    page = (folder / "page.html").read_text(encoding="utf-8")
    shown = json.loads(page.partition('id="data">')[2].partition("</script>")[0])["sections"][0]
    names = [show["name"] for show in shown["shows"]]
    assert names == ["your policy", "your policy at first", DEFAULT, "ar-eapo"]
    assert shown["policy"] is not None
    entrants("ar-eapo")
    for line in output.out.splitlines()[-5::2]:
        words = shlex.split(line)[1:]
        assert main([*words, *(["--frames", "8192"] if words[0] == "demo" else [])]) == 0, words


@pytest.mark.slow
def test_refine_writes_a_policy_with_its_origin(tmp_path, monkeypatch, run):
    tiny = GradientStage(
        PolicyGradientSettings(iterations=2, learning_rate=1e-4, duration=0.02),
        EpisodeSettings(nominal=2, anywhere=0, thrown=0),
    )
    monkeypatch.setitem(refining.RECIPES, "recover", (tiny,))
    out = tmp_path / "refined.safetensors"
    assert "swingup evaluate pendubot" in run(f"refine pendubot --seed 3 --out {out}")
    policy, metadata = lone_policy(out, "pendubot")
    base, origin = lone_policy("ar-eapo", "pendubot")
    assert metadata["command"] == (
        "swingup refine pendubot --policy=ar-eapo --recipe=recover --seed=3 --out=refined.safetensors"
    )
    assert metadata["base"]["frames"] == origin["frames"]
    assert metadata["stages"][0]["gradient"]["iterations"] == 2
    assert read_settings(metadata, EstimatorSettings) == EstimatorSettings()
    moved = np.abs(policy.policy.actor.mean_head.weight - base.policy.actor.mean_head.weight).max()
    assert 0 < moved < 1e-3
    assert math.isfinite(metadata["seconds"])


@pytest.mark.slow
def test_adapt_goes_from_a_domain_to_a_judged_policy_and_a_page(tmp_path, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    tiny = GradientStage(PolicyGradientSettings(iterations=2, duration=0.02), EpisodeSettings(2, 0, 0))
    few = DistillationSettings(
        draws=PlantDraws(1, 1, 1, 1), nominal=4, rounds=2, duration=0.4, steps=40, anywhere=300, score_steps=0
    )
    monkeypatch.setitem(refining.RECIPES, "adapt", (tiny, few))
    words = "refine acrobot --recipe adapt --domain identified --frames 8192 --seeds 2 --out mine.safetensors"
    out = run(words, "--page", "mine.html")
    assert "mine.safetensors (board sim2real, domain identified, seed 20000 to 20001)" in out
    assert "swingup evaluate acrobot --board=sim2real --controller=mine.safetensors --domain=identified" in out
    policy = load_policy("mine.safetensors", "acrobot")
    assert policy.parts == ("estimator", "identifier", "regulator")
    assert policy.identifier.passive_limit == 0.5
    assert "Draws that training did not see" in (tmp_path / "mine.html").read_text(encoding="utf-8")
    assert (tmp_path / "mine-base" / "config.json").exists()
