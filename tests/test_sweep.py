"""Sweeps and searches: what is planned, what is not repeated, what goes on, what survives a kill."""

import json
import math
import multiprocessing
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from pathlib import Path

import pytest

import swingup
from refusals import refusal
from swingup.cli import main, sweeping
from swingup.cli.sweeping import _alternatives
from swingup.common.errors import SwingupError
from swingup.learner.metrics import read_metrics
from swingup.learner.run import Run, start_run
from swingup.learner.run_folder import RunFolder
from swingup.learner.run_settings import make_run_settings, read_run_settings
from swingup.sweep import runs
from swingup.sweep import search as search_module
from swingup.sweep.runs import Job, executor_for, parse_alternatives, plan_jobs, run_jobs, summarise, train_one
from swingup.sweep.search import trials_of

SIZE_WORDS = ["num_envs=2", "num_steps=16", "num_epochs=1", "batch_size=32", "policy_layers=8", "value_layers=8"]
TINY = {name: parse_alternatives(name, text) for name, text in (word.split("=") for word in SIZE_WORDS)}
INTERVALS = {"evaluate_every": 64, "checkpoint_every": 128, "evaluation_episodes": 1}
BASE = make_run_settings("CartPole-v1", **INTERVALS)


def jobs_of(out, seeds=(0,), frames=256):
    return plan_jobs(BASE, TINY, seeds, out, frames)


def inline(jobs):
    with ThreadPoolExecutor(1) as executor:
        return run_jobs(jobs, executor)


def scores(rows):
    assert not any("error" in row for row in rows)
    return [row["score"] for row in rows]


def error_of(job):
    (row,) = inline([job])
    return row.get("error", "")


def test_a_plan_has_every_combination(tmp_path):
    jobs = plan_jobs(BASE, {"learning_rate": [1e-3, 1e-4], "preset": ["ppo", "continuing"]}, (3, 4), tmp_path, 100)
    assert len({job.folder for job in jobs}) == len(jobs) == 8
    configs = [job.settings for job in jobs]
    assert [(c.config.learning_rate, c.preset, c.seed) for c in configs[:3]] == [
        (1e-3, "ppo", 3), (1e-3, "ppo", 4), (1e-3, "continuing", 3),
    ]  # fmt: skip
    # The preset's hyperparameters come with it.
    assert (configs[0].config.gain, configs[2].config.gain) == ("none", "td")
    assert jobs[0].variant == "learning_rate=0.001 preset=ppo"
    texts = _alternatives(["learning_rate=3e-4", "policy-layers=64x64,8", "learning_rate=5e-4"])
    assert {name: parse_alternatives(name, text) for name, text in texts.items()} == {
        "learning_rate": [3e-4, 5e-4], "policy_layers": [(64, 64), (8,)],
    }  # fmt: skip


def test_no_workers_are_refused():
    assert "workers = 0" in refusal(lambda: executor_for(workers=0).__enter__())


def test_alternatives_are_those_that_the_command_trains(tmp_path):
    changes = {"terminations": "reset_cost"}
    base, alone = (make_run_settings("Hopper-v5", "continuing", each) for each in ({}, changes))
    (job,) = plan_jobs(base, {"terminations": ["reset_cost"]}, (0,), tmp_path, 100)
    assert job.settings.config == alone.config


def test_a_sweep_repeats_nothing_and_resumes(tmp_path):
    jobs = jobs_of(tmp_path, seeds=(0, 1))
    first = inline(jobs)
    assert [row["reward_rate"] for row in first] == [1.0, 1.0]  # CartPole pays 1 a step
    untouched = Path(jobs[1].folder, "last.safetensors")
    written = untouched.stat().st_mtime_ns
    # One run is cut off after its first checkpoint.
    shutil.rmtree(jobs[0].folder)
    list(start_run(jobs[0].settings, jobs[0].folder, 128).advance())
    assert scores(inline(jobs)) == scores(first)
    assert read_metrics(f"{jobs[0].folder}/metrics.jsonl")[-1]["frames"] == 256
    assert untouched.stat().st_mtime_ns == written
    # Without its checkpoints a finished run is read, and no other is trained in its place.
    shutil.rmtree(jobs[0].folder / "checkpoints")
    assert scores(inline(jobs)) == scores(first)
    metrics = jobs[0].folder / "metrics.jsonl"
    metrics.write_text("".join(metrics.read_text().splitlines(keepends=True)[:1]))
    assert "has metrics and no checkpoint: restore" in error_of(jobs[0])
    metrics.unlink()  # killed before its first checkpoint
    assert scores(inline(jobs)) == scores(first)


