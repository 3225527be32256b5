"""Sweeps: what is planned, what is not repeated, what resumes, what survives the loss of a worker."""

import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest

from sweep_jobs import end_of_worker
from swingup.areapo.config import Config
from swingup.areapo.words import format_value
from swingup.benchmark.interval import bootstrap_interval, interquartile_mean
from swingup.cli import main
from swingup.cli.sweeping import rows_as_json, show_variants
from swingup.common.errors import SwingupError
from swingup.learner.metrics import read_metrics
from swingup.learner.run import Run
from swingup.learner.run_folder import RunFolder
from swingup.learner.run_settings import run_settings_from_dict
from swingup.learner.start import start_run
from swingup.sweep.executors import executor_for
from swingup.sweep.jobs import Job, JobOutcome, run_jobs, train_one
from swingup.sweep.plan import parse_grid, plan_jobs
from swingup.sweep.summary import summarise_variants

SIZES = {"num_envs": [2], "num_steps": [16], "num_epochs": [1], "batch_size": [32]}
TINY = SIZES | {"policy_layers": [(8,)], "value_layers": [(8,)]}
BASE = {
    "robot": None, "env": "CartPole-v1", "preset": "mujoco", "evaluate_every": 64, "checkpoint_every": 128,
    "evaluation_episodes": 1,
}  # fmt: skip


def jobs_of(out, seeds=(0,), frames=256, **grid):
    return plan_jobs(BASE, TINY | grid, seeds, out, frames)


def inline(jobs):
    with ThreadPoolExecutor(1) as executor:
        return run_jobs(jobs, executor)


def test_a_plan_has_every_combination(tmp_path):
    jobs = plan_jobs(BASE, {"learning_rate": [1e-3, 1e-4], "preset": ["ppo", "mujoco"]}, (3, 4), tmp_path, 100)
    assert len({job.folder for job in jobs}) == len(jobs) == 8
    configs = [run_settings_from_dict(job.settings) for job in jobs]
    assert [(c.config.learning_rate, c.preset, c.seed) for c in configs[:3]] == [
        (1e-3, "ppo", 3), (1e-3, "ppo", 4), (1e-3, "mujoco", 3),
    ]  # fmt: skip
    # The preset's hyperparameters come with it.
    assert (configs[0].config.average_reward, configs[2].config.average_reward) == (False, True)
    assert jobs[0].variant == "learning_rate=0.001 preset=ppo"


@pytest.mark.parametrize(
    ("grid", "frames", "message"),
    [
        (
            {"preset": ["mujoco", "default"]},
            None,
            r"\(mujoco 1,000,000, default 12,000,000 frames\): give --frames",
        ),
        ({"temperature": [1.0, 1.0]}, 64, "temperature=1.0/seed-0 would hold 2 runs: give each alternative"),
        (
            {"learning_rate": [1e-3 * step for step in range(1, 10_002)]},
            64,
            "this sweep has 10,001 runs, of at most",
        ),
        ({}, 0, "frames = 0: use a whole number of at least 1"),
    ],
)
def test_plans_that_are_refused(tmp_path, grid, frames, message):
    with pytest.raises(SwingupError, match=message):
        plan_jobs(BASE, grid, (0,), tmp_path, frames)


def test_words_become_values():
    words = ["learning_rate=3e-4", "policy-layers=64x64,8", "popart=true", "num_envs=4", "preset=ppo"]
    words += ["adaptive-reset-cost=auto,false"]
    grid = parse_grid([*words, "learning_rate=5e-4"])
    assert grid == {
        "learning_rate": [3e-4, 5e-4], "policy_layers": [(64, 64), (8,)], "popart": [True], "num_envs": [4],
        "preset": ["ppo"], "adaptive_reset_cost": ["auto", False],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("learning_rate", "write NAME=VALUE,VALUE"),
        ("learnig_rate=3", "unknown hyperparameter 'learnig_rate'; did you mean learning_rate?"),
        ("presett=ppo", "did you mean preset?"),
        ("rate=3", "--set 'rate=3': unknown hyperparameter 'rate'"),
        ("learning_rate=fast", "learning_rate = 'fast': use a number"),
        ("popart=perhaps", "popart = 'perhaps': use True or False"),
        ("policy_layers=64-64", "policy_layers = '64-64': use integers such as"),
    ],
)
def test_bad_words(words, message):
    with pytest.raises(SwingupError, match=message):
        parse_grid([words])


