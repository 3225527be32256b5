import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo.normalise import observation_statistics
from swingup.tasks.observation import Normalise


def test_statistics_equal_those_of_all_data_at_once():
    data = np.random.default_rng(0).normal(3.0, [0.1, 1.0, 10.0], size=(50, 8, 3))
    with jax.enable_x64(True):
        statistics = observation_statistics(3)
        for batch in data:
            statistics = statistics.update(jnp.asarray(batch))
        everything = data.reshape(-1, 3)
        # The start (mean 0, variance 1) keeps a weight of 1e-4 against 400 samples.
        np.testing.assert_allclose(statistics.mean, everything.mean(axis=0), rtol=1e-6)
        np.testing.assert_allclose(statistics.variance, everything.var(axis=0), rtol=1e-3)
        assert statistics.count == pytest.approx(400.0001)


def test_normalising_by_hand():
    stage = Normalise(mean=jnp.array([1.0, 0.0]), variance=jnp.array([4.0, 1e-12]))
    # (5 - 1) / 2 = 2, and 1 / sqrt(1e-12 + 1e-8) = 9999.5 is clipped to 10.
    np.testing.assert_allclose(stage(jnp.array([5.0, 1.0])), [2.0, 10.0], rtol=1e-6)