@pytest.mark.slow
def test_a_shorter_sweep_reports_its_own_length(tmp_path):
    (cut_off,), (short,) = jobs_of(tmp_path, frames=10**9), jobs_of(tmp_path, frames=256)
    run = start_run(cut_off.settings, cut_off.folder, cut_off.frames)
    for report in run.advance():
        if report.frames >= 128:
            run.stop()
    # Not trained on to the goal of the longer sweep.
    expected = inline(jobs_of(tmp_path / "other", frames=256))
    assert scores([train_one(short)]) == scores(expected)
    assert RunFolder(short.folder).newest_frames() == 256
    # A longer run stays; of it the shorter sweep reports its own length, and no length that was not recorded.
    longer = train_one(jobs_of(tmp_path, frames=512)[0])
    assert longer["frames"] == 512
    assert train_one(short)["frames"] == 256
    assert scores([train_one(short)]) == scores(expected)
    assert "stands at 512 already" in error_of(jobs_of(tmp_path, frames=96)[0])


def test_a_run_that_fails_does_not_stop_the_others(tmp_path, monkeypatch):
    jobs, closed, raised = jobs_of(tmp_path, seeds=(0, 1), frames=64), [], OSError(28, "No space left on device")

    def advance(run):
        if run.settings.seed == 0:
            raise raised
        yield from original(run)

    original, close = Run.advance, Run.close
    monkeypatch.setattr(Run, "advance", advance)
    monkeypatch.setattr(Run, "close", lambda run: (closed.append(run), close(run)))
    bad, good = inline(jobs)
    assert (bad, "error" in good) == ({"error": f"{type(raised).__name__}: {raised}"}, False)
    assert [(row["runs"], row["failed"]) for row in summarise(jobs, [bad, good])] == [(1, 1)]
    assert len(closed) == 2


def test_folders_that_are_left_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(runs, "LOCK_SECONDS", 0.0)
    (job,) = jobs_of(tmp_path, frames=64)
    with RunFolder(job.folder).exclusive():
        Path(job.folder, "config.json").write_text("theirs")
        assert "another process trains in" in error_of(job)
    assert Path(job.folder, "config.json").read_text() == "theirs"
    assert error_of(job) == ""
    other = Job("", jobs_of(tmp_path, frames=64, seeds=(5,))[0].settings, job.folder, 64)
    assert "other settings: choose another --out" in error_of(other)
    Path(job.folder, "metrics.jsonl").write_text("")
    assert "remove it to train again" in error_of(job)


@pytest.mark.slow
def test_local_workers_die_alone_and_end_with_an_interrupt():
    futures = []

    def interrupted():
        with executor_for(workers=2) as executor:
            dead, alive = executor.submit(signal.raise_signal, signal.SIGKILL), executor.submit(abs, -3)
            assert alive.result() == 3
            assert "abruptly" in str(dead.exception())
            futures.extend(executor.submit(time.sleep, 600) for _ in range(3))
            while not multiprocessing.active_children():
                time.sleep(0.01)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert all(future.done() for future in futures)
    assert not multiprocessing.active_children()


def workers_of(pid):
    shown = subprocess.run(
        ["ps", "-ww", "-eo", "pid=,ppid=,args="], capture_output=True, text=True, check=True
    ).stdout
    rows = [line.split(None, 2) for line in shown.splitlines()]
    return [int(row[0]) for row in rows if row[1] == str(pid) and "spawn_main" in row[2]]


