"""Training runs on disk: folders, resuming bit for bit with each option on both back ends, stopping, diverging."""

import contextlib
import dataclasses
import json
import shutil

import jax
import numpy as np
import pytest
from safetensors.numpy import load_file

from policies import load_any_policy, lone_policy
from refusals import refusal
from swingup.areapo.config import Config
from swingup.benchmark.boards import BOARDS
from swingup.controllers.stack.policy import save_controller
from swingup.learner import compiled_backend
from swingup.learner.metrics import read_metrics
from swingup.learner.presets import get_preset
from swingup.learner.problem import make_problem
from swingup.learner.run import Run, resume_run, start_or_resume_run, start_run
from swingup.learner.run_folder import RunFolder
from swingup.learner.run_settings import RunSettings, make_run_settings, run_settings_from_dict, write_run_settings
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD

from .corridors import Corridor
from .environments import Noisy

CONFIG = dataclasses.replace(
    get_preset("pendulum").config,
    num_envs=4, num_steps=16, num_epochs=1, batch_size=64, policy_layers=(8, 8), value_layers=(8, 8),
)  # fmt: skip
"""That of the commands' tests, too, which so find their programs compiled."""
FRAMES = 64
"""Frames of one iteration."""


def test_a_command_names_seeds_that_are_not_the_presets():
    for preset, usual in (("fast", 2), ("pendulum", 1)):
        for seeds in (1, 2):
            command = make_run_settings("acrobot", preset, seeds=seeds).command(64)
            assert (f"--seeds={seeds}" in command) == (seeds != usual)
    assert ", seeds=3)" in make_run_settings(Corridor(), "continuing", seeds=3).command(64)


def test_a_cost_of_another_unit_is_not_the_presets():
    for preset, change, cost in (("continuing", "reset_cost", 10.0), ("continuing", "adaptive_cost", 100.0)):
        assert make_run_settings("Hopper-v5", preset, {"terminations": change}).config.reset_cost == cost
    # The command says the preset's cost where it is meant in the other unit.
    for cost, said in ((10.0, False), (100.0, True)):
        settings = make_run_settings("Hopper-v5", "continuing", {"terminations": "reset_cost", "reset_cost": cost})
        assert ("--reset-cost=100" in settings.command(64)) == said
        assert "--terminations=reset_cost" in settings.command(64)


def test_another_schedule_has_the_length_of_the_presets_run():
    for preset in ("episodes", "continuing"):
        settings = make_run_settings("Hopper-v5", preset, {"schedule": "anneal"})
        assert settings.config.schedule_frames == get_preset(preset).frames
        assert settings.command(64).endswith("--schedule=anneal")


def test_the_module_of_an_id_changes_no_default():
    for name in ("swingup/ContinuingAnt-v0", "swingup/AcrobotSwingup-v0"):
        alone, within = (make_run_settings(each) for each in (name, f"swingup.gym:{name}"))
        assert (within.preset, within.evaluate_every) == (alone.preset, alone.evaluate_every)


SETTINGS = RunSettings(make_problem("acrobot"), "pendulum", 0, 1, 2 * FRAMES, 4 * FRAMES, CONFIG)


@contextlib.contextmanager
def briefly_judged():
    """Rules v2 with 250 steps: policies that were hardly trained score nothing in ten seconds either.

    Whole swing-ups are judged where commands train (``cli/test_training.py``) and where processes are killed.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(BOARDS, "performance", dataclasses.replace(BOARDS["performance"], duration=0.5))
        yield


def run(folder, iterations, settings=SETTINGS):
    training = start_run(settings, folder, iterations * FRAMES)
    return training, list(training.advance())


def assert_same_arrays(one, other):
    left, right = load_file(one), load_file(other)
    assert left.keys() == right.keys()
    for name in left:
        np.testing.assert_array_equal(left[name], right[name], err_msg=f"{other} {name}")


def assert_same_files(one, other):
    assert {path.name for path in one.glob("*.safetensors")} == {path.name for path in other.glob("*.safetensors")}
    names = sorted(path.name for path in (one / "checkpoints").iterdir())
    assert names == sorted(path.name for path in (other / "checkpoints").iterdir())
    for name in [*(f"checkpoints/{name}" for name in names), "best.safetensors", "last.safetensors"]:
        assert_same_arrays(one / name, other / name)


def measured(folder):
    """The metrics without what a clock wrote."""
    clock = ("seconds", "frames_per_second", "longest_pause")
    rows = read_metrics(folder / "metrics.jsonl")
    return [{name: value for name, value in row.items() if name not in clock} for row in rows]


def assert_same_runs(one, other):
    assert_same_files(one, other)
    assert measured(one) == measured(other)


def resumed_after(at, folder, frames, settings=SETTINGS, env=None):
    """A run that was killed when it reported so many frames, and resumed."""
    for report in start_run(settings, folder, frames).advance():
        if report.frames == at:
            break
    return resume_run(folder, env=env)


@pytest.fixture(scope="module", autouse=True)
def brief():
    with briefly_judged():
        yield


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """An uninterrupted run of ten iterations."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    training, reports = run(folder, 10)
    return folder, training, reports


