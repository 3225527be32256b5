import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.dynamics.trigonometry import arctan, sine_cosine


@pytest.mark.parametrize("size", [1.0, 100.0, 1e5])
def test_sine_and_cosine(x64, size):
    angles = np.random.default_rng(0).uniform(-size, size, 10_000)
    sine, cosine = sine_cosine(jnp.asarray(angles))
    np.testing.assert_allclose(sine, np.sin(angles), atol=4e-16)
    np.testing.assert_allclose(cosine, np.cos(angles), atol=4e-16)
    slopes = jax.jvp(sine_cosine, (jnp.asarray(angles),), (jnp.ones(angles.size),))[1]
    np.testing.assert_allclose(slopes, [np.cos(angles), -np.sin(angles)], atol=4e-16)


def test_single_precision_is_the_librarys():
    angles = jnp.linspace(-100, 100, 1001, dtype=jnp.float32)
    sine, cosine = sine_cosine(angles)
    np.testing.assert_array_equal(sine, jnp.sin(angles))
    np.testing.assert_array_equal(cosine, jnp.cos(angles))


def test_arctangent(x64):
    random = np.random.default_rng(0)
    edges = [0.0, 7 / 16, 1.0, np.tan(np.pi / 8), np.tan(3 * np.pi / 8), 1e150, np.inf, np.nan]
    values = np.concatenate([random.normal(size=10_000) * 10 ** random.uniform(-9, 9, 10_000), edges])
    values = np.concatenate([values, -values])
    found = arctan(jnp.asarray(values))
    np.testing.assert_allclose(found, np.arctan(values), rtol=4e-16)
    slopes = jax.jvp(arctan, (jnp.asarray(values),), (jnp.ones(values.size),))[1]
    np.testing.assert_allclose(slopes, 1 / (1 + values**2), rtol=4e-16)


def test_arctangent_in_single_precision():
    values = jnp.linspace(-100, 100, 1001, dtype=jnp.float32)
    found = arctan(values)
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, np.arctan(np.asarray(values, float)), rtol=3e-7)
