import jax.numpy as jnp
import numpy as np
import pytest

from swingup.controllers.baselines.piecewise_cubic import fit_piecewise_cubic

TIME = 0.01 * np.arange(103)
VALUES = np.column_stack([np.sin(5 * TIME), np.random.default_rng(0).normal(size=TIME.size)])


@pytest.fixture
def fit():
    return fit_piecewise_cubic(TIME, VALUES, 10)


def test_each_piece_is_the_least_squares_cubic(x64, fit):
    # 103 samples in 10 pieces: three of 11, then seven of 10.
    pieces = np.array_split(np.arange(103), 10)
    assert [len(piece) for piece in pieces] == [11] * 3 + [10] * 7
    for piece in pieces:
        for channel in range(2):
            cubic = np.polyfit(TIME[piece], VALUES[piece, channel], 3)
            fitted = [float(fit(jnp.asarray(t))[channel]) for t in TIME[piece]]
            np.testing.assert_allclose(fitted, np.polyval(cubic, TIME[piece]), atol=1e-9)


def test_a_cubic_is_reproduced(x64):
    cubic = np.polyval([3.0, -2.0, 1.0, 0.5], TIME)[:, None]
    exact = fit_piecewise_cubic(TIME, cubic, 4)
    assert float(exact(jnp.asarray(0.333))[0]) == pytest.approx(np.polyval([3.0, -2.0, 1.0, 0.5], 0.333), abs=1e-12)


def test_ends_are_held(x64, fit):
    np.testing.assert_array_equal(fit(jnp.asarray(-1.0)), fit(jnp.asarray(0.0)))
    np.testing.assert_array_equal(fit(jnp.asarray(9.0)), fit(jnp.asarray(TIME[-1])))


def test_between_two_pieces_the_later_one_holds(x64, fit):
    piece = np.arange(11, 22)
    cubic = np.polyfit(TIME[piece], VALUES[piece, 1], 3)
    assert float(fit(jnp.asarray(0.105))[1]) == pytest.approx(np.polyval(cubic, 0.105), abs=1e-9)
