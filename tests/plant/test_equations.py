"""One formula serves all of Python; and the regression on base parameters, against motions and quadrature."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmark.independent import derivative, rk4
from swingup.controllers.swingups.transition import PendulumTransition, unpack
from swingup.dynamics import dynamics
from swingup.plant import equations
from swingup.plant.base_parameters import (
    BASE,
    base_covariance,
    base_parameters,
    feasible_fraction,
    geometry_of,
    lumped,
)
from swingup.plant.equations import ARRAYS, NUMPY
from swingup.plant.files import load_plant
from swingup.plant.momentum import inertial_row, mean_arctan, momentum_rows
from swingup.plant.plant import LEADERBOARD, lump

RANDOM = np.random.default_rng(0)
STATES = RANDOM.uniform(-1, 1, (200, 4)) * [7, 7, 12, 12]
TORQUES = RANDOM.uniform(-6, 6, 200)


def floats(plant, x, *u):
    """The formula in Python's floats, as the estimator's step calls it."""
    (sin1, _), (sin2, cos2) = NUMPY.sine_cosine(x[0]), NUMPY.sine_cosine(x[1])
    return equations.acceleration(plant, (sin1, sin2, NUMPY.sine_cosine(x[0] + x[1])[0]), cos2, x[2:], u)


@pytest.mark.parametrize("name", ["identified", "leaderboard"])
def test_all_of_python_computes_the_same(name, robot, x64):
    # Friction and motor inertia are part of the identified plant. Sines differ in their last bits.
    plant = load_plant("C.1") if name == "identified" else LEADERBOARD.driven(robot)
    u = np.outer(TORQUES, robot.actuation)
    expected = np.array([derivative(plant.values(), *row) for row in zip(STATES, u, strict=True)])
    close = {"rtol": 1e-12, "atol": 1e-11}
    found = jax.jit(jax.vmap(dynamics.derivative, (None, 0, 0)))(plant, jnp.asarray(STATES), jnp.asarray(u))
    np.testing.assert_allclose(found, expected, **close)
    transition = PendulumTransition(plant, robot.joint, 0.002)
    rates = jax.jit(transition.derivative)(unpack(jnp.asarray(STATES)), jnp.asarray(TORQUES))
    np.testing.assert_allclose(np.transpose(rates), expected, **close)
    if name == "leaderboard":
        rows = zip(STATES.tolist(), u.tolist(), strict=True)
        np.testing.assert_allclose(
            [floats(lump(plant), x, *torques) for x, torques in rows], expected[:, 2:], **close
        )


PLANT = dataclasses.replace(load_plant("C.1"), b1=0.02, b2=-0.03, cf1=0.1, cf2=-0.05)
GEOMETRY = geometry_of(PLANT)
RATIO = PLANT.m2 * PLANT.r2 / (PLANT.m1 * PLANT.r1 + PLANT.m2 * PLANT.l1)
TORQUE = (1.3, -0.4)


def motion(times, u):
    """Angles at some times from a swinging start, with constant torques; RK4 in steps of 0.1 ms."""
    x, now, angles = np.array([0.7, -0.4, 3.0, -5.0]), 0.0, []
    for time in times:
        for _ in range(round((time - now) / 1e-4)):
            x = rk4(PLANT.values(), x, np.array(u), 1e-4)
        now = time
        angles.append((x[0], x[1]))
    return angles


def rows_of(angles, times):
    return np.array(momentum_rows(*angles, times, GEOMETRY, RATIO, ARRAYS))


@pytest.mark.parametrize(
    ("times", "within"),
    [((0.002, 0.002), 2.5e-4), ((0.008, 0.008), 4e-3), ((0.008, 0.011), 4e-3), ((0.011, 0.008), 4e-3)],
)
def test_rows_give_the_torque(times, within):
    """Second order: the error grows with the square of the step, from 3e-3 N m at 8 ms."""
    angles = motion((0.02 - times[0], 0.02, 0.02 + times[1]), TORQUE)
    base = np.append(base_parameters(PLANT), [0.0, 0.0])  # no offsets
    assert rows_of(angles, times) @ base == pytest.approx(TORQUE, abs=within)
    # As if unequal times were alike, the error is 3 N m.
    assert times[0] == times[1] or np.abs(rows_of(angles, (0.0095, 0.0095)) @ base - TORQUE).max() > 1


def test_accelerations_take_the_mass_matrix_in_rows():
    q2, acceleration = 0.7, np.array([3.0, -2.0])
    rows = [inertial_row(joint, tuple(acceleration), math.cos(q2), GEOMETRY) for joint in (0, 1)]
    m11, m12, m22 = equations.mass_entries(lump(PLANT), math.cos(q2))
    torques = np.array(rows) @ base_parameters(PLANT)
    assert torques == pytest.approx([[m11, m12], [m12, m22]] @ acceleration, rel=1e-12)


@pytest.mark.parametrize("wrong", [(0.002, 0.0), (0.0, 0.002), (0.002, -0.003)])
def test_rows_take_offsets_into_account(wrong):
    """Offsets (rad) that are too small for their squares; without κ1 and κ2 the torque is wrong by more."""
    times, base = (0.002, 0.002), base_parameters(PLANT)
    angles = np.array(motion((0.018, 0.02, 0.022), TORQUE))
    tilts = base[3] * wrong[0], base[2] * sum(wrong)
    rows = rows_of(angles + wrong, times)
    true = rows_of(angles, times)[:, :BASE] @ base
    assert rows @ np.append(base, tilts) == pytest.approx(true, abs=1e-4)
    assert np.abs(rows[:, :BASE] @ base - true).max() > 2e-3


@pytest.mark.parametrize(("start", "end"), [(-0.3, 0.2), (0.01, 0.02), (5.0, 5.0002), (0.004, 0.004), (-2.0, 2.0)])
def test_mean_of_friction(start, end):
    rates = np.linspace(start, end, 200_001)
    assert mean_arctan(start, end, ARRAYS) == pytest.approx(np.arctan(100 * rates).mean(), abs=3e-4)


def test_base_parameters_hold_the_plant_and_have_the_covariance_of_drawn_ones():
    """The derivatives are exact in single changes: θ is linear in each parameter but r2, m2 and r1 together."""
    assert lumped(base_parameters(PLANT), GEOMETRY) == pytest.approx(lump(PLANT), rel=1e-14)
    columns = []
    for name in ("I1", "I2", "m2", "r1", "r2"):
        changed = dataclasses.replace(PLANT, **{name: 1.25 * getattr(PLANT, name)})
        columns.append(base_parameters(changed) - base_parameters(PLANT))
    own = np.diag([0.1, 0.1, 0.2, 0.2, 1e-4])
    jacobian = np.column_stack([*columns, np.vstack([np.zeros((4, 5)), own])])
    np.testing.assert_allclose(base_covariance(PLANT), jacobian @ jacobian.T, rtol=1e-12, atol=1e-18)


def least_eigenvalue(theta, nominal):
    """Of M(θ0)⁻¹ M(θ), the least over many elbow angles."""
    least = math.inf
    for cos2 in np.linspace(-1, 1, 41):
        (n11, n12, n22), (m11, m12, m22) = (
            equations.mass_entries(lumped(plant, GEOMETRY), cos2) for plant in (nominal, theta)
        )
        ratio = np.linalg.solve([[n11, n12], [n12, n22]], [[m11, m12], [m12, m22]])
        least = min(least, np.linalg.eigvals(ratio).real.min())
    return least


def test_mass_matrix_stays_positive_definite():
    random, nominal = np.random.default_rng(3), base_parameters(PLANT)
    cut = 0
    for _ in range(50):
        theta = nominal * (1 + random.normal(size=BASE))
        share = feasible_fraction(theta, nominal, GEOMETRY, 0.2, min, math.sqrt)
        allowed = nominal + share * (theta - nominal)
        assert 0 < share <= 1
        # Exactly as far as it may, or all the way.
        assert least_eigenvalue(allowed, nominal) >= 0.2 - 1e-9
        if share < 1:
            cut += 1
            assert least_eigenvalue(allowed, nominal) == pytest.approx(0.2, abs=1e-9)
    assert 5 < cut < 50
