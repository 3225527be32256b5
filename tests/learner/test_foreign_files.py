"""Files of a run that are damaged, of something else or of absurd content: one line, or the run goes on."""

import shutil

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from array_files import change_file, read_metadata, write_file
from refusals import refusal
from swingup import AREAPO
from swingup.learner.start import resume_run

from .brief import briefly_judged
from .test_run import FRAMES, run


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "r"
    with briefly_judged():
        run(folder, 2)
    return folder


@pytest.fixture
def folder(finished, tmp_path):
    return shutil.copytree(finished, tmp_path / "r")


@pytest.mark.parametrize("part", ["actor", "optimiser", "statistics", "gains"])
def test_a_checkpoint_whose_numbers_are_not_finite(folder, part):
    path = folder / "checkpoints" / "000000000128.safetensors"
    arrays = load_file(path)
    name = next(name for name in arrays if name.startswith(part) and arrays[name].dtype == np.float32)
    for value in (np.nan, np.inf):
        arrays[name].flat[-1] = value
        write_file(path, read_metadata(path), arrays)
        for load, file in ((resume_run, folder), (AREAPO.load, path)):
            assert "holds weights or statistics that are not finite" in refusal(load, file)


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
