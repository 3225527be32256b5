"""Searches: what varies, what Optuna is told, what a search that was cut off goes on with."""

import json
import math
import re
import shlex
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import swingup
from swingup.areapo.config import config_from_dict
from swingup.cli import main
from swingup.common.errors import SwingupError
from swingup.learner.metrics import read_metrics
from swingup.learner.run_folder import RunFolder
from swingup.learner.run_settings import read_run_settings, run_settings_from_dict
from swingup.sweep.executors import workers_for
from swingup.sweep.jobs import JobOutcome, is_pruned, prune, train_one
from swingup.sweep.search import run_search
from swingup.sweep.search_plan import plan_search
from swingup.sweep.space import Range, as_words, check_space, parse_space
from swingup.sweep.study import STUDY_FILE
from swingup.sweep.trials import rung_scores

pytest.importorskip("optuna")

BASE = {
    "robot": None, "env": "CartPole-v1", "preset": "mujoco", "evaluate_every": 64, "checkpoint_every": 128,
    "evaluation_episodes": 1,
}  # fmt: skip
SPACE = {"learning_rate": Range(1e-4, 1e-2, log=True), "num_epochs": Range(1, 9), "policy_layers": [(8,), (16, 8)]}
SIZES = ["num_envs=2", "num_steps=16", "batch_size=32", "policy_layers=8", "value_layers=8"]


def settings_of(job):
    return run_settings_from_dict(job.settings)


def place_of(job):
    return int(Path(job.folder).parent.name.removeprefix("trial-"))


class StandIn:
    """Trains in no time: the score is best at a learning rate of 1e-3. It notes what it trained."""

    def __init__(self, cut_off=None):
        self.trained, self.cut_off = [], cut_off

    def __call__(self, job):
        self.trained.append(place_of(job))
        score = -abs(math.log10(settings_of(job).config.learning_rate) + 3.0) + settings_of(job).seed
        write_rows(job, [(job.frames, score)])
        if place_of(job) == self.cut_off:
            raise KeyboardInterrupt
        return JobOutcome(job, score, score)


def write_rows(job, rows):
    folder = Path(job.folder)
    folder.mkdir(parents=True, exist_ok=True)
    lines = [json.dumps({"seed": 0, "frames": frames, "score": score}) + "\n" for frames, score in rows]
    (folder / "metrics.jsonl").write_text("".join(lines))


def plan_of(out, space=SPACE, frames=1000, **options):
    return plan_search(BASE, space, out, frames, **options)


def searched(plan, trials, train, **options):
    with ThreadPoolExecutor(4) as executor:
        return run_search(plan, trials, executor, train=train, poll=0.01, **options)


def test_words_become_a_space():
    words = ["learning-rate=1e-4:1e-2:log", "num_epochs=2:20", "policy_layers=64x64,8", "preset=ppo,mujoco"]
    space = parse_space([*words, "policy_layers=16"])
    assert space == {
        "learning_rate": Range(1e-4, 1e-2, log=True), "num_epochs": Range(2, 20),
        "policy_layers": [(64, 64), (8,), (16,)], "preset": ["ppo", "mujoco"],
    }  # fmt: skip
    assert parse_space([f"{name}={text}" for name, text in as_words(space).items()]) == space
    assert check_space(as_words(space)) == space  # in Python, text will do


