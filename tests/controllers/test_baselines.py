"""Baselines: scores, regulators against independent Riccati equations, followers, the switch, and the MPC."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import swingup
from benchmark.controllers import Memoryless
from swingup.controllers.baselines.baselines import BASELINES, baseline, shipped_reference
from swingup.controllers.baselines.settings import PUBLISHED_SETTINGS
from swingup.controllers.baselines.tracking import (
    MPC,
    RiccatiController,
    fit_piecewise_cubic,
    riccati_recursion,
    tvlqr,
)
from swingup.controllers.baselines.upright import (
    AbstractExpensiveController,
    LatchingSwitch,
    linearised,
    upright_lqr,
)
from swingup.controllers.swingups.reference import Reference
from swingup.dynamics.dynamics import UPRIGHT
from swingup.dynamics.integrate import rk4_step
from swingup.plant.plant import LEADERBOARD, ROBOTS

ACROBOT = ROBOTS["acrobot"]
RANDOM = np.random.default_rng(0)

LEAST_SCORES = {
    "tvlqr": {"acrobot": 0.50, "pendubot": 0.52},
    "ilqr-riccati": {"acrobot": 0.39, "pendubot": 0.53},
    "tvlqr-score": {"acrobot": 0.701, "pendubot": 0.687},
    "ilqr-mpc": {"acrobot": 0.34, "pendubot": 0.35},
}
SWINGUP_TIME = {"acrobot": 4.05, "pendubot": 4.13}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name == "ilqr-mpc" else ()) for name in LEAST_SCORES]
)
def test_scores(robot, name):
    criteria = swingup.judge(baseline(name, robot), robot).criteria
    assert criteria.score >= LEAST_SCORES[name][robot.name]
    if name in ("tvlqr", "ilqr-riccati"):
        assert criteria.swingup_time == pytest.approx(SWINGUP_TIME[robot.name], abs=0.02)
    if name == "tvlqr-score":
        # Lifting both links from hanging to upright takes 2 g (m1 r1 + m2 (l1 + r2)) = 7.65 J.
        assert 7.6 < criteria.energy < 7.9


def test_they_keep_double_precision_and_know_their_robot(robot):
    for controller in (baseline(name, robot) for name in BASELINES):
        assert controller.robot == robot
        for leaf in jax.tree.leaves(controller):
            assert isinstance(leaf, float) or (isinstance(leaf, np.ndarray) and leaf.dtype == np.float64)


@pytest.fixture
def lqr(robot):
    return upright_lqr(LEADERBOARD.driven(robot), robot, PUBLISHED_SETTINGS[robot.name].lqr)


def test_the_gains_are_those_of_the_cost_to_go(robot, lqr):
    plant, settings = LEADERBOARD.driven(robot), PUBLISHED_SETTINGS[robot.name].lqr
    (A,), (B,), _ = linearised(plant, robot, UPRIGHT[None], np.zeros(1))
    S, K = lqr.cost_to_go, lqr.gains
    np.testing.assert_allclose(K, B @ S / settings.torque_weight, rtol=1e-9)
    # The Riccati equation, as a Lyapunov equation of the closed loop.
    closed, cost = A - np.outer(B, K), np.diag(settings.state_weights) + settings.torque_weight * np.outer(K, K)
    np.testing.assert_allclose(closed.T @ S + S @ closed, -cost, atol=1e-6 * np.abs(S).max())


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


def test_recursion_against_disturbances_is_that_of_a_state_that_stays_1():
    n, R = 20, 0.7
    A, (B, d) = np.eye(4) + 0.1 * RANDOM.normal(size=(n, 4, 4)), RANDOM.normal(size=(2, n, 4))
    Q, Qf = np.diag([1.0, 2.0, 0.3, 0.1]), np.diag([5.0, 1.0, 1.0, 2.0])
    found = riccati_recursion(A, B, Q, R, Qf, d)
    np.testing.assert_array_equal(riccati_recursion(A, B, Q, R, Qf)[0], found[0])
    # [x, 1] needs no disturbance, and its last gain is the torque.
    P, wider = np.zeros((5, 5)), np.zeros((5, 5))
    P[:4, :4], wider[:4, :4] = Qf, Q
    for i in reversed(range(n)):
        C = np.block([[A[i], d[i][:, None]], [np.zeros((1, 4)), np.ones((1, 1))]])
        D = np.append(B[i], 0.0)
        gains = D @ P @ C / (R + D @ P @ D)
        np.testing.assert_allclose([*found[0][i], found[1][i]], gains, rtol=1e-8, atol=1e-10)
        P = wider + C.T @ P @ (C - np.outer(D, gains))


ROWS = 200
TIME = 0.001 * np.arange(ROWS)
STATES = np.column_stack([TIME**k for k in range(1, 5)])
REFERENCE = Reference(ACROBOT, 0.001, STATES, 1.0 - TIME**2, RANDOM.normal(size=(ROWS, 4)))
OFF = np.array([0.02, -0.01, 0.03, 0.05])


def torque(controller, t, x):
    _, u = controller(controller.init(), jnp.asarray(t), jnp.asarray(x))
    assert u[0] == 0.0
    return float(u[1])


def test_riccati_gains_of_the_nearest_row_do_not_wrap(x64):
    follower = RiccatiController(REFERENCE.dt, STATES, REFERENCE.torque, REFERENCE.gains, 6.0, ACROBOT)
    for t, row in ((0.0, 0), (0.0504, 50), (0.0506, 51), (0.199, 199), (7.0, 199)):
        expected = REFERENCE.torque[row] + REFERENCE.gains[row] @ OFF
        assert torque(follower, t, STATES[row] + OFF) == pytest.approx(expected, abs=1e-12)
    expected = REFERENCE.torque[3] + 2 * np.pi * REFERENCE.gains[3, 0]
    found = torque(follower, 0.003, STATES[3] + [2 * np.pi, 0, 0, 0])
    assert found == pytest.approx(np.clip(expected, -6, 6), abs=1e-9)
    assert abs(torque(follower, 0.0, [0, 0, 1e6, 0])) == 6.0


def test_tvlqr(x64):
    # Rows that are cubic in time, so that the fit is exact but for the state's fourth entry and the gains.
    p, Q, R, Qf = LEADERBOARD.driven(ACROBOT), np.diag([0.64, 0.56, 0.13, 0.037]), 0.82, np.eye(4)
    controller = tvlqr(REFERENCE, p, ACROBOT, (Q, R, Qf), pieces=40)
    A, B, _ = linearised(p, ACROBOT, REFERENCE.states, REFERENCE.torque)
    gains, _ = riccati_recursion(np.eye(4) + 0.001 * A, 0.001 * B, Q, R, Qf)
    for row in (0, 77, 199):
        t, x = float(TIME[row]), REFERENCE.states[row]
        assert torque(controller, t, x) == pytest.approx(REFERENCE.torque[row], abs=1e-6)
        expected = REFERENCE.torque[row] - gains[row] @ OFF
        assert torque(controller, t, x + OFF) == pytest.approx(expected, abs=1e-5)
        assert torque(controller, t, x + OFF + [2 * np.pi, -4 * np.pi, 0, 0]) == pytest.approx(expected, abs=1e-5)
    assert torque(controller, 9.0, REFERENCE.states[-1]) == pytest.approx(REFERENCE.torque[-1], abs=1e-6)


def test_each_piece_is_the_least_squares_cubic(x64):
    moments = 0.01 * np.arange(103)
    values = np.column_stack([np.sin(5 * moments), RANDOM.normal(size=103)])
    fit = fit_piecewise_cubic(moments, values, 10)
    # 103 samples in 10 pieces: three of 11, then seven of 10.
    pieces = np.array_split(np.arange(103), 10)
    assert [len(piece) for piece in pieces] == [11] * 3 + [10] * 7
    for piece in pieces:
        for channel in range(2):
            cubic = np.polyfit(moments[piece], values[piece, channel], 3)
            fitted = [float(fit(jnp.asarray(t))[channel]) for t in moments[piece]]
            np.testing.assert_allclose(fitted, np.polyval(cubic, moments[piece]), atol=1e-9)
            # Between two pieces the later one holds; the ends are held.
            before = piece[0] * 0.01 - 0.005 * (piece[0] > 0)
            assert float(fit(jnp.asarray(before))[channel]) == pytest.approx(np.polyval(cubic, before), abs=1e-9)
    np.testing.assert_array_equal(fit(jnp.asarray(-1.0)), fit(jnp.asarray(0.0)))
    np.testing.assert_array_equal(fit(jnp.asarray(9.0)), fit(jnp.asarray(moments[-1])))


THRESHOLD = np.array([0.5, 0.5, 1.0, 1.0])
AWAY, UP = np.zeros(4), UPRIGHT


class Counting(AbstractExpensiveController):
    """Counts the calls that were not idle."""

    def init(self):
        return jnp.array(0)

    def control(self, carry, t, x, idle):
        return carry + jnp.where(idle, 0, 1), jnp.array([0.0, 1.0])


def torques(controller, states):
    memory, answers = controller.init(), []
    for x in states:
        memory, u = controller(memory, jnp.zeros(()), jnp.asarray(x))
        answers.append(float(u[1]))
    return answers, memory


def constant(torque):
    return Memoryless(lambda t, x: jnp.array([0.0, torque]))


def test_all_four_have_to_be_near_by_whole_turns(x64):
    controller = LatchingSwitch(constant(1.0), constant(2.0), THRESHOLD, ACROBOT)
    for error in np.diag(1.01 * THRESHOLD):
        assert torques(controller, [UP + error, UP - error])[0] == [1.0, 1.0]
        assert torques(controller, [UP + 0.98 * error])[0] == [2.0]
    # The threshold is strict.
    assert torques(controller, [UP + np.array([0, 0, 1.0, 0])])[0] == [1.0]
    assert torques(controller, [UP + np.array([0, 0, np.nextafter(1.0, 0.0), 0])])[0] == [2.0]
    for turns in ((2, 0), (-2, 0), (0, 2), (4, -6)):
        assert torques(controller, [UP + np.pi * np.array([*turns, 0, 0])])[0] == [2.0]


def test_never_switches_back_and_a_sparing_controller_learns_that_it_is_idle(x64):
    sparing = LatchingSwitch(Counting(), constant(2.0), THRESHOLD, ACROBOT)
    answers, memory = torques(sparing, [AWAY, AWAY, UP, AWAY, UP])
    assert answers == [1.0, 1.0, 2.0, 2.0, 2.0]
    assert memory.first == 2


@pytest.fixture(scope="module")
def mpc():
    """The shipped one, but along the trajectory itself, not its fit with jumps."""
    controller, (reference, _) = baseline("ilqr-mpc", ACROBOT), shipped_reference(ACROBOT)
    assert isinstance(controller, LatchingSwitch)
    shipped = controller.first
    return MPC(shipped.transition, reference.states[::2], reference.torque[::2], shipped.settings, ACROBOT)


@pytest.fixture(scope="module")
def answer(mpc):
    """One compiled call for a batch: times are common, states, plans and idleness are each lane's own."""
    batched = jax.jit(jax.vmap(mpc.control, in_axes=(0, None, 0, 0)))

    def call(plans, t, states, idle):
        with jax.enable_x64(True):
            return jax.tree.map(np.asarray, batched(jnp.asarray(plans), t, jnp.asarray(states), jnp.asarray(idle)))

    return call


