"""Angles wrapped about upright, against values by hand; sines and arctangents beside NumPy's."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.dynamics.angles import UPRIGHT, wrap, wrap_difference
from swingup.dynamics.trigonometry import arctan, sine_cosine

PI = np.pi


def test_wrapped_states_by_hand(x64):
    """q1 to [0, 2π) and q2 to [-π, π): the ends belong to the ranges once."""
    for q, wrapped in (
        ((0, 0), (0, 0)),
        ((-0.1, PI + 0.1), (2 * PI - 0.1, -PI + 0.1)),
        ((2 * PI + 0.1, PI), (0.1, -PI)),
        ((7 * PI, -8.5 * PI), (PI, -PI / 2)),
    ):
        np.testing.assert_allclose(wrap(jnp.array([*q, 30.0, -40.0])), [*wrapped, 30.0, -40.0], atol=1e-12)
    np.testing.assert_array_equal(wrap(jnp.asarray(UPRIGHT)), UPRIGHT)


def test_differences_are_the_same_in_numpy_and_jax(x64):
    angles = np.random.default_rng(0).uniform(-30, 30, (100, 2))
    found = wrap_difference(angles)
    assert isinstance(found, np.ndarray)
    assert np.all((found >= -PI) & (found < PI))
    np.testing.assert_array_equal(found, wrap_difference(jnp.asarray(angles)))
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * angles), atol=1e-13)


@functools.partial(jax.jit, static_argnums=0)
def values_and_slopes(function, x):
    return jax.jvp(function, (x,), (jnp.ones_like(x),))


@pytest.mark.parametrize("size", [1.0, 100.0, 1e5])
def test_sine_and_cosine(x64, size):
    angles = np.random.default_rng(0).uniform(-size, size, 10_000)
    (sine, cosine), slopes = values_and_slopes(sine_cosine, angles)
    np.testing.assert_allclose(sine, np.sin(angles), atol=4e-16)
    np.testing.assert_allclose(cosine, np.cos(angles), atol=4e-16)
    np.testing.assert_allclose(slopes, [np.cos(angles), -np.sin(angles)], atol=4e-16)


def test_arctangent(x64):
    random = np.random.default_rng(0)
    edges = [0.0, 7 / 16, 1.0, np.tan(np.pi / 8), np.tan(3 * np.pi / 8), 1e150, np.inf, np.nan]
    values = np.concatenate([random.normal(size=10_000) * 10 ** random.uniform(-9, 9, 10_000), edges])
    values = np.concatenate([values, -values])
    found, slopes = values_and_slopes(arctan, values)
    np.testing.assert_allclose(found, np.arctan(values), rtol=4e-16)
    np.testing.assert_allclose(slopes, 1 / (1 + values**2), rtol=4e-16)


def test_in_single_precision_sines_are_the_librarys_and_arctangents_near():
    values = np.linspace(-100, 100, 1001, dtype=np.float32)
    np.testing.assert_array_equal(jax.jit(sine_cosine)(values), [jnp.sin(values), jnp.cos(values)])
    found = jax.jit(arctan)(values)
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, np.arctan(values.astype(float)), rtol=3e-7)