def test_a_run_leaves_its_files_and_policies_say_where_they_come_from(finished):
    folder, training, reports = finished
    assert {path.name for path in folder.iterdir()} == {
        ".lock", "config.json", "metrics.jsonl", "tensorboard", "checkpoints", "best.safetensors",
        "first.safetensors", "last.safetensors", "README.md",
    }  # fmt: skip
    kept = sorted(path.name for path in (folder / "checkpoints").iterdir())
    assert kept == ["000000000512.safetensors", "000000000640.safetensors"]
    rows = read_metrics(folder / "metrics.jsonl")
    assert [report.frames for report in reports] == [row["frames"] for row in rows] == [128, 256, 384, 512, 640]
    assert {"seed", "reward", "gain", "entropy_gain", "entropy", "score", "best_score"} <= rows[0].keys()
    content = json.loads((folder / "config.json").read_text())
    assert (content["robot"], content["frames"], content["config"]["policy_layers"]) == ("acrobot", 640, [8, 8])
    assert list((folder / "tensorboard" / "seed-0").iterdir())
    _, metadata = lone_policy(folder / "last.safetensors", "acrobot")
    start = "swingup train acrobot --preset=pendulum --frames=640 --seed=0 --num-envs=4"
    assert metadata["command"].startswith(start)
    assert (metadata["frames"], metadata["hyperparameters"]["num_envs"]) == (640, 4)
    assert 0.0 <= metadata["scores"]["v2"]["score"] <= training.best_score


