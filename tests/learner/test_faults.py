"""What may befall a run: killed processes, two in one folder, a full disk, damaged, foreign and absurd files."""

import contextlib
import errno
import fcntl
import math
import os
import random
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from array_files import change_file, read_metadata, write_file
from refusals import refusal
from swingup import AREAPO
from swingup.cli import main
from swingup.common.errors import SwingupError
from swingup.learner.run import resume_run, start_run
from swingup.learner.run_folder import RunFolder

from .environments import TINY as TINY_LEARNER
from .environments import Noisy
from .test_run import FRAMES, SETTINGS, assert_same_files, briefly_judged, measured, run

TINY = shlex.split(
    "--num-envs 4 --num-steps 16 --batch-size 64 --num-epochs 1 --policy-layers 8 8 --value-layers 8 8 "
    "--evaluate-every 64 --checkpoint-every 128 --seed 2"
)
TASKS = {"compiled": ["pendubot"], "host": ["--env", "CartPole-v1", "--evaluation-episodes", "0"]}


def kill_and_resume(folder, arguments, cache, kills, seed):
    """Train to the end through so many kills; returns how often a checkpoint was resumed from.

    This process trains the rest, and nobody kills it. A process that comes to its end before it is killed does
    not count, and there is nothing left to kill then.
    """
    moments, killed, resumed = random.Random(seed), 0, 0
    while True:
        newest = max((int(path.stem) for path in (folder / "checkpoints").glob("[0-9]*.safetensors")), default=None)
        if newest is None:  # killed before there was anything to lose
            shutil.rmtree(folder, ignore_errors=True)
            words = ["train", *arguments, "--out", str(folder)]
        else:
            words = ["train", "--resume", str(folder)]
            resumed += newest > 0
        if killed == kills:
            assert main(words) == 0
            return resumed
        command = [sys.executable, "-m", "swingup", *words]
        environment = os.environ | {"XDG_CACHE_HOME": str(cache)}
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment)
        if killed % 4 != 3:  # mostly in the midst of training, sometimes anywhere
            wait_for_reports(folder, process, (newest or 0) // 64 + moments.randint(1, 6))
        time.sleep(moments.uniform(0.0, 0.1 if killed % 4 != 3 else 4.0))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert process.returncode == -signal.SIGKILL, f"came to its end after {killed} kills: give it more frames"
        killed += 1


def wait_for_reports(folder, process, count):
    """Wait until the run has so many reports, however slow the machine is."""
    metrics = folder / "metrics.jsonl"
    before = metrics.stat().st_mtime_ns if metrics.exists() else 0
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and process.poll() is None:
        # The file is rewritten when a run opens it, then it grows with each report.
        if metrics.exists() and metrics.stat().st_mtime_ns > before and metrics.read_text().count("\n") >= count:
            return
        time.sleep(0.005)


@pytest.fixture
def folder(tmp_path):
    """That of a run of two iterations, whose policies are judged briefly for the whole test."""
    with briefly_judged():
        run(tmp_path / "r", 2)
        yield tmp_path / "r"


def best_score(row):
    return -math.inf if row["best_score"] is None else row["best_score"]


@pytest.mark.slow
@pytest.mark.usefixtures("own_signals")
@pytest.mark.parametrize("task", ["compiled", "host"])
def test_killed_processes_resume_to_the_same_bits(tmp_path, task):
    arguments = [*TASKS[task], "--frames", str(64 * (300 if task == "compiled" else 960)), *TINY]
    assert main(["train", *arguments, "--out", str(tmp_path / "whole")]) == 0
    resumed = kill_and_resume(tmp_path / "part", arguments, tmp_path / "cache", kills=12, seed=4)
    assert resumed >= 6
    assert_same_files(tmp_path / "whole", tmp_path / "part")
    whole, part = measured(tmp_path / "whole"), measured(tmp_path / "part")
    assert whole[-1] == part[-1]
    # A best policy that was written after the last checkpoint outlives the kill: its score is known earlier.
    assert all(best_score(one) <= best_score(other) for one, other in zip(whole, part, strict=True))
    assert [row | {"best_score": None} for row in whole] == [row | {"best_score": None} for row in part]
    assert [path.name for path in (tmp_path / "part").rglob(".*")] == [".lock"]


@pytest.mark.slow
def test_who_read_a_checkpoint_before_another_process_trained_does_not_undo_its_work(folder):
    late = resume_run(folder, 4 * FRAMES)
    list(resume_run(folder, 4 * FRAMES).advance())
    rows = (folder / "metrics.jsonl").read_bytes()
    assert "has moved on to 256 frames" in refusal(list, late.advance())
    assert (folder / "metrics.jsonl").read_bytes() == rows


def test_who_finds_another_process_training_leaves_its_metrics_alone(tmp_path):
    model = AREAPO(Noisy, folder=tmp_path / "run", **TINY_LEARNER).learn(64)
    late = resume_run(tmp_path / "run", 256, Noisy)
    model.learn(64)
    rows = (tmp_path / "run" / "metrics.jsonl").read_bytes()
    assert rows.count(b"\n") == 2
    with model._run._folder.locked(model.frames):
        assert "another process trains in" in refusal(list, late.advance())
    assert "has moved on to 128 frames" in refusal(list, late.advance())
    assert (tmp_path / "run" / "metrics.jsonl").read_bytes() == rows


@pytest.mark.parametrize(
    ("number", "message"),
    [
        (errno.ENOLCK, None), (errno.EOPNOTSUPP, None), (errno.EACCES, "another process trains in"),
        (errno.EBADF, "cannot lock .*lock: Bad file descriptor"),
    ],
)  # fmt: skip
def test_what_a_file_system_says_of_locks(tmp_path, monkeypatch, number, message):
    def flock(file, operation):
        assert "a" in file.mode  # NFS locks no file that is open for reading
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", flock)
    refused = contextlib.nullcontext() if message is None else pytest.raises(SwingupError, match=message)
    with refused, RunFolder(tmp_path / "new").exclusive():
        pass


@pytest.mark.slow
def test_a_full_disk_leaves_the_last_good_checkpoint(folder, tmp_path):
    # Resumed once before: the compiled program, which JAX keeps in a file, shall not meet the limit below.
    list(resume_run(folder, 4 * FRAMES).advance())
    checkpoint, files = folder / "checkpoints" / "000000000256.safetensors", sorted(folder.rglob("*.safetensors"))
    good = checkpoint.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        # The kernel refuses to write beyond this, in the midst of a file, as it does on a full disk.
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(good) // 2, limits[1]))
        with pytest.raises(SwingupError, match=r"cannot write .*: File too large"):
            list(resume_run(folder, 8 * FRAMES).advance())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert sorted(folder.rglob("*.safetensors")) == files
    assert checkpoint.read_bytes() == good
    # With room again it goes on.
    list(resume_run(folder, 8 * FRAMES).advance())
    list(start_run(SETTINGS, tmp_path / "whole", 8 * FRAMES).advance())
    assert_same_files(folder, tmp_path / "whole")


def test_a_checkpoint_whose_numbers_are_not_finite(folder):
    path = folder / "checkpoints" / "000000000128.safetensors"
    for part, value in (("actor", np.nan), ("optimiser", np.inf), ("statistics", np.inf), ("gains", np.nan)):
        arrays = load_file(path)
        name = next(name for name in arrays if name.startswith(part) and arrays[name].dtype == np.float32)
        whole, arrays[name].flat[-1] = arrays[name].copy(), value
        write_file(path, read_metadata(path), arrays)
        for load, file in ((resume_run, folder), (AREAPO.load, path)):
            assert "holds weights or statistics that are not finite" in refusal(load, file)
        write_file(path, read_metadata(path), arrays | {name: whole})


def test_names_among_the_checkpoints_that_are_none(folder):
    checkpoints = folder / "checkpoints"
    for name in ("9x", "copy of 000000000128", "9" * 40, "0.part"):
        (checkpoints / f"{name}.safetensors").write_bytes(b"")
    assert resume_run(folder).frames == 2 * FRAMES
    shutil.rmtree(checkpoints)
    checkpoints.write_text("")
    assert "has no checkpoint" in refusal(resume_run, folder)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda path: path.write_bytes(b"my notes"),
        lambda path: path.write_bytes(path.read_bytes()[:500]),
        lambda path: save_file({"a": np.zeros(3)}, path),
        lambda path: AREAPO("CartPole-v1", evaluation_episodes=0).export_policy(path),
        lambda path: change_file(path, {"robot": "pendubot"}),
    ],
    ids=["text", "truncated", "safetensors", "other task", "other robot"],
)
def test_a_foreign_best_policy_is_refused_and_kept(folder, spoil):
    best = folder / "best.safetensors"
    spoil(best)
    content = best.read_bytes()
    told = refusal(resume_run, folder, 4 * FRAMES)
    assert f"{best} is not a policy of this run" in told
    assert "move it away to resume" in told
    assert best.read_bytes() == content
    best.unlink()
    # The checkpoint knows the score that was reached.
    assert resume_run(folder, 4 * FRAMES).best_score is not None