@pytest.mark.parametrize(
    ("space", "message"),
    [
        ({}, "nothing varies: give a range, such as learning_rate=1e-4:1e-2:log, or alternatives"),
        ({"learnig_rate": "1:2"}, "unknown hyperparameter 'learnig_rate'; did you mean learning_rate?"),
        ({"gamma": "0.9:0.99"}, "unknown hyperparameter 'gamma': here it is discount"),
        ({"presett": ["ppo"]}, "did you mean preset?"),
        ({"preset": ["pppo"]}, "unknown preset 'pppo'.*did you mean ppo?"),
        ({"preset": "a:b"}, "'a:b' is no range: write LOW:HIGH or LOW:HIGH:log, or alternatives"),
        ({"learning_rate": "1e-4:1e-2:lin"}, "'1e-4:1e-2:lin' is no range"),
        ({"learning_rate": "1e-4:1e-2,1"}, "'1e-4:1e-2,1' is no range"),
        ({"learning_rate": "1e-2:1e-4"}, "learning_rate = '0.01:0.0001': write the smaller end first"),
        ({"learning_rate": "0:1:log"}, "learning_rate = '0.0:1.0:log': a logarithmic range begins above 0"),
        ({"learning_rate": "fast:1"}, "learning_rate = 'fast': use a number"),
        ({"learning_rate": Range("a", 1)}, "learning_rate = 'a': use a number"),
        ({"discount": "0.9:1.5"}, "discount = 1.5: use a number from 0 to 1"),
        ({"num_epochs": "0:4"}, "num_epochs = 0: use a whole number"),
        ({"num_epochs": Range(1.5, 4)}, "num_epochs = 1.5: use an integer"),
        ({"popart": Range(0, 1)}, "popart = '0:1': only numbers have ranges; list the alternatives"),
        ({"num_epochs": 3}, "num_epochs = 3: give a Range, or a list of alternatives"),
        ({"num_epochs": [0]}, "num_epochs = 0: use a whole number"),
        ({"temperature": [0.1, "warm"]}, "temperature = 'warm': use a number"),
        ({"activation": "relu,tahn"}, "unknown activation 'tahn': use one of relu, .*; did you mean tanh?"),
        ({"terminations": ["end", 3]}, "unknown terminations 3: use one of auto, end, reset_cost, bootstrap"),
    ],
)
def test_spaces_that_are_refused(tmp_path, space, message):
    with pytest.raises(SwingupError, match=message):
        plan_of(tmp_path / "s", space)
    assert not (tmp_path / "s").exists()


def test_what_is_no_dictionary_and_no_seed_is_refused(tmp_path):
    with pytest.raises(SwingupError, match="give a dictionary of ranges"):
        plan_of(tmp_path / "s", ["learning_rate"])
    with pytest.raises(SwingupError, match=r"seed = 1\.5"):
        plan_of(tmp_path / "s", seed=1.5)


@pytest.mark.parametrize("line", ["[]", "1", '{"op_code": 99}'])
def test_a_damaged_journal_is_named(tmp_path, line):
    plan = plan_of(tmp_path / "s")
    searched(plan, 1, StandIn())
    with (plan.out / STUDY_FILE).open("a") as file:
        file.write(line + "\n")
    with pytest.raises(SwingupError, match=r"cannot read .*: restore it"):
        searched(plan, 2, StandIn())


def test_the_best_trial_becomes_settings(tmp_path):
    told = []
    result = searched(plan_of(tmp_path, seed=5), 6, StandIn(), progress=told.append)
    scores = [row.score for row in result.rows]
    assert [row.trial for row in result.rows] == list(range(6))
    assert told == result.rows
    best = result.best
    assert (best.score, best.trial) == (max(scores), scores.index(max(scores)))
    # The score's formula gives the rate back: the best score is that of the best hyperparameters.
    rate = best.hyperparameters["learning_rate"]
    assert best.score == pytest.approx(5.0 - abs(math.log10(rate) + 3.0))
    assert 1e-4 <= rate <= 1e-2
    assert best.hyperparameters["policy_layers"] in [(8,), (16, 8)]
    assert best.command.startswith("swingup train --env CartPole-v1 --preset mujoco --frames 1000 --seed 5 ")
    assert f"--learning-rate {rate}" in best.command
    stored = json.loads((tmp_path / "best.json").read_text())
    assert stored["command"] == best.command
    # The file's hyperparameters are keywords of the learner, lists for tuples included.
    config = config_from_dict(stored["hyperparameters"])
    assert (config.learning_rate, config.policy_layers) == (rate, best.hyperparameters["policy_layers"])
    assert [row["score"] for row in json.loads((tmp_path / "search.json").read_text())] == scores


