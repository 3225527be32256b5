"""Spoilt files of all kinds: each read ends in a value or in a ``SwingupError`` of one line, within 20 s.

Other seeds: ``SWINGUP_FUZZ_SEEDS=5,6,7 python -m pytest -m slow tests/fuzz``.
"""

import os
import random
import re
import signal
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from swingup import BOARDS, SwingupError, load_plant, measured_plant, save_plant, score
from swingup.areapo.checkpoint import load_checkpoint, read_metadata
from swingup.benchmark.recording import load_trajectory
from swingup.controllers.swingups.reference import load_reference
from swingup.export.c_header import c_header
from swingup.identification.recording import read_recording
from swingup.learner.metrics import read_metrics
from swingup.learner.run_settings import read_run_settings
from swingup.loop.resolve import resolve
from swingup.policy.file import read_network
from swingup.policy.numpy_backend import numpy_controller
from swingup.policy.pendulum import read_pendulum_policy
from swingup.report.figures import curves_figure, read_robustness, robustness_figure

from .inputs import KINDS, LIKE


def run_policy(path):
    """A policy that is accepted gives finite torques, and has a header in C."""
    found = read_pendulum_policy(path)
    controller = numpy_controller(found)
    torques = [controller(np.array([0.1 * k, 0.2, 300.0, -0.1]), 0.002 * k) for k in range(3)]
    assert np.isfinite(torques).all(), f"torques {torques}"
    if found.network.activation == "relu":
        assert not {"inff", "nanf"} & set(re.findall("[a-z]+", c_header(found)))


def score_log(board, path):
    """A log as a board scores it; not every board has scores of logs."""
    score(load_trajectory(path), "acrobot", board)


def import_model(path):
    """A model file that makes a plant can be written, or is refused."""
    found = measured_plant(path, {"l2": 0.3, "tl1": 1.0, "tl2": 1.0}, "centre")
    assert all(note.isprintable() for note in found.notes)
    save_plant(f"{path}.urdf", found.plant)


COLUMNS = [
    "q2=q2-q1", "u1=0", "q1=q1+pi:deg", "q1=2:counts/1000", "time=t:ms", "u1=u2:A*0.7", "q1=-#3", "dq1=pi",
    "q1:",
]  # fmt: skip
"""Words that map columns, good ones and others."""
LOGS = [
    *(partial(read_recording, columns=COLUMNS[k : k + 2]) for k in range(0, len(COLUMNS), 2)),
    read_recording,
    load_trajectory,
]

READERS = {
    "yaml": [load_plant, resolve],
    "trajectory": [
        *(partial(score_log, board) for board in BOARDS),
        lambda path: score(load_trajectory(path, ["q1=2", "q2=3"]), "acrobot", "icra-real", force=True),
        *LOGS,
    ],
    "npz": LOGS,
    "mat": LOGS,
    "policy": [run_policy, run_policy, read_network],
    "reference": [load_reference],
    "checkpoint": [lambda path: load_checkpoint(path, LIKE), read_metadata],
    "config": [lambda path: read_run_settings(Path(path).parent)],
    "metrics": [read_metrics, lambda path: curves_figure({"a": read_metrics(path)})],
    "model": [load_plant, import_model, import_model],
    "robustness": [lambda path: robustness_figure({"a": read_robustness(path)})],
}
"""What reads each kind of file."""

MAX_MESSAGE_LENGTH = 2000
"""Characters of a message."""
MAX_READ_TIME = 20.0
"""s of the processor's time: others may be busy."""


class Overtime(BaseException):
    """A read took too long."""


def stop(*_):
    raise Overtime


def fault_of(read, path):
    """What is wrong with how a read ended; None if nothing is."""
    try:
        read(str(path))
    except SwingupError as error:
        text = str(error)
        return (
            None
            if text.isprintable() and len(text) <= MAX_MESSAGE_LENGTH
            else f"a message that is no line: {text!r:.200}"
        )
    except Overtime:
        return "too slow"
    except Exception as error:  # a traceback, which is what is looked for
        return f"{type(error).__name__}: {error!s:.200}"
    return None


def campaign(seed, reads, folder, kinds=tuple(KINDS)):
    """Read spoilt files, the kinds in turn; gives faults with their files, which stay."""
    generator, faults = random.Random(seed), []
    before = signal.signal(signal.SIGPROF, stop)
    for number in range(reads):
        kind = kinds[number % len(kinds)]
        make, file = KINDS[kind]
        data, path = make(generator), folder / kind / file
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
        read = generator.choice(READERS[kind])
        signal.setitimer(signal.ITIMER_PROF, MAX_READ_TIME)
        fault = fault_of(read, path)
        signal.setitimer(signal.ITIMER_PROF, 0)
        if fault is not None:
            kept = folder / f"fault-{number}-{file}"
            kept.write_bytes(data)
            faults.append(f"{kind}, read {number} of seed {seed}: {fault} ({kept})")
    signal.signal(signal.SIGPROF, before)
    return faults


SEEDS = [int(seed) for seed in os.environ.get("SWINGUP_FUZZ_SEEDS", "0").split(",")]


def test_some_reads_of_every_kind(tmp_path):
    assert campaign(1, 15 * len(KINDS), tmp_path) == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", KINDS)
def test_many_reads_of_a_kind(tmp_path, kind, seed):
    assert campaign(seed, 20_000, tmp_path, [kind]) == []
