"""One formula serves all of Python: JAX's dynamics, iLQR's transition, NumPy's arrays and plain floats."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.controllers.swingups.scalar_algebra import unpack
from swingup.controllers.swingups.transition import PendulumTransition
from swingup.dynamics import dynamics
from swingup.plant import equations
from swingup.plant.equations import lump
from swingup.plant.maths import NUMPY
from swingup.plant.plant import LEADERBOARD, load_plant

RANDOM = np.random.default_rng(0)
STATES = RANDOM.uniform(-1, 1, (200, 4)) * [7, 7, 12, 12]
TORQUES = RANDOM.uniform(-6, 6, 200)


def floats(plant, x, *u):
    """The formula in Python's floats, as the estimator's step calls it."""
    (sin1, _), (sin2, cos2) = NUMPY.sine_cosine(x[0]), NUMPY.sine_cosine(x[1])
    return equations.acceleration(plant, (sin1, sin2, NUMPY.sine_cosine(x[0] + x[1])[0]), cos2, x[2:], u)


def numpys(parameters, x, u, sine=np.sin, cosine=np.cos):
    """The formula in NumPy, with a batch as rows."""
    q1, q2, dq1, dq2 = x.T
    p, sines = parameters, (sine(q1), sine(q2), sine(q1 + q2))
    losses = [equations.friction(b, cf, v, np.arctan) for b, cf, v in ((p.b1, p.cf1, dq1), (p.b2, p.cf2, dq2))]
    return np.stack(equations.acceleration(lump(p), sines, cosine(q2), (dq1, dq2), u, losses), axis=1)


@pytest.mark.parametrize("name", ["identified", "leaderboard"])
def test_all_of_python_computes_the_same(name, robot, x64):
    # Friction and motor inertia are part of the identified plant. Sines differ in their last bits.
    plant = load_plant("C.1") if name == "identified" else LEADERBOARD.driven(robot)
    u = TORQUES * np.array(robot.actuation)[:, None]
    expected = numpys(plant, STATES, u)
    close = {"rtol": 1e-12, "atol": 1e-11}
    found = jax.jit(jax.vmap(dynamics.acceleration, (None, 0, 0)))(plant, jnp.asarray(STATES), jnp.asarray(u.T))
    np.testing.assert_allclose(found, expected, **close)
    transition = PendulumTransition(plant, robot.joint, 0.002)
    rates = jax.jit(transition.derivative)(unpack(jnp.asarray(STATES)), jnp.asarray(TORQUES))
    np.testing.assert_allclose(np.transpose(rates[2:]), expected, **close)
    np.testing.assert_array_equal(np.transpose(rates[:2]), STATES[:, 2:])


def test_plain_floats_have_numpys_bits():
    plant = dataclasses.replace(load_plant("C.1"), b1=0.0, b2=0.0, cf1=0.0, cf2=0.0, Ir=0.0)
    torques = np.stack([TORQUES, TORQUES[::-1]])
    rows = zip(STATES.tolist(), *torques.tolist(), strict=True)
    found = [floats(lump(LEADERBOARD), x, *u) for x, *u in rows]
    # The sines of the C library, bit for bit: NumPy has its own on some processors.
    sine, cosine = np.vectorize(math.sin), np.vectorize(math.cos)
    np.testing.assert_array_equal(found, numpys(plant, STATES, torques, sine, cosine))


def test_the_response_is_the_change_of_the_acceleration():
    plant = lump(LEADERBOARD)
    for x in STATES[:3].tolist():
        driven, free = (np.array(floats(plant, x, *u)) for u in ((2.0, -1.0), (0.0, 0.0)))
        response = equations.response(plant, np.cos(x[1]), (2.0, -1.0))
        np.testing.assert_allclose(driven - free, response, rtol=1e-10)