def test_a_search_that_was_cut_off_goes_on(tmp_path):
    # Twelve trials: after ten Optuna's suggestions follow from the scores.
    undisturbed, first, second = StandIn(), StandIn(cut_off=3), StandIn()
    expected = searched(plan_of(tmp_path / "whole"), 12, undisturbed)
    with pytest.raises(KeyboardInterrupt):
        searched(plan_of(tmp_path / "cut"), 12, first)
    # A worker of the search that was killed may still train the fourth trial.
    with (
        RunFolder(tmp_path / "cut" / "trial-3" / "seed-0").exclusive(),
        pytest.raises(SwingupError, match=r"another process trains in .*trial-3/seed-0: wait for it"),
    ):
        searched(plan_of(tmp_path / "cut"), 12, StandIn())
    result = searched(plan_of(tmp_path / "cut"), 12, second)
    # What had ended is not trained again, and the fourth trial is continued in its folder.
    assert (first.trained, second.trained) == ([0, 1, 2, 3], list(range(3, 12)))
    assert result.rows == expected.rows
    # More trials continue the same search; as many as there are train nothing.
    third = StandIn()
    assert searched(plan_of(tmp_path / "cut"), 12, third).rows == expected.rows
    assert third.trained == []
    assert len(searched(plan_of(tmp_path / "cut"), 13, third).rows) == 13
    assert third.trained == [12]


def test_results_that_a_kill_left_out_are_written_by_the_next_call(tmp_path):
    plan = plan_of(tmp_path / "s")
    searched(plan, 2, StandIn())
    for name in ("best.json", "search.json"):
        (plan.out / name).unlink()
    result = searched(plan, 2, StandIn())
    assert json.loads((plan.out / "best.json").read_text())["trial"] == result.best.trial
    assert len(json.loads((plan.out / "search.json").read_text())) == 2


def test_a_kill_in_the_middle_of_a_write_loses_half_a_line_only(tmp_path):
    before = searched(plan_of(tmp_path), 2, StandIn())
    with (tmp_path / STUDY_FILE).open("a") as file:
        file.write('{"op_code": 4, "work')
    Path(f"{tmp_path / STUDY_FILE}.lock").symlink_to(tmp_path / STUDY_FILE)
    begun = time.monotonic()
    after = searched(plan_of(tmp_path), 3, StandIn())
    assert after.rows[:2] == before.rows
    assert len(after.rows) == 3
    assert time.monotonic() - begun < 10.0  # Optuna itself would wait 30 s for the lock


@pytest.mark.parametrize("pruning", [True, False])
def test_trials_below_the_median_are_cut_short(tmp_path, pruning):
    """Five trials first; then one that is worse half way, and one that is better."""

    def train(job):
        middle = {5: 0.0, 6: 2.0}.get(place_of(job), 1.0)
        write_rows(job, [(500, middle)])
        deadline = time.monotonic() + (20.0 if middle == 0.0 and pruning else 0.1)
        while not is_pruned(job) and time.monotonic() < deadline:
            time.sleep(0.005)
        if is_pruned(job):
            return JobOutcome(job, middle, middle, pruned=True)
        write_rows(job, [(500, middle), (1000, 3.0)])
        return JobOutcome(job, 3.0, 3.0)

    result = searched(plan_of(tmp_path), 7, train, pruning=pruning)
    sixth = ("pruned", 0.0) if pruning else ("complete", 3.0)
    assert [(row.state, row.score) for row in result.rows] == [("complete", 3.0)] * 5 + [sixth, ("complete", 3.0)]


def test_scores_by_tenths(tmp_path):
    (job,) = plan_of(tmp_path).jobs({}, 0)
    assert rung_scores(job) == {}
    # Of 1000 frames: a tenth is 100. Of two reports within a tenth the first counts.
    write_rows(job, [(99, 1.0), (100, 2.0), (150, 3.0), (420, None), (430, 4.0), (1024, 5.0)])
    assert rung_scores(job) == {0: 1.0, 1: 2.0, 4: 4.0, 10: 5.0}


