"""Spoilt files of all kinds: each read ends in a value or in one line, within 20 s.

Other seeds: ``SWINGUP_FUZZ_SEEDS=5,6,7 python -m pytest -m slow tests/fuzz``.
"""

import os

import pytest

from .campaign import campaign
from .inputs import KINDS

SEEDS = [int(seed) for seed in os.environ.get("SWINGUP_FUZZ_SEEDS", "0").split(",")]


def test_some_reads_of_every_kind(tmp_path):
    found = campaign(1, 40 * len(KINDS), tmp_path)
    assert found["faults"] == []
    assert found["reads"] == dict.fromkeys(KINDS, 40)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", KINDS)
def test_many_reads_of_a_kind(tmp_path, kind, seed):
    assert campaign(seed, 20_000, tmp_path, [kind]) == {"reads": {kind: 20_000}, "faults": []}
