"""Files of a run that are damaged, of something else or of absurd content: one line, or the run goes on."""

import json
import shutil

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from array_files import change_file, read_metadata, write_file
from swingup import AREAPO
from swingup.areapo.checkpoint import CHECKPOINT_FORMAT, CHECKPOINT_VERSION
from swingup.common.arrays import save_arrays
from swingup.common.errors import SwingupError
from swingup.learner.metrics import read_metrics
from swingup.learner.start import resume_run

from .brief import briefly_judged
from .test_run import FRAMES, run

NESTED = "[" * 100_000 + "]" * 100_000


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "r"
    with briefly_judged():
        run(folder, 2)
    return folder


@pytest.fixture
def folder(finished, tmp_path):
    return shutil.copytree(finished, tmp_path / "r")


def refused(call, *arguments, match=None):
    with pytest.raises(SwingupError, match=match) as caught:
        call(*arguments)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600


CONFIGS = [
    {"robot": ["acrobot"]}, {"robot": {}}, {"robot": 3}, {"preset": None}, {"preset": ["default"]},
    {"seed": "0"}, {"seed": 1e400}, {"seed": 0.5}, {"seeds": -1}, {"seeds": 2147483648}, {"seeds": 10**400},
    {"frames": None}, {"frames": [1]}, {"frames": float("inf")}, {"frames": 1.5}, {"evaluate_every": True},
    {"config": None}, {"config": []}, {"config": {"learning_rate": None}}, {"config": {"num_envs": 1e300}},
    {"config": {"policy_layers": [[8]]}}, {"config": {"policy_layers": "88"}}, {"config": {"centre_values": "yes"}},
    {"config": {"learning_rate": float("nan")}}, {"config": {"terminations": []}}, {"env": 7, "robot": None},
    {"unknown\nname": 1},
]  # fmt: skip
TEXTS = [
    NESTED,
    '{"a":' * 50_000,
    "\x00",
    "9" * 5000,
    '"text"',
    "null",
    "",
    "[]",
    "{}",
    '{"version": "0", "frames": 1}',
]
LINES = [
    "[]", "3", "null", NESTED, "{}", '{"seed": 0}', '{"seed": "0", "frames": 64}', '{"seed": [0], "frames": 64}',
    '{"seed": 0, "frames": "64"}', '{"seed": 0, "frames": 1e400}', '{"seed": 0, "frames": NaN}',
    '{"seed": 0, "frames": 64, "score": Infinity}', '{"seed": 0, "frames": 64, "score": {"a": 1}}',
    '{"seed": -1, "frames": 64}',
]  # fmt: skip
METADATA = [
    {"settings": None}, {"settings": []}, {"iterations": "2"}, {"iterations": 1e400}, {"iterations": -1},
    {"seconds": "long"}, {"seconds": None}, {"best": 3}, {"best": ["high"]}, {"best": [[True, "high"]]},
    {"best": [[True, 0.1]] * 2}, {"best": {}},
]  # fmt: skip


def test_a_config_of_wrong_types_or_of_something_else(folder):
    content = json.loads((folder / "config.json").read_text())
    for change in CONFIGS:
        (folder / "config.json").write_text(json.dumps(content | change))
        refused(resume_run, folder)
    for text in TEXTS:
        (folder / "config.json").write_text(text)
        refused(resume_run, folder, match="malformed")
    (folder / "config.json").write_bytes(b"\xff\xfe\x00{")
    refused(resume_run, folder, match="malformed")


def test_rows_that_are_none(folder):
    path = folder / "metrics.jsonl"
    rows, good = read_metrics(path), path.read_text()
    for line in LINES:
        path.write_text(good + line)  # as the last line it is what a crash left
        assert read_metrics(path) == rows
        path.write_text(line + "\n" + good)
        refused(read_metrics, path, match="line 1 is no row of metrics: remove or correct")
    refused(lambda: list(resume_run(folder, 4 * FRAMES).advance()), match="line 1 is no row")


def test_a_checkpoint_whose_metadata_is_wrong(folder):
    path = folder / "checkpoints" / "000000000128.safetensors"
    metadata, arrays = read_metadata(path), load_file(path)
    for change in METADATA:
        write_file(path, metadata | change, arrays)
        refused(resume_run, folder, match="checkpoint")
        refused(AREAPO.load, path)
    save_arrays(path, CHECKPOINT_FORMAT, CHECKPOINT_VERSION, {}, {})
    refused(AREAPO.load, path, match="malformed")


@pytest.mark.parametrize("part", ["actor", "critic", "optimiser", "statistics", "gains", "observations"])
def test_a_checkpoint_whose_numbers_are_not_finite(folder, part):
    path = folder / "checkpoints" / "000000000128.safetensors"
    arrays = load_file(path)
    name = next(name for name in arrays if name.startswith(part) and arrays[name].dtype == np.float32)
    for value in (np.nan, np.inf):
        arrays[name].flat[-1] = value
        write_file(path, read_metadata(path), arrays)
        for load, file in ((resume_run, folder), (AREAPO.load, path)):
            refused(load, file, match="holds weights or statistics that are not finite")


def test_names_among_the_checkpoints_that_are_none(folder):
    checkpoints = folder / "checkpoints"
    for name in ("9x", "copy of 000000000128", "9" * 40, "0.part"):
        (checkpoints / f"{name}.safetensors").write_bytes(b"")
    assert resume_run(folder).frames == 2 * FRAMES
    shutil.rmtree(checkpoints)
    checkpoints.write_text("")
    refused(resume_run, folder, match="has no checkpoint")


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
    refused(resume_run, folder, 4 * FRAMES, match=f"{best} is not a policy of this run .*: move it away to resume")
    assert best.read_bytes() == content
    best.unlink()
    # The checkpoint knows the score that was reached.
    assert resume_run(folder, 4 * FRAMES).best_score is not None
