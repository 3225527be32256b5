import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.controllers.swingups.scalar_algebra import unpack
from swingup.controllers.swingups.transition import PendulumTransition
from swingup.dynamics.integrate import rk4_step
from swingup.plant.plant import LEADERBOARD, load_plant
from swingup.plant.robots import ROBOTS

ACROBOT = ROBOTS["acrobot"]
RANDOM = np.random.default_rng(0)
STATES = RANDOM.uniform(-1, 1, (40, 4)) * [4, 4, 10, 10]
TORQUES = RANDOM.uniform(-6, 6, 40)


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, None, None, 0, 0))
def judged(p, actuation, dt, x, u):
    """The judge's steps."""
    return rk4_step(p, x, u * jnp.asarray(actuation), dt)


def full_jacobian(transition):
    columns = jax.jit(transition.jacobian)(unpack(jnp.asarray(STATES)), jnp.asarray(TORQUES))
    return np.array([[np.broadcast_to(entry, len(STATES)) for entry in column] for column in columns]).T


def test_a_step_is_the_judges_runge_kutta_step(x64, robot):
    # Friction and motor inertia included.
    p = load_plant("C.1")
    x, u = unpack(jnp.asarray(STATES)), jnp.asarray(TORQUES)
    steps = judged(p, robot.actuation, 0.002, STATES, TORQUES)
    found = jax.jit(PendulumTransition(p, robot.joint, 0.002).step)(x, u)
    np.testing.assert_allclose(np.transpose(found), steps, rtol=1e-13, atol=1e-13)


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