def test_seeds_of_a_trial_run_side_by_side(tmp_path):
    together = threading.Barrier(2, timeout=20)

    def train(job):
        together.wait()
        return StandIn()(job)

    result = searched(plan_of(tmp_path, seeds=2), 2, train, at_once=2)
    for row in result.rows:
        rate = float(row.settings.split()[0].removeprefix("learning_rate="))
        # The seeds 0 and 1 are added to the stand-in's score: their mean is 0.5.
        assert row.score == pytest.approx(0.5 - abs(math.log10(rate) + 3.0))


def test_settings_that_do_not_go_together_are_a_failed_trial(tmp_path):
    result = searched(plan_of(tmp_path, {"batch_size": [128, 1000]}), 8, lambda job: JobOutcome(job, 1.0, 1.0))
    for row in result.rows:
        fits = row.settings == "batch_size=128"
        assert row.state == ("complete" if fits else "failed")
        assert ("does not divide a rollout" in row.error) is not fits
    assert {row.state for row in result.rows} == {"complete", "failed"}


def test_runs_without_a_score_are_failed_trials(tmp_path):
    errors = ["", "training diverged"]
    result = searched(plan_of(tmp_path), 2, lambda job: JobOutcome(job, math.nan, math.nan, errors[place_of(job)]))
    assert [(row.state, row.error) for row in result.rows] == [
        ("failed", "its score is no number"),
        ("failed", "training diverged"),
    ]
    assert result.best is None
    assert not (tmp_path / "best.json").exists()
    assert json.loads((tmp_path / "search.json").read_text())[0]["score"] is None


def test_a_folder_of_another_search_is_left_alone(tmp_path):
    searched(plan_of(tmp_path), 1, StandIn())
    changed = "frames 1000 there, 999 here; set num_epochs '1:9' there, '1:8' here"
    with pytest.raises(SwingupError, match=rf"a search with other settings \({changed}\): choose another --out"):
        searched(plan_of(tmp_path, SPACE | {"num_epochs": "1:8"}, 999), 1, StandIn())
    # Another preset changes many hyperparameters.
    other = plan_search(BASE | {"preset": "ppo"}, {"clip_range": "0.1:0.2"}, tmp_path, 1000)
    changed = (
        r"set clip_range None there, '0.1:0.2' here; preset 'mujoco' there, 'ppo' here; num_envs 4 there, 1 here"
    )
    with pytest.raises(SwingupError, match=rf"\({changed}; and \d+ more\)"):
        searched(other, 1, StandIn())
    with RunFolder(tmp_path).exclusive(), pytest.raises(SwingupError, match="another process trains in"):
        searched(plan_of(tmp_path), 2, StandIn())
    (tmp_path / STUDY_FILE).write_text("no journal\n{}\n")
    with pytest.raises(SwingupError, match=r"cannot read .*study\.journal: restore it, or choose another --out"):
        searched(plan_of(tmp_path), 1, StandIn())


def test_without_optuna_the_remedy_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(SwingupError, match=r"a search needs Optuna: pip install 'swingup\[optuna\]'"):
        searched(plan_of(tmp_path), 1, StandIn())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("sweep acrobot --trials 3", "nothing varies: give a range"),
        ("sweep acrobot --trials 0 --set num_epochs=1:3", "trials = 0: use a whole number from 1"),
        ("sweep acrobot --set num_epochs=1:3", "--set num_epochs=1:3 is a range: give --trials to search it"),
        ("sweep acrobot --no-pruning", "--no-pruning goes with --trials"),
        (
            "sweep acrobot --trials 3 --set num_epochs=1:3 num_epochs=4",
            "give num_epochs one range, or alternatives",
        ),
        (
            "sweep acrobot --trials 3 --set gru_width=0:8 shared_trunk=true",
            "gru_width = 8 does not go with the acrobot",
        ),
        ("sweep acrobot --trials 3 --set gru_width=0,4", "gru_width = 4 does not go with the acrobot"),
        ("sweep --env CartPole-v1 --trials 3 --set n_epochs=1:3", "here it is num_epochs"),
        ("sweep --env CartPole-v1 --trials 3 --set preset=mujoco,paper", "different lengths .*: give --frames"),
    ],
)
def test_bad_searches(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments.split()) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert re.search(message, error)
    assert not list(tmp_path.iterdir())


