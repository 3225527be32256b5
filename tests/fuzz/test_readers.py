"""Spoilt files of all kinds: each read ends in a value or in one line, within 20 s and 2 GB.

Other seeds: ``SWINGUP_FUZZ_SEEDS=5,6,7 python -m pytest -m slow tests/fuzz``.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from .campaign import campaign
from .inputs import KINDS

SEEDS = [int(seed) for seed in os.environ.get("SWINGUP_FUZZ_SEEDS", "0").split(",")]
READS = 20_000


def test_some_reads(tmp_path):
    found = campaign(seed=1, reads=240, folder=tmp_path)
    assert found["faults"] == []
    assert found["reads"] == dict.fromkeys(KINDS, 30)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_many_reads(tmp_path, seed):
    command = [sys.executable, "-m", "fuzz.campaign", str(seed), str(READS), str(tmp_path)]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=Path(__file__).parents[1], env=_with_package()
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["faults"] == []
    assert sum(found["reads"].values()) == READS
    assert found["slowest"][0] < 20
    assert found["peak_mb"] < 2000


def _with_package():
    """The environment with this very package on the path."""
    import swingup

    source = str(Path(swingup.__file__).parents[1])
    return os.environ | {"PYTHONPATH": os.pathsep.join([source, os.environ.get("PYTHONPATH", "")])}