def test_on_the_trajectory_it_returns_about_its_torque(mpc, answer):
    # At row 1800 it is fast, and hurries: the published goal is where the trajectory is a step after the horizon.
    for row, tolerance in ((0, 0.02), (700, 0.02), (1800, 0.25)):
        guess, states = np.tile(mpc.torque[row : row + 99], (3, 1)), np.tile(mpc.states[row], (3, 1))
        plans, u = answer(guess, 0.002 * row, states, [False, True, False])
        np.testing.assert_allclose(u[:, 1], mpc.torque[row], atol=tolerance)
        np.testing.assert_array_equal(u[:, 0], 0.0)
        # The rest of the plan, then the trajectory's torque a horizon on; the idle do not plan.
        assert plans.shape == (3, 99)
        np.testing.assert_array_equal(plans[:, -1], mpc.torque[row + 99])
        np.testing.assert_array_equal(plans[1, :-1], guess[1, 1:])
        assert (plans[::2, :-1] != guess[::2, 1:]).any(axis=1).all()


def test_after_the_trajectory_it_stays_upright(mpc, answer):
    aside = np.array([0.02, 0.0, 0.0, 0.0])
    states = np.array([UPRIGHT, UPRIGHT + aside, UPRIGHT - aside])
    for t in (5.9, 8.0):
        plans, u = answer(np.zeros((3, 99)), t, states, [False] * 3)
        assert u[0, 1] == pytest.approx(0.0, abs=1e-3)
        assert u[1, 1] == pytest.approx(-u[2, 1], abs=1e-2)
        assert abs(u[1, 1]) > 0.01
        np.testing.assert_array_equal(plans[:, -1], 0.0)


def test_answers_are_finite_whatever_it_sees(mpc, answer):
    states = np.array([[1e3, -1e3, 1e3, -1e3], [0, 0, 1e6, 0], [np.pi, 0, 0, 1e9]])
    plans, u = answer(np.zeros((3, 99)), 1.0, states, [False] * 3)
    assert np.isfinite(plans).all()
    assert (np.abs(u) <= 6.0).all()