@pytest.mark.parametrize("within", [True, False], ids=["within a chunk", "after a report"])
def test_stopped_and_resumed(finished, tmp_path, monkeypatch, within):
    monkeypatch.setattr(compiled_backend, "CALL_WORK", 0.0)  # an iteration a call
    training, frames = start_run(SETTINGS, tmp_path / "part", 10 * FRAMES), []
    train = training.backend.train

    def stopped(state, iterations, stopping):
        if within:
            training.stop()
        return train(state, iterations, stopping)

    monkeypatch.setattr(training.backend, "train", stopped)
    for report in training.advance():
        frames.append(report.frames // FRAMES)
        if frames[-1] == 6:  # where no checkpoint is due
            training.stop()
    assert frames == ([1] if within else [2, 4, 6])
    resumed = resume_run(tmp_path / "part")
    assert resumed.frames == training.frames == frames[-1] * FRAMES
    list(resumed.advance())
    # The best policy may be that of a further evaluation.
    last = "checkpoints/000000000640.safetensors"
    assert_same_arrays(finished[0] / last, tmp_path / "part" / last)


@pytest.mark.parametrize(("at", "kept"), [(None, 0), (6, 4)])
def test_killed_and_resumed(finished, tmp_path, at, kept):
    """Before the first report, or past a checkpoint: metrics since are dropped, also a line that was cut short."""
    folder, part = finished[0], tmp_path / "part"
    if at is None:
        start_run(SETTINGS, part, 10 * FRAMES)
    else:
        resumed_after(at * FRAMES, part, 10 * FRAMES)
        with (part / "metrics.jsonl").open("a") as file:
            file.write('{"seed": 0, "frames": 384, "reward": 0.0}\n{"seed": 0, "fra')
    resumed = resume_run(part)
    assert resumed.frames == kept * FRAMES
    list(resumed.advance())
    assert_same_runs(folder, part)


@pytest.mark.parametrize("every", [pytest.param(1, marks=pytest.mark.slow), 3])
def test_no_more_is_lost_than_was_said(tmp_path, every):
    """Checkpoints fall where they are due, whatever the reports' interval of two iterations."""
    settings = dataclasses.replace(SETTINGS, checkpoint_every=every * FRAMES)
    training, ends = start_run(settings, tmp_path / "whole", 7 * FRAMES), []
    for report in training.advance():
        ends.append(report.frames // FRAMES)
        kept = max(int(path.stem) for path in (tmp_path / "whole" / "checkpoints").glob("*.safetensors"))
        assert report.frames - kept < every * FRAMES
    assert ends == ([1, 2, 3, 4, 5, 6, 7] if every == 1 else [2, 3, 4, 6, 7])
    list(resumed_after(4 * FRAMES, tmp_path / "part", 7 * FRAMES, settings).advance())
    assert_same_runs(tmp_path / "whole", tmp_path / "part")


@pytest.mark.slow
def test_seeds_side_by_side(tmp_path, monkeypatch):
    """Resumed seeds go on bit for bit as well, also where they were killed between two files of the best policy."""
    settings, save = dataclasses.replace(SETTINGS, seed=3, seeds=2), Run._save_policy
    training, _ = run(tmp_path / "r", 4, settings)
    assert [row["seed"] for row in read_metrics(tmp_path / "r" / "metrics.jsonl")] == [3, 4, 3, 4]
    one, other = (load_file(tmp_path / "r" / f"last-{seed}.safetensors") for seed in (3, 4))
    assert not np.array_equal(one["network.trunk.1.weight"], other["network.trunk.1.weight"])
    assert training.frames == 4 * FRAMES

    def killed(self, *arguments):
        if list((tmp_path / "part").glob("best*.safetensors")):
            raise KeyboardInterrupt
        save(self, *arguments)

    monkeypatch.setattr(Run, "_save_policy", killed)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "part", 2, settings)
    monkeypatch.setattr(Run, "_save_policy", save)
    list(resume_run(tmp_path / "part").advance())
    list(resume_run(tmp_path / "part", 4 * FRAMES).advance())
    names = [f"{name}.safetensors" for name in ("best-3", "best-4", "best", "first", "last-3", "last-4")]
    for folder in (tmp_path / "r", tmp_path / "part"):
        assert sorted(path.name for path in folder.glob("*.safetensors")) == names
    for name in names:
        assert_same_arrays(tmp_path / "r" / name, tmp_path / "part" / name)


def test_divergence_keeps_the_last_good_checkpoint(tmp_path):
    training, _ = run(tmp_path / "r", 4)
    checkpoints, good = tmp_path / "r" / "checkpoints", tmp_path / "good.safetensors"
    shutil.copy(checkpoints / "000000000256.safetensors", good)
    # What a NaN in the weights does, without waiting for one.
    resumed = resume_run(tmp_path / "r", 8 * FRAMES)
    state = resumed.progress.state
    broken = dataclasses.replace(state, actor=jax.tree.map(lambda leaf: leaf * np.nan, state.actor))
    resumed.progress = dataclasses.replace(resumed.progress, state=broken)
    assert "metrics are not finite after frame 256" in refusal(list, resumed.advance())
    assert_same_arrays(good, max(checkpoints.iterdir()))
    assert resume_run(tmp_path / "r").frames == training.frames


def test_a_finished_run_has_reached_its_goal_also_where_the_last_chunk_went_beyond_it(finished, tmp_path):
    shutil.copytree(finished[0], tmp_path / "again")
    write_run_settings(tmp_path / "again", SETTINGS, 600)
    again = start_or_resume_run(SETTINGS, tmp_path / "again", 600)
    assert (again.frames, list(again.advance())) == (640, [])
    other = dataclasses.replace(SETTINGS, seed=1)
    assert "a run with other settings" in refusal(start_or_resume_run, other, tmp_path / "again", 600)


def test_a_checkpoint_of_another_configuration(tmp_path):
    folder = tmp_path / "r"
    run(folder, 2)
    content = json.loads((folder / "config.json").read_text())
    for change, message in (({"clip_range": 0.3}, "of another configuration"), ({"policy_layers": [9, 8]}, "9")):
        changed = content | {"config": content["config"] | change}
        (folder / "config.json").write_text(json.dumps(changed))
        assert message in refusal(resume_run, folder)


def test_resuming_keeps_a_better_policy_than_the_checkpoint_knows(tmp_path):
    """The best policy is written between checkpoints: it may be newer than the one a crash leaves."""
    run(tmp_path / "r", 2)
    controller, _ = lone_policy(tmp_path / "r" / "best.safetensors")
    save_controller(tmp_path / "r" / "best.safetensors", controller, {"scores": {"v2": {"score": 0.9}}})
    kept = (tmp_path / "r" / "best.safetensors").read_bytes()
    resumed = resume_run(tmp_path / "r", 4 * FRAMES)
    list(resumed.advance())
    assert resumed.best_score == 0.9
    assert (tmp_path / "r" / "best.safetensors").read_bytes() == kept


def test_a_damaged_checkpoint_is_named_and_nothing_changes(tmp_path):
    run(tmp_path / "r", 4)
    checkpoint = tmp_path / "r" / "checkpoints" / "000000000256.safetensors"
    checkpoint.write_bytes(checkpoint.read_bytes()[:1000])
    config = (tmp_path / "r" / "config.json").read_text()
    assert str(checkpoint) in refusal(resume_run, tmp_path / "r", 999)
    assert (tmp_path / "r" / "config.json").read_text() == config
    # That advice is good.
    checkpoint.unlink()
    assert resume_run(tmp_path / "r").frames == 0


def test_settings_keep_their_plant():
    plant = load_plant("B.0").frictionless()
    settings = make_run_settings("acrobot", plant=plant)
    again = run_settings_from_dict(json.loads(json.dumps(settings.as_dict())))
    assert again == settings
    assert again.problem.plant.name == "B.0, frictionless"
    assert "--plant=B.0 --frictionless" in again.command(64)
    task = again.problem.preset_task("pendulum")
    assert task.parameters == plant.driven("acrobot")
    assert task.dt == pytest.approx(0.01 * 1.08687, abs=1e-7)
    assert run_settings_from_dict(SETTINGS.as_dict()).problem.plant == LEADERBOARD


SMALLER = Config(
    num_envs=2, num_steps=16, num_epochs=1, batch_size=16, policy_layers=(8, 8), value_layers=(8,),
    centre_values=True,
)  # fmt: skip
FEW = 32
"""Frames of one iteration."""
OPTIONS = {
    "activation": {"activation": "tanh"},
    "normalise_rewards": {"normalise_rewards": True},
    "one deviation": {"deviation": "action"},
    "adaptive": {"terminations": "adaptive_cost", "reset_cost": 2.0},
    "schedule": {"schedule": "anneal_entropy", "schedule_frames": 160},
}


@pytest.mark.slow  # by default test_agent has the host's resumption
@pytest.mark.parametrize("env", [Noisy, Corridor()], ids=["host", "compiled"])
@pytest.mark.parametrize("option", OPTIONS)
def test_options_of_networks_rewards_and_schedules_resume(tmp_path, option, env):
    """Environments that the host steps start anew at each checkpoint, also where nobody stopped."""
    config = dataclasses.replace(SMALLER, **OPTIONS[option])
    settings = RunSettings(make_problem(env), "continuing", 3, 1, 64, 128, config, 2)
    list(start_run(settings, tmp_path / "whole", 8 * FEW).advance())
    run = resumed_after(6 * FEW, tmp_path / "part", 8 * FEW, settings, env)  # past the checkpoint at 4
    assert run.frames == 4 * FEW
    list(run.advance())
    assert_same_runs(tmp_path / "whole", tmp_path / "part")
    costs = {row["reset_cost"] for row in measured(tmp_path / "part")}
    assert (len(costs) > 1) == (option == "adaptive")
    loaded, _ = load_any_policy(tmp_path / "whole" / "last.safetensors")
    kept = run.policies()[0].actor
    assert loaded.actor.activation == kept.activation
    # A file does not say that the deviation's weights were not to learn: they are 0.
    for found, expected in zip(jax.tree.leaves(loaded.actor), jax.tree.leaves(kept), strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.slow
def test_the_last_policy_is_on_the_disk_before_its_checkpoint(tmp_path, monkeypatch):
    saved, last = {}, tmp_path / "r" / "last.safetensors"
    monkeypatch.setattr(RunFolder, "save_checkpoint", lambda _, frames, *__: saved.update({frames: last.exists()}))
    run(tmp_path / "r", 2)
    assert saved.pop(0) is False
    assert saved == {128: True}
