import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.physics.trigonometry import sine_cosine


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
