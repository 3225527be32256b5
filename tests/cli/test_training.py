"""The commands ``train``, ``demo`` and ``refine``: runs of a few frames, signals, and what they print."""

import dataclasses
import itertools
import json
import os
import re
import signal
import sys
import threading
import time
import types
from pathlib import Path

import pytest

from policies import lone_policy
from swingup.cli import main
from swingup.common.settings import read_settings
from swingup.learner.metrics import read_metrics
from swingup.loop.starts import Starts
from swingup.policy.estimator import EstimatorSettings
from swingup.policy.shipped import load_policy
from swingup.refine import adapt, recipe
from swingup.refine.recipe import RECIPES, RECOVER_ON_MANY
from swingup.refine.teachers import PlantDraws

TINY = (
    "--num-envs 4 --num-steps 16 --batch-size 64 --num-epochs 1 --policy-layers 8 8 --value-layers 8x8 "
    "--evaluate-every 128 --checkpoint-every 256"
)


def test_train_and_resume(run, capsys):
    assert main(f"train acrobot --frames 300 --seed 5 {TINY}".split()) == 0
    output = capsys.readouterr()
    assert "Score" in output.out
    assert "frames: 320 of 300, 0 s left  best 0.000  score 0.000  reward -" in output.err
    run("train acrobot --resume runs/acrobot-pendulum-5 --frames 500")
    rows = read_metrics("runs/acrobot-pendulum-5/metrics.jsonl")
    assert [row["frames"] for row in rows] == [128, 256, 320, 384, 512]
    config = json.loads(Path("runs/acrobot-pendulum-5/config.json").read_text())["config"]
    assert (config["policy_layers"], config["value_layers"], config["temperature"]) == ([8, 8], [8, 8], 2.0)
    for words, message in (
        ("pendubot", "robot = acrobot, not pendubot"), ("--clip-range 0.3", "clip_range = 0.05, not 0.3"),
        ("--plant B.0", "plant = leaderboard, not B.0"),
    ):  # fmt: skip
        assert main(f"train {words} --resume runs/acrobot-pendulum-5".split()) == 2
        assert message in capsys.readouterr().err


ENDLESS = """
import gymnasium, numpy as np

class Endless(gymnasium.Env):
    observation_space, action_space = gymnasium.spaces.Box(-9, 9, (1,)), gymnasium.spaces.Box(-1, 1, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {}

    def step(self, action):
        return np.zeros(1, np.float32), float(action[0]), False, False, {}

gymnasium.register("Endless-v0", Endless)
"""


def test_a_task_of_the_working_folder_that_never_ends(run, capsys, monkeypatch, tmp_path):
    """Its module is found there; time counts before policies are saved, and a default for episodes is told."""
    monkeypatch.setattr(sys, "path", [each for each in sys.path if each not in ("", str(tmp_path))])
    # A clock that shows a second more at each look.
    clock = types.SimpleNamespace(perf_counter=itertools.count().__next__)
    monkeypatch.setattr("swingup.learner.run.time", clock)
    Path("endless_task.py").write_text(ENDLESS)
    assert main(f"train --env endless_task:Endless-v0 --frames 128 --out r {TINY}".split()) == 0
    assert (
        "no episode ended: where the task goes on for ever, --preset continuing is for it"
        in capsys.readouterr().err
    )
    assert load_policy("r/best.safetensors").metadata["seconds"] == 1.0
    assert "2000" in run("evaluate --controller r/best.safetensors --episodes 1")


def test_ctrl_c_ends_the_command(capsys):
    def press():
        path, deadline = Path("r/metrics.jsonl"), time.monotonic() + 300
        while time.monotonic() < deadline and not (path.exists() and path.stat().st_size):
            time.sleep(0.1)  # once it reports, the command handles signals
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=press).start()
    assert main(f"train acrobot --frames 100000000 --out r {TINY}".split()) == 130
    assert "train --resume r" in capsys.readouterr().err
    frames = read_metrics("r/metrics.jsonl")[-1]["frames"]
    assert f"{frames:012d}.safetensors" in os.listdir("r/checkpoints")
    assert os.path.exists("r/last.safetensors")