def test_a_sweep_repeats_nothing_and_resumes(tmp_path):
    jobs = jobs_of(tmp_path, seeds=(0, 1))
    first = inline(jobs)
    assert all(outcome.reward_rate == 1.0 for outcome in first)  # CartPole pays 1 a step
    assert [outcome.error for outcome in first] == ["", ""]
    files = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("last.safetensors")}
    assert len(files) == 2
    # One run is cut off after its first checkpoint, one killed before it had any.
    cut = start_run(run_settings_from_dict(jobs[0].settings), tmp_path / "cut", 128)
    list(cut.advance())
    shutil.rmtree(jobs[0].folder)
    shutil.copytree(tmp_path / "cut", jobs[0].folder)
    again = inline(jobs)
    assert [(o.score, o.best_score) for o in again] == [(o.score, o.best_score) for o in first]
    assert read_metrics(f"{jobs[0].folder}/metrics.jsonl")[-1]["frames"] == 256
    untouched = f"{jobs[1].folder}/last.safetensors"
    assert all(path.stat().st_mtime_ns == time_ for path, time_ in files.items() if str(path) == untouched)
    for path in (tmp_path / "cut" / "checkpoints").iterdir():
        path.unlink()
    assert train_one(Job("", jobs[0].settings, str(tmp_path / "cut"), 64)).error == ""


def test_a_run_that_fails_does_not_stop_the_others(tmp_path):
    jobs = jobs_of(tmp_path, learning_rate=[1e-3, 1e12], frames=64)
    (tmp_path / "full").mkdir()
    good, bad = inline(jobs)
    assert good.error == ""
    assert "diverged" in bad.error
    rows = summarise_variants([good, bad])
    assert [(row.runs, row.failed) for row in rows] == [(1, 0), (0, 1)]


@pytest.mark.parametrize("raised", [ValueError("no"), OSError(28, "No space left on device")])
def test_whatever_a_run_raises_is_its_outcome(tmp_path, monkeypatch, raised):
    jobs, closed = jobs_of(tmp_path, seeds=(0, 1), frames=64), []

    def advance(run):
        if run.settings.seed == 0:
            raise raised
        yield from original(run)

    original, close = Run.advance, Run.close
    monkeypatch.setattr(Run, "advance", advance)
    monkeypatch.setattr(Run, "close", lambda run: (closed.append(run), close(run)))
    bad, good = inline(jobs)
    assert (bad.error, good.error) == (f"{type(raised).__name__}: {raised}", "")
    assert len(closed) == 2


def test_what_an_executor_raises_is_an_outcome(tmp_path):
    class GivesUp(ThreadPoolExecutor):
        def submit(self, function, job):  # as Dask does with a job that has killed several workers
            future = Future()
            future.set_exception(KeyError("killed"))
            return future

    with GivesUp(1) as executor:
        (outcome,) = run_jobs(jobs_of(tmp_path), executor)
    assert outcome.error == "KeyError: 'killed'"
    assert outcome.score != outcome.score


def test_a_finished_run_without_metrics_says_so(tmp_path):
    (job,) = jobs_of(tmp_path, frames=64)
    inline([job])
    (Path(job.folder) / "metrics.jsonl").write_text("")
    assert "holds no metrics: remove it" in train_one(job).error


def test_a_folder_that_another_process_begins_is_left_alone(tmp_path):
    (job,) = jobs_of(tmp_path, frames=64)
    with RunFolder(job.folder).exclusive():
        (Path(job.folder) / "config.json").write_text("theirs")
        assert "another process trains in" in train_one(job).error
    assert (Path(job.folder) / "config.json").read_text() == "theirs"
    assert train_one(job).error == ""


def test_an_interrupted_sweep_begins_nothing_more():
    futures = []

    def interrupted():
        with executor_for(None, 1) as executor:
            futures.extend(executor.submit(time.sleep, 600) for _ in range(4))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert all(future.done() for future in futures)
    assert not multiprocessing.active_children()


