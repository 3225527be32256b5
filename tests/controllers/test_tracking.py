import jax.numpy as jnp
import numpy as np
import pytest

from swingup.controllers.baselines.lqr import linearised, riccati_recursion
from swingup.controllers.baselines.piecewise_cubic import fit_piecewise_cubic
from swingup.controllers.baselines.tracking import RiccatiController, tvlqr
from swingup.controllers.swingups.reference import Reference
from swingup.plant.plant import LEADERBOARD
from swingup.plant.robots import ROBOTS

ACROBOT = ROBOTS["acrobot"]
RANDOM = np.random.default_rng(0)
ROWS = 200
TIME = 0.001 * np.arange(ROWS)
STATES = np.column_stack([TIME**k for k in range(1, 5)])
REFERENCE = Reference(ACROBOT, 0.001, STATES, 1.0 - TIME**2, RANDOM.normal(size=(ROWS, 4)))
OFF = np.array([0.02, -0.01, 0.03, 0.05])


def torque(controller, t, x):
    _, u = controller(controller.init(), jnp.asarray(t), jnp.asarray(x))
    assert u[0] == 0.0
    return float(u[1])


@pytest.fixture
def riccati():
    return RiccatiController(REFERENCE.dt, REFERENCE.states, REFERENCE.torque, REFERENCE.gains, 6.0, ACROBOT)


@pytest.mark.parametrize(("t", "row"), [(0.0, 0), (0.0504, 50), (0.0506, 51), (0.199, 199), (7.0, 199)])
def test_riccati_gains_of_the_nearest_row(x64, riccati, t, row):
    expected = REFERENCE.torque[row] + REFERENCE.gains[row] @ OFF
    assert torque(riccati, t, REFERENCE.states[row] + OFF) == pytest.approx(expected, abs=1e-12)


def test_riccati_gains_do_not_wrap(x64, riccati):
    turned = REFERENCE.states[3] + [2 * np.pi, 0, 0, 0]
    expected = REFERENCE.torque[3] + 2 * np.pi * REFERENCE.gains[3, 0]
    assert torque(riccati, 0.003, turned) == pytest.approx(np.clip(expected, -6, 6), abs=1e-9)
    assert abs(torque(riccati, 0.0, [0, 0, 1e6, 0])) == 6.0


def test_tvlqr(x64):
    # Rows that are cubic in time, so that the fit is exact but for the state's fourth entry and the gains.
    p, Q, R, Qf = LEADERBOARD.driven(ACROBOT), np.diag([0.64, 0.56, 0.13, 0.037]), 0.82, np.eye(4)
    controller = tvlqr(REFERENCE, p, ACROBOT, (Q, R, Qf), pieces=40)
    A, B = linearised(p, ACROBOT, REFERENCE.states, REFERENCE.torque)
    gains, _ = riccati_recursion(np.eye(4) + 0.001 * A, 0.001 * B, Q, R, Qf)
    for row in (0, 77, 199):
        t, x = float(TIME[row]), REFERENCE.states[row]
        assert torque(controller, t, x) == pytest.approx(REFERENCE.torque[row], abs=1e-6)
        expected = REFERENCE.torque[row] - gains[row] @ OFF
        assert torque(controller, t, x + OFF) == pytest.approx(expected, abs=1e-5)
        assert torque(controller, t, x + OFF + [2 * np.pi, -4 * np.pi, 0, 0]) == pytest.approx(expected, abs=1e-5)
    assert torque(controller, 9.0, REFERENCE.states[-1]) == pytest.approx(REFERENCE.torque[-1], abs=1e-6)


MOMENTS = 0.01 * np.arange(103)
VALUES = np.column_stack([np.sin(5 * MOMENTS), np.random.default_rng(0).normal(size=MOMENTS.size)])


@pytest.fixture
def fit():
    return fit_piecewise_cubic(MOMENTS, VALUES, 10)


def test_each_piece_is_the_least_squares_cubic(x64, fit):
    # 103 samples in 10 pieces: three of 11, then seven of 10.
    pieces = np.array_split(np.arange(103), 10)
    assert [len(piece) for piece in pieces] == [11] * 3 + [10] * 7
    for piece in pieces:
        for channel in range(2):
            cubic = np.polyfit(MOMENTS[piece], VALUES[piece, channel], 3)
            fitted = [float(fit(jnp.asarray(t))[channel]) for t in MOMENTS[piece]]
            np.testing.assert_allclose(fitted, np.polyval(cubic, MOMENTS[piece]), atol=1e-9)
            # Between two pieces the later one holds; the ends are held.
            before = piece[0] * 0.01 - 0.005 * (piece[0] > 0)
            assert float(fit(jnp.asarray(before))[channel]) == pytest.approx(np.polyval(cubic, before), abs=1e-9)
    np.testing.assert_array_equal(fit(jnp.asarray(-1.0)), fit(jnp.asarray(0.0)))
    np.testing.assert_array_equal(fit(jnp.asarray(9.0)), fit(jnp.asarray(MOMENTS[-1])))