def tiny(stage):
    return dataclasses.replace(stage, steps=2, duration=0.02, episodes=2, starts=Starts(hanging=1))


def a_few(scored):
    return dataclasses.replace(scored, steps=2, recoveries=2, duration=0.02)


@pytest.mark.slow
def test_refine_writes_a_policy_with_its_origin(tmp_path, monkeypatch, run):
    monkeypatch.setitem(RECIPES, "recover", (tiny(RECIPES["recover"][0]),))
    out = tmp_path / "refined.safetensors"
    assert "swingup evaluate pendubot" in run(f"refine pendubot --seed 3 --out {out}")
    (_, metadata), (_, origin) = (lone_policy(each, "pendubot") for each in (out, "ar-eapo"))
    command = "swingup refine pendubot --policy=ar-eapo --recipe=recover --seed=3 --out=refined.safetensors"
    assert (metadata["command"], metadata["base"]["frames"]) == (command, origin["frames"])
    assert metadata["stages"][0]["steps"] == 2
    assert read_settings(metadata, EstimatorSettings) == EstimatorSettings()


@pytest.mark.slow
@pytest.mark.parametrize("shipped", [False, True], ids=["trained", "shipped"])
def test_adapt_goes_from_a_domain_to_a_judged_policy_and_a_page(tmp_path, monkeypatch, run, shipped):
    """After each stage the best policy so far is kept, such as the shipped one, where it was judged first."""
    monkeypatch.setattr(adapt, "ENOUGH", 2.0)
    if not shipped:
        monkeypatch.setattr(adapt, "shipped_for", lambda *_: None)
    (gradient, distillation), (recoveries,), draws = RECIPES["adapt"], RECOVER_ON_MANY, PlantDraws(1, 1, 1, 1)
    few = {"draws": draws, "copies": 4, "rounds": 2, "steps": 40, "scored": a_few(distillation.scored)}
    monkeypatch.setitem(RECIPES, "adapt", (tiny(gradient), dataclasses.replace(distillation, **few)))
    last = dataclasses.replace(recoveries, draws=draws, scored=a_few(recoveries.scored))
    monkeypatch.setattr(recipe, "RECOVER_ON_MANY", (last,))
    words = "refine acrobot --recipe adapt --domain identified --frames 8192 --seeds 2 --out mine.safetensors"
    out = run(words, "--page", "mine.html")
    judged = re.findall(r"(.*): (\d) of 2 draws", out)
    assert {"trained for them", "with more recoveries"} <= {what for what, _ in judged}
    assert judged[0] == ("adaptive as shipped, in this pendulum's units", "2") or not shipped
    successes = [int(number) for _, number in judged]
    worse = [number <= max(successes[:stage], default=-1) for stage, number in enumerate(successes)]
    assert out.count("mine.safetensors has the one before") == sum(worse)
    assert "mine.safetensors (board sim2real, domain mine-adapt.yml, seed 20000 to 20001)" in out
    assert re.search(r"Success +(\d) of 2", out)[1] == "2" or not shipped
    assert "swingup evaluate acrobot --board=sim2real --controller=mine.safetensors --domain=mine-adapt.yml" in out
    policy = load_policy("mine.safetensors", "acrobot")
    assert (policy.parts, policy.identifier.passive_limit) == (("estimator", "identifier", "regulator"), 0.5)
    assert "Draws that training did not see" in (tmp_path / "mine.html").read_text(encoding="utf-8")
    assert (tmp_path / "mine-base" / "config.json").exists()
    if shipped:
        monkeypatch.setattr(adapt, "ENOUGH", 0.98)
        assert "2 of 2 draws" in run(words.replace("mine", "quick"))
        assert not (tmp_path / "quick-base").exists()