def test_a_local_worker_that_is_killed_takes_nothing_with_it(tmp_path):
    with executor_for(None, 2) as executor:
        once, always, never = (
            executor.submit(end_of_worker, tmp_path / str(deaths), deaths) for deaths in (1, 9, 0)
        )
        assert (once.result(), never.result()) == (1, 0)
        with pytest.raises(SwingupError, match="its worker died 2 times"):
            always.result()
        # The processes that are left take further jobs.
        assert executor.submit(abs, -3).result() == 3
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_a_killed_run_resumes_in_a_fresh_worker_and_the_sweep_goes_on(tmp_path):
    jobs, killed = jobs_of(tmp_path / "killed", seeds=(0, 1, 2), frames=128 * 40), []

    def kill_the_worker():
        while not list(Path(jobs[0].folder).glob("checkpoints/000000000128.safetensors")):
            time.sleep(0.01)
        (worker,) = multiprocessing.active_children()
        killed.append(worker.pid)
        os.kill(worker.pid, signal.SIGKILL)

    with executor_for(None, 1) as executor:
        killer = threading.Thread(target=kill_the_worker)
        killer.start()
        outcomes = run_jobs(jobs, executor)
        killer.join()
    assert len(killed) == 1
    assert [outcome.error for outcome in outcomes] == [""] * 3
    expected = inline(jobs_of(tmp_path / "here", seeds=(0, 1, 2), frames=128 * 40))
    assert [outcome.score for outcome in outcomes] == [outcome.score for outcome in expected]


@pytest.mark.slow
def test_interrupted_workers_save_their_runs(tmp_path):
    words = [
        "--env",
        "CartPole-v1",
        "--seeds",
        "3",
        "--workers",
        "1",
        "--frames",
        "100000000",
        "--set",
        "learning_rate=0.001",
    ]
    words += ["--set", *SIZE_WORDS, "--evaluate-every", "64", "--out", str(tmp_path / "s")]
    process = subprocess.Popen([sys.executable, "-m", "swingup", "sweep", *words])
    deadline = time.monotonic() + 120
    while not any(path.stat().st_size for path in tmp_path.rglob("metrics.jsonl")) and time.monotonic() < deadline:
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)  # to the command alone, which tells its workers
    assert process.wait(timeout=60) == 130
    (metrics,) = tmp_path.rglob("metrics.jsonl")
    frames = read_metrics(metrics)[-1]["frames"]
    assert (metrics.parent / "checkpoints" / f"{frames:012d}.safetensors").exists()


def test_a_folder_of_other_settings_is_left_alone(tmp_path):
    job = jobs_of(tmp_path, frames=64)[0]
    inline([job])
    other = Job("", jobs_of(tmp_path, frames=64, seeds=(5,))[0].settings, job.folder, 64)
    assert "other settings: choose another --out" in train_one(other).error


def test_rows_summarise_by_hand():
    jobs = [Job("a", {"seed": seed}, "", 1) for seed in range(8)]
    # The middle half of 0, 0, 1, 2, 3, 4, 100, 100 is 1, 2, 3, 4.
    scores = [100.0, 0.0, 3.0, 1.0, 4.0, 2.0, 0.0, 100.0]
    (row,) = summarise_variants(
        [JobOutcome(job, score, score + 1.0) for job, score in zip(jobs, scores, strict=True)]
    )
    assert (row.score, row.best, row.runs) == (2.5, 3.5, 8)
    assert row.interval[0] < 2.5 < row.interval[1]


def test_rates_of_runs_that_lack_some_are_not_those_of_the_others(capsys):
    job = Job("a", {"seed": 0}, "", 1)
    outcomes = [JobOutcome(job, 1.0, 1.0, reward_rate=2.0, resets_per_1000_steps=resets) for resets in (0.5, 1.5)]
    (row,) = summarise_variants(outcomes)
    assert (row.reward_rate, row.resets_per_1000_steps) == (2.0, 1.0)
    (lacking,) = summarise_variants([*outcomes, JobOutcome(job, 1.0, 1.0)])  # read from a file of an older version
    show_variants([row, lacking])
    text = capsys.readouterr().out
    assert "Reward" in text
    cells = [line.split() for line in text.splitlines()]
    assert [line[-2:] for line in cells if line[:1] == ["a"]] == [["2", "1"], ["–", "–"]]
    assert json.loads(rows_as_json([lacking]))[0]["reward_rate"] is None
    show_variants([lacking])
    assert "Reward" not in capsys.readouterr().out


