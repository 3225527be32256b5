"""What is measured: rows and events on disk, rates by hand, a full disk; and pendulums on their tasks' plants."""

import subprocess
import sys
import types

import equinox as eqx
import gymnasium
import jax.numpy as jnp
import pytest

from policies import new_actor
from swingup.cli.training import _show_rates, figures
from swingup.controllers.stack.policy import Policy
from swingup.learner.compiled_backend import SwingUpEvaluator
from swingup.learner.metrics import Evaluation, MetricsWriter, Row, TrainingMetrics, read_metrics, step_time
from swingup.learner.progress import TrainingReport
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, ROBOTS
from swingup.policy.pendulum import policy_plant, read_pendulum_policy
from swingup.policy.shipped import load_policy
from swingup.refine.recipe import run_recipe
from swingup.tasks.presets import smooth_task

from .environments import Stairs

FULL = """
import json, pathlib, resource, sys, tempfile
from swingup.common.errors import SwingupError
from swingup.learner.metrics import MetricsWriter

# The rows' file is the first to be full with long words, the events' with short numbers.
for row in ({"word": "x" * 300}, {chr(97 + i) * 2: 1 for i in range(20)}):
    for limit in (0, 1, 40, 100, 1_000, 5_000, 8_192, 20_000):
        try:
            with MetricsWriter(pathlib.Path(tempfile.mkdtemp(dir=sys.argv[1]))) as writer:
                resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
                for frames in range(2000):
                    writer.write([{"seed": 0, "frames": frames, **row}])
                    if frames % 100 == 99:
                        writer.sync()
        except SwingupError as error:
            print(error)
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
"""


def test_a_full_disk_neither_hangs_nor_hides_its_error(tmp_path):
    command = [sys.executable, "-W", "error", "-X", "dev", "-c", FULL, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert len(lines) == 16
    assert all(line.startswith("cannot write metrics in ") and "File too large" in line for line in lines)


def test_tensorboard_reads_the_events(tmp_path):
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    for start, end in ((0, 30), (20, 40)):  # cut off after 30 frames, resumed at 20
        with MetricsWriter(tmp_path, after_frames=start) as writer:
            for frames in range(start + 10, end + 10, 10):
                writer.write([{"seed": 3, "frames": frames, "score": frames + start / 100, "none": None}])
    assert [row["score"] for row in read_metrics(tmp_path / "metrics.jsonl")] == [10.0, 20.0, 30.2, 40.2]
    events = accumulator.EventAccumulator(str(tmp_path / "tensorboard" / "seed-3")).Reload()
    assert events.Tags()["scalars"] == ["score"]
    shown = [(event.step, round(event.value, 1)) for event in events.Scalars("score")]
    assert shown == [(10, 10.0), (20, 20.0), (30, 30.2), (40, 40.2)]


def row(seed, score, reward):
    means = types.SimpleNamespace(reward=reward, gain=0.5, termination_rate=0.002)
    return Row(seed, 64, 1.0, 64.0, TrainingMetrics(means), Evaluation(score, reward_rate=reward), score)


def test_a_report_shows_the_seed_that_is_best():
    report = TrainingReport(64, 64.0, (row(0, 1.0, 9.0), row(1, 2.0, 3.0)), 2.5)
    assert (report.best.seed, report.score) == (1, 2.0)
    for text in (str(report), figures(report, "")):
        assert ("reward 3" in text, "score 2" in text, "9" in text) == (True, True, False)
    # Before an episode ended there is no score, and the reward rate decides.
    early = TrainingReport(64, 64.0, (row(0, None, 1.0), row(1, None, 3.0)), None)
    assert (early.best.seed, early.score) == (1, None)
    for text in (str(early), figures(early, "")):
        assert "score –" in text
        assert "nan" not in text


def test_the_table_of_rates_is_that_of_the_best_seed_and_says_so(tmp_path, capsys):
    both = [(frames, seed) for frames in (100, 200) for seed in (3, 4)]
    rows = [{"seed": seed, "frames": frames, "reward": seed + frames / 1e3} for frames, seed in both]
    with MetricsWriter(tmp_path) as writer:
        writer.write(row | {"termination_rate": 0.0, "reward_rate": 7.0} for row in rows)
    settings, progress = (
        types.SimpleNamespace(seed=3, seeds=2, evaluation_episodes=1),
        types.SimpleNamespace(best_seed=1),
    )
    _show_rates(types.SimpleNamespace(folder=tmp_path, settings=settings, progress=progress))
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["seed", "4,", "the", "best", "of", "2"] in lines
    assert [line[:2] for line in lines if line[:1] in (["100"], ["200"])] == [["100", "4.1"], ["200", "4.2"]]


def test_the_time_of_a_step():
    def lasting(seconds, of=Stairs):
        return type("Timed", (of,), {"dt": seconds})

    assert step_time(lasting(0.01)()) == step_time(gymnasium.wrappers.TimeLimit(lasting(0.01)(), 9)) == 0.01
    # A wrapper that repeats actions says so.
    assert step_time(lasting(0.04, gymnasium.Wrapper)(lasting(0.01)())) == 0.04
    nonsense = (0.0, float("inf"), "often", lambda: 0.01, property(lambda _: 1 / 0))
    assert [step_time(env()) for env in (Stairs, *map(lasting, nonsense))] == [None] * 6


def test_the_swing_up_is_judged_on_the_tasks_plant(either_robot, similar):
    task = smooth_task(either_robot)
    twin = smooth_task(either_robot, similar(task.parameters))
    actor = new_actor(task.observation_size, (4,))
    pushing = eqx.tree_at(lambda a: a.mean_head.bias, actor, jnp.array([20.0]))
    plants = (LEADERBOARD, load_plant(similar(task.parameters)))
    results = [
        SwingUpEvaluator(each, plant).evaluate(Policy((each.observation,), pushing))
        for each, plant in zip((task, twin), plants, strict=True)
    ]
    # A constant torque of 6 N m, and of 0.025 times that: Σ u² Δt over 4,999 rows of 0.002 s.
    costs = [result.criteria.torque_cost for result in results]
    assert costs == pytest.approx([36 * 9.998, 0.15**2 * 9.998], rel=1e-6)


@pytest.mark.parametrize("name", ["leaderboard", "C.0"])
def test_training_and_refining_write_their_plant(tmp_path, name):
    robot, plant = ROBOTS["acrobot"], load_plant(name)
    task = smooth_task(robot, plant)
    policy = Policy((task.observation,), new_actor(task.observation_size, (4,)))
    SwingUpEvaluator(task, plant).save(tmp_path / "p.safetensors", policy, {})
    trained = read_pendulum_policy(tmp_path / "p.safetensors")
    # Without stages nothing is refined, but the plant is named.
    refined = run_recipe(load_policy("ar-eapo", "acrobot"), (), plant=plant)
    assert trained.plant == refined.plant == policy_plant(plant, robot)
    assert (trained.plant.name, trained.torque_limit, trained.plant.cf1) == (name, 6.0, plant.cf1)
