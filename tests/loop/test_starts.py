"""Starts of episodes: how many of each kind, and where they lie."""

import numpy as np
import pytest

from swingup.dynamics.dynamics import UPRIGHT
from swingup.loop.starts import PASSING, Starts, sample_starts
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD
from swingup.plant.units import scales_of

COST_TO_GO = np.diag([400.0, 100.0, 25.0, 4.0])
STARTS = Starts(anywhere=2.0, near_top=1.0, passing=1.0, hanging=1.0)


def sample(plant):
    x = sample_starts(np.random.default_rng(0), plant.driven("acrobot"), STARTS, 5000, COST_TO_GO)
    return np.split(x, np.cumsum([2000, 1000, 1000]))


def test_each_kind_has_its_share_and_its_size():
    anywhere, near_top, passing, hanging = sample(LEADERBOARD)
    assert np.abs(anywhere[:, :2]).max() == pytest.approx(np.pi, abs=0.01)
    # With a deviation that is uniform up to 10 rad/s, the variance is 10² / 3.
    assert anywhere[:, 2:].std() == pytest.approx(10 / np.sqrt(3), rel=0.05)
    error = near_top - UPRIGHT
    costs = np.einsum("ni,ij,nj->n", error, COST_TO_GO, error)
    assert (costs.max(), costs.mean()) == pytest.approx((1.0, 0.5), abs=0.03)
    assert (passing - UPRIGHT).std(axis=0) == pytest.approx(PASSING, rel=0.1)
    assert hanging.std() == pytest.approx(0.05, rel=0.05)


def test_velocities_are_in_the_plants_own_units():
    small = load_plant("cloudpendulum")
    time = scales_of(small.driven("acrobot")).time
    for one, other in zip(sample(LEADERBOARD), sample(small), strict=True):
        # States near the top are those of the given cost-to-go on every plant.
        factor = 1.0 if np.allclose(one, other) else 1.0 / time
        np.testing.assert_allclose(other, one * [1.0, 1.0, factor, factor], rtol=1e-9)


def test_counts_add_up():
    counts = Starts(thrown=0.7, anywhere=0.15, hanging=0.15).counts(20_000)
    assert counts == dict(zip(counts, (14_000, 0, 3000, 0, 0, 3000), strict=True))
    assert sum(Starts(thrown=1.0, passing=1.0, hanging=1.0).counts(100).values()) == 100