def test_intervals():
    assert interquartile_mean([5.0]) == 5.0
    assert interquartile_mean([1.0, 2.0, 9.0]) == 4.0
    assert bootstrap_interval([3.0, 3.0, 3.0]) == (3.0, 3.0)
    # Of a mean of many values the interval is ±1.96 σ / sqrt(n); that of the middle half of a uniform
    # distribution on [0, 1] is known to be close to ±1.96 · 0.289 · 1.09 / sqrt(n): here ±0.031 for n = 400.
    low, high = bootstrap_interval([(i + 0.5) / 400 for i in range(400)], 2000)
    assert (low + high) / 2 == pytest.approx(0.5, abs=0.01)
    assert (high - low) / 2 == pytest.approx(0.031, rel=0.3)


SIZE_WORDS = [f"{name}={format_value(values[0])}" for name, values in TINY.items()]
WORDS = ["--set", "learning_rate=0.001,0.0001", "--set", *SIZE_WORDS]
"""One option names several; given again, it adds to them."""


@pytest.mark.slow
def test_the_command_on_local_processes(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    common = [
        "sweep",
        "--env",
        "CartPole-v1",
        "--seeds",
        "2",
        "--frames",
        "64",
        "--evaluation-episodes",
        "1",
        *WORDS,
    ]
    assert main([*common, "--workers", "1", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["runs"] for row in rows] == [2, 2]
    assert rows[0]["variant"].startswith("learning_rate=0.001 num_envs=2")
    assert json.loads((tmp_path / "sweeps/CartPole-v1-mujoco/sweep.json").read_text()) == rows


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("sweep", "robot = None and env = None: give one of the two"),
        ("sweep acrobot --seeds 2147483648", "this sweep has 2,147,483,648 runs"),
        ("sweep acrobot --seeds 0", "seeds = 0: use a whole number from 1"),
        ("sweep acrobot --set batch_size=1000", "batch_size = 1000 does not divide"),
        ("sweep acrobot --set gru_width=8 shared_trunk=true", "gru_width = 8 does not go with the acrobot, whose"),
        ("sweep acrobot --workers 0", "workers = 0: use a whole number from 1"),
    ],
)
def test_bad_sweeps(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments.split()) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.fixture
def cluster(tmp_path):
    """A Dask scheduler and two workers on this machine: its address and the workers' processes."""
    pytest.importorskip("distributed")
    file = tmp_path / "scheduler.json"
    python = [sys.executable, "-m", "dask"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    common = ["--scheduler-file", str(file), "--no-dashboard"]
    scheduler = [*python, "scheduler", "--host", "tcp://127.0.0.1", "--port", "0", *common]
    worker = [*python, "worker", "--nthreads", "1", "--no-nanny", "--host", "127.0.0.1", *common]
    with subprocess.Popen(scheduler, **quiet) as one:
        workers = [subprocess.Popen(worker, cwd=tmp_path, **quiet) for _ in range(2)]
        deadline = time.monotonic() + 60
        while not file.exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        yield json.loads(file.read_text())["address"], workers
        for process in (*workers, one):
            process.kill()
            process.wait()


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_dask_worker_is_killed_and_no_run_is_lost(cluster, tmp_path):
    address, workers = cluster
    jobs = jobs_of(tmp_path / "dask", seeds=(0, 1, 2, 3), frames=128 * 6)
    killed = []

    def kill_one(outcome):
        if not killed:  # the others are under way or waiting
            killed.append(workers[0].pid)
            workers[0].kill()

    with executor_for(address, None) as executor:
        outcomes = run_jobs(jobs, executor, kill_one)
    assert killed
    assert [outcome.error for outcome in outcomes] == [""] * 4
    expected = inline(jobs_of(tmp_path / "here", seeds=(0, 1, 2, 3), frames=128 * 6))
    assert [outcome.score for outcome in outcomes] == [outcome.score for outcome in expected]


def test_no_scheduler_there(monkeypatch):
    distributed = pytest.importorskip("distributed")
    patient = distributed.Client
    monkeypatch.setattr(distributed, "Client", lambda address, timeout: patient(address, timeout=timeout / 10))
    with (
        pytest.raises(SwingupError, match="no Dask scheduler answers"),
        executor_for("tcp://127.0.0.1:1", None),
    ):
        pass


def test_settings_travel(tmp_path):
    """A job's settings are JSON values, from which the same settings come back."""
    job = jobs_of(tmp_path)[0]
    settings = run_settings_from_dict(json.loads(json.dumps(job.settings)))
    assert settings.as_dict() == job.settings
    assert settings.config.policy_layers == (8,)
    assert isinstance(settings.config, Config)
