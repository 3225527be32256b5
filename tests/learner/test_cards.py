"""A run's model card, and the callbacks of an example with stand-ins for other people's packages."""

import json
import re
import runpy
import sys
import types
from pathlib import Path

import gymnasium
import pytest

import swingup
from refusals import refusal
from swingup import AREAPO
from swingup.cli.exporting import plot_command
from swingup.learner.card import write_card
from swingup.policy.file import write_network
from swingup.report.figures import curves_figure
from swingup.report.watch import policy_files

from .environments import TINY
from .test_play import saved, walker

EXAMPLE = Path(swingup.__file__).parents[2] / "examples" / "04_callbacks.py"
RUN = {"frames": 640, "seconds": 2.0, "seed": 3, "command": "swingup train --env=a", "version": "9.9"}


def card_of(folder, score, **entries):
    result = {"score": score, "reward_rate": 0.5, "resets_per_1000_steps": 0.0}
    policy = walker(1)
    write_network(
        folder / "best.safetensors",
        policy.network,
        {**policy.metadata, **RUN, **entries, "scores": {"episodes": result}},
    )
    write_card(folder)
    return (folder / "README.md").read_text(encoding="utf-8")


def test_a_card_says_what_the_best_policy_is_and_can_do(tmp_path):
    odd = 'my "task": <x>'
    without = card_of(tmp_path, None, task=odd)
    assert "| mean return | `–` |" in without
    assert "model-index" not in without
    card = card_of(tmp_path, 3.0, task=odd)
    assert "| saved after | `640 frames in 2 s, seed 3` |\n| command | `swingup train --env=a` |" in card
    assert 'load_policy("best.safetensors")' in card
    _, head, _ = card.split("---\n")
    lines = [line.strip(" -").partition(": ") for line in head.splitlines()]
    found = {key: value for key, _, value in lines}
    assert found["dataset"] == f"{{type: {json.dumps(odd)}, name: {json.dumps(odd)}}}"
    assert found["tags"] == f"[reinforcement-learning, {json.dumps(odd)}]"
    assert "{type: mean_reward, name: mean return, value: 3.0}" in head
    assert "name: reward rate, value: 0.5" in card_of(tmp_path, 0.5)
    assert "| RealAI score | `0.7` |\n| saved after" in card_of(tmp_path, 0.7, robot="acrobot")


@pytest.mark.parametrize("scores", [[1], {"episodes": 3}, {"a": {"score": 1.0}, "b": {}}])
def test_damaged_scores_are_named(scores, tmp_path):
    policy = walker(1)
    write_network(tmp_path / "best.safetensors", policy.network, {**policy.metadata, "scores": scores})
    assert "best.safetensors is not there or has no scores" in refusal(write_card, tmp_path)


def test_a_run_has_a_page_with_its_learning_curve(tmp_path):
    for name, score in (("one", 3.0), ("other", 4.0)):
        (tmp_path / name).mkdir()
        card_of(tmp_path / name, score)
        row = {"seed": 0, "frames": 640, "reward": 0.5, "score": score, "mean_length": 6.0}
        (tmp_path / name / "metrics.jsonl").write_text(json.dumps(row))
    runs = str(tmp_path / "one"), str(tmp_path / "other" / "metrics.jsonl")
    for out in ("page.html", "curve.svg"):
        plot_command("curve", runs, out=str(tmp_path / out))
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert re.findall(r"<h3.*?>(.*)</h3>", page) == ["Best policies", "Learning curves"]
    assert re.findall(r"<td>(\d)</td>", page) == ["3", "4"]
    assert "best mean return" in page
    assert "shoulder" not in page.split("<footer>")[1].split("</footer>")[0]
    assert "go with animation" in refusal(plot_command, "curve", runs, out=str(tmp_path / "p.png"), fps=9.0)
    assert "--columns goes" in refusal(plot_command, "curve", runs, out=str(tmp_path / "p.png"), columns=("time",))
    saved(tmp_path / "other" / "best.safetensors", walker(1))
    assert "has no scores: name the folder" in refusal(plot_command, "curve", runs, out=str(tmp_path / "p.html"))
    assert "best mean return" in (tmp_path / "curve.svg").read_text(encoding="utf-8")
    # A continuing task's score is its reward rate.
    row = {"seed": 0, "frames": 640, "reward": 0.5, "score": 0.4, "reward_rate": 0.4, "mean_length": 2000.0}
    labels = [panel.y for panel in curves_figure({"a": [row]}).panels]
    assert labels[-1] == "best reward rate (–)"


def test_of_several_seeds_the_best_ones_last_policy_is_shown(tmp_path):
    card_of(tmp_path, 3.0)  # of seed 3
    for name in ("first", "last-3", "last-4"):
        saved(tmp_path / f"{name}.safetensors", walker(0))
    assert [each.stem for each in policy_files(tmp_path)] == ["first", "best", "last-3"]


class StandIn(types.ModuleType):
    """A module whose functions and objects note what they are called with."""

    def __init__(self, name, calls):
        super().__init__(name)
        self.calls = calls

    def __getattr__(self, name):
        def call(*given, **options):
            self.calls.append((f"{self.__name__}.{name}", given, options))
            return self

        return call


@pytest.mark.skipif(not EXAMPLE.exists(), reason="the examples are only in a checkout")
def test_the_callbacks_of_the_example(tmp_path, monkeypatch):
    calls, filmed = [], []
    for name in ("wandb", "mlflow", "huggingface_hub"):
        monkeypatch.setitem(sys.modules, name, StandIn(name, calls))

    def record(env, folder, name_prefix):
        filmed.append((env.render_mode, name_prefix))
        return env

    monkeypatch.setattr(gymnasium.wrappers, "RecordVideo", record)
    monkeypatch.chdir(tmp_path)
    example = runpy.run_path(str(EXAMPLE))
    model = AREAPO("CartPole-v1", folder=example["FOLDER"], **TINY)
    model.learn(128, [example[name](model) for name in ("wandb", "mlflow", "video", "hub")])
    by_name = {name: [(given, options) for each, given, options in calls if each == name] for name, *_ in calls}
    for name, frames in (("wandb.log", "step"), ("mlflow.log_metrics", "step")):
        assert [options[frames] for _, options in by_name[name]] == [64, 128]
        assert all({"reward", "score", "gain"} <= given[0].keys() for given, _ in by_name[name])
    assert by_name["mlflow.log_params"][0][0][0]["num_envs"] == 2
    assert filmed == [("rgb_array", "frames-64"), ("rgb_array", "frames-128")]
    _, upload = by_name["huggingface_hub.upload_folder"][-1]
    assert Path(upload["folder_path"], "README.md").exists()