def test_an_environment_needs_a_name(tmp_path):
    with pytest.raises(SwingupError, match="a search runs in other processes: name a Gymnasium id"):
        swingup.search(lambda: None, {"num_epochs": "1:3"}, 1, tmp_path)


@pytest.mark.slow
def test_the_command_searches_goes_on_and_its_best_settings_train(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    words = ["sweep", "--env", "CartPole-v1", "--frames", "256", "--evaluate-every", "64", "--workers", "1"]
    words += ["--evaluation-episodes", "1", "--set", *SIZES, "learning_rate=1e-4:1e-2:log", "num_epochs=1:3"]
    assert main([*words, "--trials", "2"]) == 0
    assert "2 trials complete, 0 pruned, 0 failed" in capsys.readouterr().out
    folder = tmp_path / "searches" / "CartPole-v1-mujoco"
    written = {path: path.stat().st_mtime_ns for path in folder.rglob("last.safetensors")}
    assert len(written) == 2
    assert main([*words, "--trials", "3", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["trial"], row["state"]) for row in rows] == [(0, "complete"), (1, "complete"), (2, "complete")]
    assert all(path.stat().st_mtime_ns == then for path, then in written.items())
    best = json.loads((folder / "best.json").read_text())
    assert main([*shlex.split(best["command"])[1:], "--out", "again"]) == 0
    # The command's run is the trial's, bit for bit.
    again, seed = tmp_path / "again", Path(best["folder"]) / "seed-0"
    assert read_run_settings(again)[0] == read_run_settings(seed)[0]
    assert [row["score"] for row in read_metrics(again / "metrics.jsonl")] == [
        row["score"] for row in read_metrics(seed / "metrics.jsonl")
    ]


def score_of_epochs(job):
    score = float(settings_of(job).config.num_epochs)
    return JobOutcome(job, score, score)


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_search_on_dask(tmp_path):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, processes=False, threads_per_worker=1, dashboard_address=None
        ) as cluster,
        workers_for(cluster.scheduler_address, None) as pool,
    ):
        assert pool.count == 2
        result = run_search(plan_of(tmp_path), 4, pool.executor, pool.count, train=score_of_epochs, poll=0.01)
    assert [row.state for row in result.rows] == ["complete"] * 4
    assert result.best.score == result.best.hyperparameters["num_epochs"]


@pytest.mark.slow
def test_a_pruned_run_ends_after_the_chunk_in_progress(tmp_path):
    sizes = {"num_envs": 2, "num_steps": 16, "num_epochs": 1, "batch_size": 32}
    (job,) = plan_of(tmp_path, frames=256 * 100).jobs(sizes | {"policy_layers": (8,), "value_layers": (8,)}, 0)

    def mark():
        while not ended.is_set() and not (Path(job.folder) / "metrics.jsonl").exists():
            time.sleep(0.001)
        prune(job)

    ended = threading.Event()
    marker = threading.Thread(target=mark)
    marker.start()
    outcome = train_one(job)
    ended.set()
    marker.join()
    assert (outcome.pruned, outcome.error) == (True, "")
    frames = read_metrics(f"{job.folder}/metrics.jsonl")[-1]["frames"]
    assert 0 < frames < job.frames
    assert (Path(job.folder) / "checkpoints" / f"{frames:012d}.safetensors").exists()
