"""iLQR: a linear-quadratic problem in closed form, a swing far from linear, and the pendulum's transition."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.controllers.swingups.ilqr import (
    Cost,
    ILQRSettings,
    Status,
    feedback_gains,
    ilqr_iteration,
    initial_state,
    solve,
)
from swingup.controllers.swingups.transition import AbstractTransition, PendulumTransition, dot, unpack
from swingup.dynamics.dynamics import UPRIGHT
from swingup.dynamics.integrate import rk4_step
from swingup.plant.plant import LEADERBOARD, ROBOTS

N = 20
RANDOM = np.random.default_rng(0)
A = np.eye(4) + 0.1 * RANDOM.normal(size=(4, 4))
B = RANDOM.normal(size=4)
X0 = RANDOM.normal(size=4)
WEIGHTS = np.array([1.0, 0.5, 2.0, 0.1]), 0.3, np.array([5.0, 4.0, 3.0, 2.0])
TARGETS = RANDOM.normal(size=(N, 4)), RANDOM.normal(size=N), RANDOM.normal(size=4)
PLAIN = ILQRSettings(
    max_iterations=50, tolerance=1e-9, regularisation=0.0, min_regularisation=0.0, max_regularisation=1e6,
    torque_limit=np.inf,
)  # fmt: skip


class Linear(AbstractTransition):
    """x' = A x + B u, and a Jacobian that may be wrong."""

    sign: float = 1.0

    def step(self, x, u):
        return tuple(dot(tuple(map(float, row)), x) + float(b) * u for row, b in zip(A, B, strict=True))

    def jacobian(self, x, u):
        columns = [*A.T, self.sign * B]
        return tuple(tuple(jnp.full_like(u, entry) for entry in column) for column in columns)


def linear_cost():
    states, torque, final = TARGETS
    return Cost(WEIGHTS[0], WEIGHTS[1], WEIGHTS[2], states, torque, final)


def dense_solution():
    """The linear-quadratic problem as one least-squares problem in all torques."""
    powers = [np.linalg.matrix_power(A, i) for i in range(N + 1)]
    G = np.zeros((N + 1, 4, N))
    for i in range(N + 1):
        for j in range(i):
            G[i, :, j] = powers[i - 1 - j] @ B
    free = np.array([power @ X0 for power in powers])
    q, p, f = np.sqrt(WEIGHTS[0] / N), np.sqrt(WEIGHTS[1] / N), np.sqrt(WEIGHTS[2])
    rows = [*(q[:, None] * G[i] for i in range(N)), f[:, None] * G[N], p * np.eye(N)]
    aims = [*(q * (TARGETS[0][i] - free[i]) for i in range(N)), f * (TARGETS[2] - free[N]), p * TARGETS[1]]
    M, y = np.concatenate(rows), np.concatenate(aims)
    u = np.linalg.lstsq(M, y)[0]
    return u, np.sum((M @ u - y) ** 2)


@jax.jit
def solved(transition, cost, x0, torque, idle, settings):
    return solve(transition, cost, x0, torque, ILQRSettings(**settings), idle)


def run(settings, sign=1.0, x0=X0, torque=(0.0,) * N, idle=False):
    """Solve the linear-quadratic problem; one compiled program whatever the numbers are."""
    given = map(jnp.asarray, (x0, torque, idle))
    return solved(Linear(sign), linear_cost(), *given, dataclasses.asdict(settings))


def test_one_iteration_solves_a_linear_quadratic_problem(x64):
    u, least = dense_solution()
    once = run(dataclasses.replace(PLAIN, max_iterations=1))
    np.testing.assert_allclose(once.torque, u, atol=1e-9)
    assert once.cost == pytest.approx(least, rel=1e-10)
    assert once.status == Status.ITERATION_LIMIT
    solution = run(PLAIN)
    assert (solution.status, solution.iterations) == (Status.CONVERGED, 2)
    np.testing.assert_allclose(
        solution.states[1:], np.asarray(solution.states[:-1]) @ A.T + np.outer(u, B), atol=1e-9
    )


def test_gains_against_an_independent_recursion(x64):
    for mu in (0.0, 3.0):
        gains = jax.jit(feedback_gains)(Linear(), linear_cost(), jnp.zeros((N + 1, 4)), jnp.zeros(N), mu)
        P = np.diag(2 * WEIGHTS[2])
        for i in reversed(range(N)):
            K = -(B @ P @ A) / (2 * WEIGHTS[1] / N + B @ P @ B + mu)
            np.testing.assert_allclose(gains[i], K, rtol=1e-9)
            # The cost of u = K x, whether K is optimal or not.
            closed = A + np.outer(B, K)
            P = np.diag(2 * WEIGHTS[0] / N) + 2 * WEIGHTS[1] / N * np.outer(K, K) + closed.T @ P @ closed


