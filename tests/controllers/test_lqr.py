import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from swingup.controllers.baselines.lqr import disturbance_gain, linearised, riccati_recursion, upright_lqr
from swingup.controllers.baselines.published import PUBLISHED_SETTINGS
from swingup.dynamics.angles import UPRIGHT
from swingup.dynamics.integrate import rk4_step
from swingup.plant.plant import LEADERBOARD
from swingup.plant.robots import ROBOTS

RANDOM = np.random.default_rng(0)


@pytest.fixture
def lqr(robot):
    return upright_lqr(LEADERBOARD.driven(robot), robot, PUBLISHED_SETTINGS[robot.name].lqr)


@pytest.fixture
def upright_system(robot):
    A, B = linearised(LEADERBOARD.driven(robot), robot, UPRIGHT[None], np.zeros(1))
    return A[0], B[0]


def test_riccati_equation_holds(robot, lqr, upright_system):
    (A, B), S, settings = upright_system, lqr.cost_to_go, PUBLISHED_SETTINGS[robot.name].lqr
    Q, R = np.diag(settings.state_weights), settings.torque_weight
    residual = A.T @ S + S @ A - np.outer(S @ B, S @ B) / R + Q
    assert np.abs(residual).max() < 1e-9 * np.abs(S).max()
    np.testing.assert_allclose(lqr.gains, B @ S / R)
    assert np.linalg.eigvals(A - np.outer(B, lqr.gains)).real.max() < 0


def test_gain_of_a_disturbance_is_that_of_a_regulator_whose_state_it_is(robot, lqr, upright_system):
    (A, B), settings = upright_system, PUBLISHED_SETTINGS[robot.name].lqr
    other = ROBOTS["pendubot" if robot.name == "acrobot" else "acrobot"]
    _, (D,) = linearised(LEADERBOARD.driven(robot), other, UPRIGHT[None], np.zeros(1))
    # The disturbance fades, but slowly: one that stays has no finite cost.
    with_it = np.block([[A, D[:, None]], [np.zeros((1, 4)), -1e-7 * np.eye(1)]])
    driving, Q = np.append(B, 0.0), np.diag([*settings.state_weights, 0.0])
    S = solve_continuous_are(with_it, driving[:, None], Q, [[settings.torque_weight]])
    gains = driving @ S / settings.torque_weight
    np.testing.assert_allclose(gains[:4], lqr.gains, rtol=1e-6)
    assert disturbance_gain(LEADERBOARD.driven(robot), lqr) == pytest.approx(gains[4], rel=1e-4)


def test_balances_and_gives_up_far_away(x64, robot, lqr):
    p = LEADERBOARD.driven(robot)

    def step(x, _):
        _, u = lqr(None, jnp.zeros(()), x)
        return rk4_step(p, x, u, 0.002), u

    turns = np.array([2 * np.pi, -2 * np.pi, 0.0, 0.0])
    start = UPRIGHT + turns + [0.02, -0.02, 0.1, -0.1]
    x, u = map(np.asarray, jax.jit(lambda x: jax.lax.scan(step, x, length=4000))(start))
    assert np.abs(u[:, robot.joint]).max() <= 6.0
    assert (u[:, 1 - robot.joint] == 0.0).all()
    np.testing.assert_allclose(x, UPRIGHT + turns, atol=1e-3)
    _, u = jax.jit(step)(jnp.array([0.0, 0.0, 30.0, 0.0]), None)  # far away
    assert not u.any()


def test_recursion_against_an_independent_one():
    # In another form: P ← Q + Aᵀ (P⁻¹ + B R⁻¹ Bᵀ)⁻¹ A, which needs no gains.
    n, R = 30, 0.7
    A, B = np.eye(4) + 0.1 * RANDOM.normal(size=(n, 4, 4)), RANDOM.normal(size=(n, 4))
    Q, P = np.diag([1.0, 2.0, 0.3, 0.1]), np.diag([5.0, 1.0, 1.0, 2.0])
    gains, _ = riccati_recursion(A, B, Q, R, P)
    for i in reversed(range(n)):
        inner = np.linalg.inv(np.linalg.inv(P) + np.outer(B[i], B[i]) / R)
        # R⁻¹ Bᵀ (P⁻¹ + B R⁻¹ Bᵀ)⁻¹ = (R + Bᵀ P B)⁻¹ Bᵀ P
        np.testing.assert_allclose(gains[i], B[i] @ inner @ A[i] / R, rtol=1e-9, atol=1e-12)
        P = Q + A[i].T @ inner @ A[i]


def test_recursion_against_disturbances_is_that_of_a_state_that_stays_1():
    n, R = 20, 0.7
    A, (B, d) = np.eye(4) + 0.1 * RANDOM.normal(size=(n, 4, 4)), RANDOM.normal(size=(2, n, 4))
    Q, Qf = np.diag([1.0, 2.0, 0.3, 0.1]), np.diag([5.0, 1.0, 1.0, 2.0])
    found = riccati_recursion(A, B, Q, R, Qf, d)
    # [x, 1] needs no disturbance, and its last gain is the torque.
    P, wider = np.zeros((5, 5)), np.zeros((5, 5))
    P[:4, :4], wider[:4, :4] = Qf, Q
    for i in reversed(range(n)):
        C = np.block([[A[i], d[i][:, None]], [np.zeros((1, 4)), np.ones((1, 1))]])
        D = np.append(B[i], 0.0)
        gains = D @ P @ C / (R + D @ P @ D)
        np.testing.assert_allclose([*found[0][i], found[1][i]], gains, rtol=1e-8, atol=1e-10)
        P = wider + C.T @ P @ (C - np.outer(D, gains))
