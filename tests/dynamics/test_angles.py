"""Angles wrapped about upright, against values by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from swingup.dynamics.angles import UPRIGHT, wrap, wrap_difference

PI = np.pi


@pytest.mark.parametrize(
    ("q", "wrapped"),
    [
        ((0, 0), (0, 0)),
        ((-0.1, PI + 0.1), (2 * PI - 0.1, -PI + 0.1)),
        ((2 * PI + 0.1, -PI - 0.1), (0.1, PI - 0.1)),
        ((7 * PI, -8.5 * PI), (PI, -PI / 2)),
    ],
)
def test_wrapped_states_by_hand(q, wrapped):
    found = wrap(jnp.array([*q, 30.0, -40.0]))
    np.testing.assert_allclose(found, [*wrapped, 30.0, -40.0], atol=5e-6)


def test_the_ends_of_the_ranges_belong_to_them_once(x64):
    # q1 to [0, 2π), q2 to [-π, π).
    x = wrap(jnp.array([-0.5, PI, 7.0, -7.0]))
    np.testing.assert_allclose(x, [2 * PI - 0.5, -PI, 7.0, -7.0])
    np.testing.assert_array_equal(wrap(jnp.asarray(UPRIGHT)), UPRIGHT)


def test_differences_are_the_same_in_numpy_and_jax(x64):
    angles = np.random.default_rng(0).uniform(-30, 30, (100, 2))
    found = wrap_difference(angles)
    assert isinstance(found, np.ndarray)
    assert np.all((found >= -PI) & (found < PI))
    np.testing.assert_array_equal(found, wrap_difference(jnp.asarray(angles)))
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * angles), atol=1e-13)
