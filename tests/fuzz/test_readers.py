"""Spoilt files of all kinds: each read ends in a value or in one line, within 20 s.

Other seeds: ``SWINGUP_FUZZ_SEEDS=5,6,7 python -m pytest -m slow tests/fuzz``.
"""

import os

import pytest

from .campaign import campaign
from .inputs import KINDS

SEEDS = os.environ.get("SWINGUP_FUZZ_SEEDS", "0").split(",")


@pytest.mark.parametrize(
    ("seed", "reads"), [(1, 400), *(pytest.param(int(seed), 20_000, marks=pytest.mark.slow) for seed in SEEDS)]
)
def test_reads(tmp_path, seed, reads):
    found = campaign(seed, reads, tmp_path)
    assert found["faults"] == []
    assert found["reads"] == dict.fromkeys(KINDS, reads / len(KINDS))
