import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo.statistics import RunningStatistics, running_statistics
from swingup.tasks.observation import NormaliseStage


def test_statistics_equal_those_of_all_data_at_once():
    data = np.random.default_rng(0).normal(3.0, [0.1, 1.0, 10.0], size=(50, 8, 3))
    with jax.enable_x64(True):
        statistics = running_statistics(3)
        for batch in data:
            statistics = statistics.update(jnp.asarray(batch))
        everything = data.reshape(-1, 3)
        np.testing.assert_allclose(statistics.mean, everything.mean(axis=0), rtol=1e-12)
        np.testing.assert_allclose(statistics.variance, everything.var(axis=0), rtol=1e-12)
        assert statistics.count == 400.0


@pytest.mark.parametrize(("size", "place"), [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e6), (0.0, 0.1)])
def test_observations_of_any_size_and_place_are_normalised(size, place):
    """In single precision, which has steps of 0.06 near 1e6; constant ones become 0."""
    plain = np.random.default_rng(0).normal(size=(2000, 4, 1))
    statistics, update = running_statistics(1), jax.jit(RunningStatistics.update)
    for batch in plain:
        statistics = update(statistics, (place + size * batch).astype(np.float32))
    found = statistics.stage()((place + size * plain[-1]).astype(np.float32))
    expected = (plain[-1] - plain.mean()) / plain.std()
    np.testing.assert_allclose(found, expected if size else 0.0, atol=0.1 if place else 1e-3)


def test_normalising_by_hand():
    stage = NormaliseStage(mean=jnp.array([1.0, 0.0]), variance=jnp.array([4.0, 1e-12]))
    # (5 - 1) / 2 = 2, and 1 / sqrt(1e-12 + 1e-8) = 9999.5 is clipped to 10.
    np.testing.assert_allclose(stage(jnp.array([5.0, 1.0])), [2.0, 10.0], rtol=1e-6)