def test_wrong_derivatives_stall(x64):
    solution = run(dataclasses.replace(PLAIN, regularisation=1.0), sign=-1.0)
    untouched = run(PLAIN, idle=True)
    assert solution.status == Status.STALLED
    # Doubled from 1 until 2^20 is clipped to 10^6, where the last attempt failed too.
    assert (solution.iterations, solution.regularisation) == (21, 1e6)
    assert solution.cost == untouched.cost
    np.testing.assert_array_equal(solution.torque, 0.0)


def test_on_a_swing_the_cost_falls_the_limit_holds_and_states_are_those_of_the_torques(x64):
    """60 iterations on a swing of 1 s with few steps, far from linear, with torques of up to 1.5 N m."""
    weights = np.array([1.0, 1.0, 0.1, 0.1]), 0.01, np.array([50.0, 50.0, 5.0, 5.0])
    cost = Cost(*weights, np.tile(UPRIGHT, (100, 1)), np.zeros(100), UPRIGHT)
    changes = {"regularisation": 1.0, "min_regularisation": 1e-4, "tolerance": 1e-6, "torque_limit": 1.5}
    settings, robot = dataclasses.replace(PLAIN, **changes), ROBOTS["pendubot"]
    transition = PendulumTransition(LEADERBOARD.driven(robot), robot.joint, 0.01, exact=False)

    def step(now, _):
        after = ilqr_iteration(transition, cost, now, settings)
        return after, (after.trajectory.cost, after.regularisation, jnp.abs(after.trajectory.u).max())

    first = initial_state(transition, cost, jnp.zeros(4), jnp.full(100, 0.1), settings)
    last, (costs, mu, largest) = jax.jit(lambda now: jax.lax.scan(step, now, length=60))(first)
    costs, mu = np.append(first.trajectory.cost, costs), np.append(first.regularisation, mu)
    accepted = mu[1:] < mu[:-1]
    assert 10 < accepted.sum() < 60
    assert (np.diff(costs)[accepted] < 0).all()
    assert (np.diff(costs)[mu[1:] > mu[:-1]] == 0).all()
    assert costs[-1] < 0.4 * costs[0]
    assert largest.max() == 1.5
    states, torque = (*last.trajectory.x, last.trajectory.last), last.trajectory.u
    x = np.column_stack([np.append(rows, end) for rows, end in zip(states[:4], states[4], strict=True)])
    following = jax.jit(transition.step)(unpack(jnp.asarray(x[:-1])), torque)
    np.testing.assert_allclose(x[1:], np.transpose(following), atol=1e-12)


def test_line_search_keeps_the_cheapest_step(x64):
    # Of a linear-quadratic problem the full step is the best one, in whatever order they are tried.
    def cost_after(*sizes):
        settings = dataclasses.replace(PLAIN, max_iterations=1, step_sizes=sizes)
        return float(run(settings).cost)

    least = dense_solution()[1]
    assert cost_after(0.1) > 1.1 * least
    assert cost_after(0.1, 1.0, 1.5) == pytest.approx(least, rel=1e-10)


ACROBOT = ROBOTS["acrobot"]
DRAWS = np.random.default_rng(0)
STATES = DRAWS.uniform(-1, 1, (40, 4)) * [4, 4, 10, 10]
TORQUES = DRAWS.uniform(-6, 6, 40)


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, None, None, 0, 0))
def judged(p, actuation, dt, x, u):
    return rk4_step(p, x, u * jnp.asarray(actuation), dt)


def full_jacobian(transition):
    columns = jax.jit(transition.jacobian)(unpack(jnp.asarray(STATES)), jnp.asarray(TORQUES))
    return np.array([[np.broadcast_to(entry, len(STATES)) for entry in column] for column in columns]).T


def finite_differences(p, robot, dt):
    columns = []
    for nudge in 1e-5 * np.eye(5):
        ahead, behind = (
            np.asarray(judged(p, robot.actuation, dt, STATES + s * nudge[:4], TORQUES + s * nudge[4]))
            for s in (1, -1)
        )
        columns.append((ahead - behind) / 2e-5)
    return np.stack(columns, axis=-1)


@pytest.mark.slow
def test_exact_jacobian_against_finite_differences(x64, robot):
    p = dataclasses.replace(LEADERBOARD.driven(robot), b1=0.1, cf2=0.05)
    jacobian = full_jacobian(PendulumTransition(p, robot.joint, 0.002))
    np.testing.assert_allclose(jacobian, finite_differences(p, robot, 0.002), atol=2e-7)


def test_fast_jacobian_is_right_up_to_second_order(x64):
    # An error of order dt³: an eighth of it at half the step.
    p, errors = LEADERBOARD.driven(ACROBOT), []
    for dt in (0.004, 0.002):
        fast = full_jacobian(PendulumTransition(p, ACROBOT.joint, dt, exact=False))
        errors.append(np.abs(fast - finite_differences(p, ACROBOT, dt)).max(axis=(1, 2)))
    assert np.median(errors[1]) < 1e-4
    assert np.median(errors[0] / errors[1]) == pytest.approx(8.0, rel=0.2)
