"""The loop of the simulated robot, against closed forms."""

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np

from swingup.loop.disturbance import Pushes, motor_torques, step_noise, undisturbed
from swingup.loop.domain import load_domain
from swingup.loop.draw import draw
from swingup.loop.effects import Effects, rate_limited, ripple_torque
from swingup.loop.loop import LOOP_DT, Loop
from swingup.plant.robots import get_robot


def test_a_motor_by_hand():
    loop = Loop(rate_limit=1500.0, ripple=0.1, ripple_periods=36.0)
    before, wanted = jnp.array([0.0, -2.0]), jnp.array([6.0, -2.5])
    q = jnp.array([math.pi / 72, 0.0])  # a quarter of a period
    np.testing.assert_allclose(rate_limited(loop, wanted, before, 0.002), [3.0, -2.5], rtol=1e-6)
    np.testing.assert_allclose(ripple_torque(loop, q), [0.1, 0.0], rtol=1e-6)


LIMITS = np.array([6.0, 0.5])
CALM = dataclasses.replace(undisturbed(), effects=Effects(motors=True))


@functools.partial(jax.jit, static_argnums=4)
def torques(disturbance, command, q, noise, steps):
    """What acts, and the motors' own, in steps of 2 ms at fixed angles with command and noise held."""

    x = jnp.concatenate([q, jnp.zeros(2)])

    def step(motors, k):
        acting, motors = motor_torques(disturbance, command, motors, k * LOOP_DT, noise, LIMITS, x, LOOP_DT)
        return motors, (acting, motors)

    return jax.lax.scan(step, jnp.zeros(2), jnp.arange(steps))[1]


def test_ripple_and_noise_at_rest_do_not_integrate():
    """A slow motor with 10 N m/s and a command of 0: its own torque stays 0, whatever acts beside it."""
    disturbance = CALM.changed(response=0.5, rate_limit=10.0, ripple=0.1)
    q = jnp.array([math.pi / 72, -math.pi / 72])  # a quarter of a period
    acting, own = torques(disturbance, jnp.zeros(2), q, jnp.full(2, 0.02), 10)
    np.testing.assert_allclose(acting, [[0.12, -0.08]] * 10, rtol=1e-6)
    np.testing.assert_array_equal(own, 0.0)


def test_a_push_adds_to_a_motor_that_hardly_moves():
    """At 10 N m/s a motor gains 0.02 N m a step: after k steps at a command of 6 N m, 0.02 k and the push act."""
    pushes = Pushes(np.full((2, 1), 0.01), np.full((2, 1), 0.01), np.array([[1.0], [0.0]]))
    disturbance = dataclasses.replace(CALM.changed(rate_limit=10.0), pushes=pushes)
    acting, _ = torques(disturbance, jnp.array([6.0, 0.0]), jnp.zeros(2), jnp.zeros(2), 400)
    k = np.arange(400)
    push = np.exp(-0.5 * ((0.002 * k - 0.01) / 0.01) ** 2)
    np.testing.assert_allclose(acting[:, 0], np.minimum(0.02 * (k + 1), 6.0) + push, rtol=1e-4)
    assert float(acting.max()) <= 7.0


def test_each_motor_has_its_own_noise():
    disturbance = CALM.changed(torque_noise=0.5)
    noise = jax.jit(jax.vmap(lambda k: step_noise(disturbance, k, jnp.dtype("float32"))[1]))(jnp.arange(5000))
    # Standard errors of 5,000 draws: deviations 0.005, the correlation 0.014.
    np.testing.assert_allclose(noise.std(axis=0), 0.5, atol=0.025)
    assert abs(float(np.corrcoef(noise.T)[0, 1])) < 0.07


def test_plants_and_loops_differ():
    domain, robot = load_domain("randomised"), get_robot("acrobot")
    plants, loops = jax.jit(jax.vmap(lambda key: draw(domain, key, robot)))(jax.random.split(jax.random.key(0), 50))
    assert len(np.unique(plants.cf1)) == len(np.unique(loops.loop.response)) == 50
    assert 0.08 <= float(plants.cf1.min()) < float(plants.cf1.max()) <= 0.2
