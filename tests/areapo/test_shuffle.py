"""Random orders: every frame once, and every order equally often."""

import jax
import numpy as np
import pytest

from swingup.areapo import optimisation

# With so few random bits wanted frames' numbers share a word with them; with so many they do not.
LEAST = {"tagged": optimisation.LEAST_RANDOM, "sorted by bits": optimisation.WORD + 1}


@pytest.fixture(params=LEAST.values(), ids=LEAST)
def orders(request, monkeypatch):
    monkeypatch.setattr(optimisation, "LEAST_RANDOM", request.param)
    return lambda epochs, size: np.asarray(optimisation.shuffled(jax.random.key(0), epochs, size))


@pytest.mark.parametrize("size", [1, 24, 1024, 1025])
def test_an_order_has_every_frame_once(orders, size):
    drawn = orders(3, size)
    assert drawn.dtype == np.int32
    np.testing.assert_array_equal(np.sort(drawn, axis=-1), np.tile(np.arange(size), (3, 1)))


def test_all_orders_come_equally_often(orders):
    """Each of the 3! orders of three frames comes 1000 times in 6000 epochs, with a deviation of 29."""
    _, counts = np.unique(orders(6000, 3), axis=0, return_counts=True)
    assert counts.size == 6
    assert np.abs(counts - 1000).max() < 5 * 29


def test_a_frame_is_in_every_minibatch_equally_often(orders):
    """A rollout of Table I's size: a frame's place is even, also for the first and the last frames."""
    drawn = orders(400, 8192)
    minibatches = np.argsort(drawn, axis=-1) // 1024
    # Binomial, 400 draws of probability 1/8: mean 50, deviation 6.6.
    for frame in (0, 1, 8190, 8191):
        assert np.abs(np.bincount(minibatches[:, frame], minlength=8) - 50).max() < 5 * 6.6