def is_running(pid):
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.slow
@pytest.mark.usefixtures("own_signals")
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
@pytest.mark.parametrize("search", [False, True])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_command_that_is_killed_takes_its_workers_along_and_goes_on(tmp_path, number, search):
    words = "sweep --env CartPole-v1 --workers 2 --evaluate-every 64 --seeds 2 --checkpoint-every 64 --frames 6400"
    words += " --evaluation-episodes 1 " + ("--trials 2 --set learning_rate=1e-4:1e-2" if search else "--set")
    command = [sys.executable, "-m", "swingup", *words.split(), *SIZE_WORDS, "--out", str(tmp_path)]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    while not any(path.stat().st_size for path in tmp_path.rglob("metrics.jsonl")):
        assert process.poll() is None
        time.sleep(0.05)
    workers = workers_of(process.pid)
    assert workers
    process.send_signal(number)  # to the command alone
    assert process.wait(timeout=30) == (130 if number == signal.SIGINT else -number)
    deadline = time.monotonic() + 5
    while any(map(is_running, workers)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(map(is_running, workers))
    assert list(tmp_path.rglob("checkpoints"))
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr
    found = [row.get("runs", row.get("state")) for row in json.loads(done.stdout)]
    assert found == (["complete", "complete"] if search else [2])


def test_rows_summarise_by_hand():
    # The middle half of 0, 0, 1, 2, 3, 4, 100, 100 is 1, 2, 3, 4.
    each = [100.0, 0.0, 3.0, 1.0, 4.0, 2.0, 0.0, 100.0]
    jobs = [Job("a", BASE, Path(), 1)] * 8
    metrics = [{"score": score, "best_score": score + 1.0, "reward_rate": 2.0} for score in each]
    (row,) = summarise(jobs, metrics)
    assert (row["score"], row["best_score"], row["runs"], row["reward_rate"]) == (2.5, 3.5, 8, 2.0)
    assert row["interval"][0] < 2.5 < row["interval"][1]
    assert math.isnan(row["resets_per_1000_steps"])


# Searches

SPACE = {"learning_rate": "1e-4:1e-2:log", "num_epochs": "1:9", "policy_layers": "8,16x8"}


class Killed(BaseException):
    """Ends the search at once, as SIGKILL does."""


class StandIn:
    """Trains in no time: the score is best at a learning rate of 1e-3. It notes what it trained."""

    def __init__(self, cut_off=None):
        self.trained, self.cut_off = [], cut_off

    def __call__(self, job, report):
        number, settings = trial_of(job), job.settings
        self.trained.append(number)
        if number == self.cut_off:
            raise Killed
        return {"score": -abs(math.log10(settings.config.learning_rate) + 3.0) + settings.seed}


def found(study):
    return [(trial.params, trial.state.name, trial.value) for trial in trials_of(study)]


def trial_of(job):
    return int(job.folder.parent.name.removeprefix("trial-"))


@pytest.fixture
def searched(monkeypatch):
    pytest.importorskip("optuna")

    class Inline(ThreadPoolExecutor):
        """Without threads, so that the end of a run is one of the search; a run that exits is a dead worker."""

        def submit(self, function, *arguments):
            future = Future()
            try:
                future.set_result(function(*arguments))
            except SystemExit:
                future.set_exception(BrokenExecutor())
            return future

    def run(out, trials, train, space=SPACE, **options):
        monkeypatch.setattr(search_module, "train_one", train)
        options = {"frames": 1000, "executor": Inline()} | INTERVALS | options
        return swingup.search("CartPole-v1", space, trials, out, **options)

    return run


def test_the_best_trial_becomes_settings(tmp_path, searched):
    told = []
    study = searched(tmp_path, 4, StandIn(), seed=5, seeds=2, progress=told.append)
    each = [trial.value for trial in study.trials]
    assert sorted(trial.number for trial in told) == list(range(4))
    best = study.best_trial
    assert (best.value, best.number) == (max(each), each.index(max(each)))
    # The score's formula gives the rate back; the seeds 5 and 6 are added to it, in the mean 5.5.
    chosen, command = best.user_attrs["hyperparameters"], best.user_attrs["command"]
    rate = chosen["learning_rate"]
    assert best.value == pytest.approx(5.5 - abs(math.log10(rate) + 3.0))
    assert 1e-4 <= rate <= 1e-2
    assert chosen["policy_layers"] in [[8], [16, 8]]
    assert f"--learning-rate={rate}" in command
    written = json.loads((tmp_path / "best.json").read_text())
    # Optuna's file names folders within the search's, which may be moved.
    where = best.user_attrs["folder"]
    assert (written["command"], written["folder"]) == (command, str(tmp_path / where))
    assert where == f"trial-{best.number}"


@pytest.mark.slow
def test_a_search_that_was_cut_off_goes_on(tmp_path, searched):
    # Eleven trials: after ten Optuna's suggestions follow from the scores.
    first, second = StandIn(cut_off=3), StandIn()
    expected = searched(tmp_path / "whole", 11, StandIn())
    with pytest.raises(Killed):
        searched(tmp_path / "cut", 11, first)
    result = searched(tmp_path / "cut", 11, second)
    # What had ended is not trained again. Optuna's trial 4 continues the interrupted one, in the folder of trial 3.
    assert (first.trained, second.trained) == ([0, 1, 2, 3], [3, *range(5, 12)])
    assert found(result) == found(expected)
    assert json.loads((tmp_path / "cut" / "best.json").read_text())["trial"] == result.best_trial.number
    # More trials continue the same search.
    assert found(searched(tmp_path / "cut", 12, second))[:11] == found(expected)
    assert second.trained[-1] == 12


@pytest.mark.parametrize("pruning", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_trials_below_the_median_are_cut_short(tmp_path, searched, pruning):
    """Five trials first; then one that is worse half way, and one that is better."""
    cut_short = []

    def train(job, report):
        middle = {5: 0.0, 6: 2.0}.get(trial_of(job), 1.0)
        # A tenth is 100 frames; its first score counts, and the end of a run does not.
        for frames, score in ((99, -9.0), (500, middle), (550, -9.0), (1000, -9.0)):
            try:
                report({"frames": frames, "score": score})
            except BaseException:
                cut_short.append((trial_of(job), frames))
                raise
        return {"score": 3.0}

    study = searched(tmp_path, 7, train, pruning=pruning)
    sixth = ("PRUNED", 0.0) if pruning else ("COMPLETE", 3.0)
    assert not any(trial.user_attrs.get("error") for trial in study.trials)
    assert cut_short == ([(5, 500)] if pruning else [])
    expected = [("COMPLETE", 3.0)] * 5 + [sixth, ("COMPLETE", 3.0)]
    assert [(trial.state.name, trial.value) for trial in study.trials] == expected


def test_trials_that_fail(tmp_path, searched):
    def train(job, report):
        if trial_of(job) == 2:
            raise SystemExit
        if trial_of(job):
            raise SwingupError("training diverged")
        return {"score": None}

    study = searched(tmp_path, 3, train)
    errors = [trial.user_attrs.get("error") for trial in study.trials]
    without = "scores = [None]: every run needs one, so let it evaluate its policies"
    assert errors == [without, "training diverged", None]
    assert not (tmp_path / "best.json").exists()
    # A trial whose worker died has not ended, and the next call continues it in its folder.
    resumed = StandIn()
    assert [state for _, state, _ in found(study)] == ["FAIL", "FAIL", "RUNNING"]
    assert [state for _, state, _ in found(searched(tmp_path, 3, resumed))] == ["FAIL", "FAIL", "COMPLETE"]
    assert resumed.trained == [2]


def test_a_preset_gets_the_sizes_of_a_stream_and_what_has_no_effect_is_refused(tmp_path):
    stream = make_run_settings("Pendulum-v1", resets="never")
    jobs = plan_jobs(stream, {"preset": ["continuing", "episodes"]}, [0], tmp_path)
    assert [(job.settings.config.num_envs, job.settings.config.num_steps) for job in jobs] == [(1, 2000)] * 2
    grid = {"reset_cost": [1.0, 10.0]}
    assert "reset_cost has no effect with terminations = 'end'" in refusal(plan_jobs, BASE, grid, [0], tmp_path)
    assert len(plan_jobs(BASE, grid | {"terminations": ["end", "reset_cost"]}, [0], tmp_path)) == 4
    # Both presets end the return at an end; continuing charges for one.
    vain, one = ({"preset": ["ppo", other]} | grid for other in ("episodes", "continuing"))
    assert "reset_cost has no effect" in refusal(plan_jobs, BASE, vain, [0], tmp_path)
    assert len(plan_jobs(BASE, one, [0], tmp_path)) == 4
    fixed = make_run_settings("Pendulum-v1", "ppo", {"learning_rate": 1e-4})
    assert "learning_rate cannot stay fixed" in refusal(plan_jobs, fixed, one, [0], tmp_path)


def test_searches_that_are_refused(tmp_path, searched, monkeypatch):
    def refused(named, space=SPACE, **options):
        assert named in refusal(searched, tmp_path, 2, StandIn(), space, **options)

    searched(tmp_path, 1, StandIn())
    refused("temperature = 0.0: put it into the space", temperature=0.0)
    refused("setting 'eval_every'", eval_every=9)
    refused("a search with another frames, space", SPACE | {"num_epochs": "1:8"}, frames=999)
    with RunFolder(tmp_path).exclusive():
        refused("another process trains in")
    storage = tmp_path / "study.db"
    whole = storage.read_bytes()
    for content in (b"no database", whole[:5000], whole.replace(b"CREATE TABLE", b"CREATE TABEL")):
        storage.write_bytes(content)
        refused("study.db")
    monkeypatch.setitem(sys.modules, "optuna", None)
    refused("a search needs Optuna")


@pytest.mark.slow
def test_the_best_settings_of_the_commands_search_train_the_same_run(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    words = ["sweep", "--env", "CartPole-v1", "--frames", "256", "--evaluate-every", "64", "--workers", "2"]
    words += ["--evaluation-episodes", "1", "--set", *SIZE_WORDS, "learning_rate=1e-4:1e-2:log", "--trials", "2"]
    assert main(words) == 0
    assert "2 trials complete" in capsys.readouterr().out
    best = json.loads((tmp_path / "searches" / "CartPole-v1-episodes" / "best.json").read_text())
    assert main([*shlex.split(best["command"])[1:], "--out", "again"]) == 0
    again, seed = tmp_path / "again", Path(best["folder"]) / "seed-0"
    assert read_run_settings(again)[0] == read_run_settings(seed)[0]
    rows = [read_metrics(run / "metrics.jsonl") for run in (again, seed)]
    assert [row["score"] for row in rows[0]] == [row["score"] for row in rows[1]]


# Dask


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_dask_worker_is_killed_and_no_run_is_lost(tmp_path):
    distributed, killed = pytest.importorskip("distributed"), []

    def kill_one(job, row):
        if not killed:  # the others are under way or waiting
            killed.append(cluster.workers[0].pid)
            os.kill(killed[0], signal.SIGKILL)

    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options, local_directory=str(tmp_path)) as cluster:
        with executor_for(cluster.scheduler_address) as executor:
            rows = run_jobs(jobs_of(tmp_path / "dask", (0, 1, 2, 3), 128 * 6), executor, kill_one)
        space = dict(each.split("=") for each in [*SIZE_WORDS, "learning_rate=1e-4:1e-2:log"])
        with executor_for(cluster.scheduler_address) as executor:
            given = {"frames": 256, "executor": executor, **INTERVALS}
            study = swingup.search("CartPole-v1", space, 2, tmp_path / "s", **given)
    assert killed
    assert scores(rows) == scores(inline(jobs_of(tmp_path / "here", (0, 1, 2, 3), 128 * 6)))
    assert [trial.state.name for trial in study.trials] == ["COMPLETE", "COMPLETE"]


def test_what_an_executor_raises_is_an_outcome(tmp_path, monkeypatch):
    raised = Future()
    raised.set_exception(KeyError("killed"))  # as Dask does with a job that has killed several workers
    monkeypatch.setattr(ThreadPoolExecutor, "submit", lambda *_: raised)
    assert inline(jobs_of(tmp_path)) == [{"error": "KeyError: 'killed'"}]


def test_a_sweep_of_one_seed_has_no_interval_and_a_plain_folder(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sweeping, "run_jobs", lambda jobs, pool, progress: [{"score": 84.2, "best_score": 90.0}])
    assert main(["sweep", "--env", "gymnasium:CartPole-v1", "--seeds", "1"]) == 0
    assert re.search(r"84\.2 +– +90", capsys.readouterr().out)
    (row,) = json.loads((tmp_path / "sweeps" / "gymnasium-CartPole-v1-episodes" / "sweep.json").read_text())
    assert (row["score"], row["interval"]) == (84.2, None)
