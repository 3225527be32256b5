import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import swingup
from refusals import refusal
from swingup.controllers.baselines.baselines import baseline, shipped_reference
from swingup.controllers.baselines.optimal import OPTIMAL_SETTINGS
from swingup.controllers.swingups.design import RESTING_STATE, _cheapest
from swingup.controllers.swingups.ilqr import Solution
from swingup.controllers.swingups.transition import PendulumTransition, TorqueRateTransition
from swingup.dynamics.integrate import rk4_step
from swingup.plant.plant import LEADERBOARD
from swingup.plant.robots import ROBOTS

SCORES = {"acrobot": 0.711, "pendubot": 0.697}


def ramped(robot, dt=0.002):
    return TorqueRateTransition(PendulumTransition(LEADERBOARD.driven(robot), robot.joint, dt))


def test_score(robot):
    criteria = swingup.judge(baseline("tvlqr-score", robot), robot).criteria
    assert criteria.score >= SCORES[robot.name] - 0.01
    # Lifting both links from hanging to upright takes 2 g (m1 r1 + m2 (l1 + r2)) = 7.65 J.
    assert 7.6 < criteria.energy < 7.9


def test_no_small_change_of_the_torques_lowers_the_cost(x64, robot):
    reference, metadata = shipped_reference(robot, "score")
    problem, p, dt = OPTIMAL_SETTINGS[robot.name].swingup, LEADERBOARD.driven(robot), reference.dt
    rows, actuation = len(reference.torque), np.array(robot.actuation)

    @jax.jit
    @jax.vmap
    def follow(change):
        # Feedback keeps the changed motion near the old one, which is unstable.
        def step(x, row):
            middle, torque, gains, more = row
            u = torque + gains @ (x - middle) + more
            after = rk4_step(p, x, u * actuation, dt)
            return after, (after, u)

        rows = reference.states, reference.torque, reference.gains, change
        return jax.lax.scan(step, jnp.zeros(4), rows)[1]

    def costs(x, u, torque_weight):
        # The torque after the last row is not kept. It minimises rate (u_n - u_{n-1})²/dt + final_torque u_n².
        stiffness = problem.rate / dt
        last = u[:, -1] * stiffness / (stiffness + problem.final_torque)
        rate = np.diff(np.column_stack([u, last])) / dt
        angle_weight, _, velocity_weight, _ = problem.weights.state
        velocity = np.sum(x[:, :-1, 2:] ** 2, axis=(1, 2))  # at rest in the first row
        angle = np.sum((x[:, :-1, 0] - np.pi) ** 2, axis=1) + np.pi**2
        stages = velocity_weight * velocity + angle_weight * angle
        stages += torque_weight * np.sum(u**2, axis=1) + problem.rate * np.sum(rate**2, axis=1)
        final = (x[:, -1] - RESTING_STATE[:4]) ** 2 @ np.array(problem.weights.final)
        return dt * stages + final + problem.final_torque * last**2

    sines = np.sin(np.pi * np.arange(1, 7)[:, None] * np.linspace(0.0, 1.0, rows))
    changes = 1e-3 * np.random.default_rng(0).normal(size=(8, 6)) @ sines
    x, u = map(np.asarray, follow(np.concatenate([np.zeros((1, rows)), changes, -changes])))
    unchanged, *changed = costs(x, u, problem.weights.torque)
    assert unchanged == pytest.approx(metadata["cost"], rel=1e-6)
    assert min(changed) > unchanged - 1e-8
    # The same changes do find something to gain where torque costs twice as much.
    unchanged, *changed = costs(x, u, 2 * problem.weights.torque)
    assert min(changed) < unchanged - 1e-6


def test_the_torques_rate_moves_the_torque_only_in_its_own_step(x64):
    transition, x = ramped(ROBOTS["acrobot"]), (0.3, -0.2, 1.0, 2.0, 0.7)
    x = tuple(map(jnp.float64, x))
    np.testing.assert_allclose(transition.step(x, 5.0)[4], 0.7 + 0.002 * 5.0)
    np.testing.assert_allclose(transition.step(x, 5.0)[:4], transition.pendulum.step(x[:4], x[4]))
    columns = np.array(transition.jacobian(x, jnp.float64(5.0)))
    np.testing.assert_allclose(columns[5], [0, 0, 0, 0, 0.002])
    np.testing.assert_allclose(columns[:5, :4], transition.pendulum.jacobian(x[:4], x[4]), atol=1e-15)


def test_guesses_are_seeded_and_end_at_rest(robot):
    search = OPTIMAL_SETTINGS[robot.name].swingup.search
    torques = search.guesses(181, 3)
    assert torques.shape == (search.starts, 181)
    np.testing.assert_array_equal(torques, search.guesses(181, 3))
    assert np.abs(torques - search.guesses(181, 4)).max() > 0
    assert np.abs(torques[:, 0]).max() <= search.first_torque
    np.testing.assert_array_equal(torques[:, 144:], 0.0)


def test_the_cheapest_finite_start_is_taken():
    rows = jnp.arange(3.0)
    solutions = Solution(rows, rows, jnp.array([jnp.nan, 2.0, 1.0]), rows, rows, rows)
    assert _cheapest(solutions, 7).torque == 2.0
    hopeless = eqx.tree_at(lambda s: s.cost, solutions, jnp.full(3, jnp.nan))
    assert "no first torque of seed 7 leads to a finite cost: use another seed" in refusal(_cheapest, hopeless, 7)
