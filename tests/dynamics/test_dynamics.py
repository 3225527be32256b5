"""Dynamics beside the reference, other derivations and numbers by hand; angles, sines and arctangents."""

import dataclasses
import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.dynamics import dynamics
from swingup.dynamics.dynamics import UPRIGHT, wrap, wrap_difference
from swingup.dynamics.integrate import rk4_step
from swingup.dynamics.trigonometry import arctan, sine_cosine
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, NAMES, ROBOTS, Plant

DATA = Path(__file__).parent / "data"
PLANTS = {"identified": load_plant("C.1"), "leaderboard": LEADERBOARD.driven(ROBOTS["acrobot"])}

acceleration = jax.jit(jax.vmap(dynamics.acceleration, (None, 0, 0)))
total_energy = jax.jit(jax.vmap(dynamics.total_energy, (None, 0)))
derivative = jax.jit(dynamics.derivative)
linearise = jax.jit(dynamics.linearise)

pytestmark = pytest.mark.usefixtures("x64")


@pytest.fixture(params=PLANTS.values(), ids=PLANTS)
def plant(request):
    return request.param


def random_states(count=50, seed=0):
    generator = np.random.default_rng(seed)
    x = generator.uniform([-7, -7, -12, -12], [7, 7, 12, 12], (count, 4))
    u = generator.uniform(-6, 6, (count, 2))
    return jnp.array(x), jnp.array(u)


def test_accelerations_energies_and_steps_are_those_of_the_reference(robot):
    plant, file = load_plant("C.1"), DATA / f"dynamics-{robot.name}-friction.csv"
    table = np.genfromtxt(file, delimiter=",", names=True)
    x, u, rates, after = (
        np.stack([table[name] for name in names.split()], axis=1)
        for names in ("q1 q2 dq1 dq2", "u1 u2", "ddq1 ddq2", "q1_next q2_next dq1_next dq2_next")
    )
    step = jax.jit(jax.vmap(rk4_step, (None, 0, 0, None)))
    np.testing.assert_allclose(acceleration(plant, x, u), rates, rtol=0, atol=1e-9)
    np.testing.assert_allclose(total_energy(plant, x), table["energy"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(step(plant, x, u, 0.002), after, rtol=0, atol=1e-9)


def energies_from_positions(plant, q, dq):
    """T and V from the Cartesian motion of the two bodies and the spin of the two rotors."""
    p = plant

    def centres(q):
        elbow = p.l1 * jnp.array([jnp.sin(q[0]), -jnp.cos(q[0])])
        along_2 = jnp.array([jnp.sin(q[0] + q[1]), -jnp.cos(q[0] + q[1])])
        return jnp.stack([p.r1 / p.l1 * elbow, elbow + p.r2 * along_2])

    position, velocity = jax.jvp(centres, (q,), (dq,))
    masses = jnp.array([p.m1, p.m2])
    # Inertias about the joints become those about the centres of mass. Both motors sit in link 1's base: the
    # elbow's rotor turns backwards relative to link 1, gr times as fast as the elbow.
    spins = jnp.array([dq[0], dq[0] + dq[1], p.gr * dq[0], dq[0] - p.gr * dq[1]])
    inertias = jnp.array([p.I1 - p.m1 * p.r1**2, p.I2 - p.m2 * p.r2**2, p.Ir, p.Ir])
    kinetic = 0.5 * (masses @ jnp.sum(velocity**2, axis=1) + inertias @ spins**2)
    return kinetic, p.g * masses @ position[:, 1]


def euler_lagrange_acceleration(plant, x, u):
    """Solve d/dt ∂L/∂q̇ - ∂L/∂q = u - F(q̇) for q̈, all derivatives by automatic differentiation."""

    def lagrangian(q, dq):
        kinetic, potential = energies_from_positions(plant, q, dq)
        return kinetic - potential

    q, dq = x[:2], x[2:]
    momentum = jax.grad(lagrangian, argnums=1)
    mass, drift = jax.jacfwd(momentum, 1)(q, dq), jax.jacfwd(momentum, 0)(q, dq) @ dq
    friction = jnp.array([plant.b1, plant.b2]) * dq + jnp.array([plant.cf1, plant.cf2]) * jnp.arctan(100 * dq)
    return jnp.linalg.solve(mass, u - friction - drift + jax.grad(lagrangian)(q, dq))


def test_acceleration_solves_the_euler_lagrange_equations():
    # A different plant for each state: every parameter varies by up to 20 % around the identified one,
    # with the rotor's inertia and the viscous friction large enough to count.
    x, u = random_states()
    centre = dataclasses.replace(load_plant("C.1"), Ir=1e-3, b1=0.1, b2=0.05)
    factors = np.random.default_rng(1).uniform(0.8, 1.2, (len(NAMES), len(x)))
    values = {name: getattr(centre, name) * jnp.array(row) for name, row in zip(NAMES, factors, strict=True)}
    plants = Plant(**values)
    expected = jax.jit(jax.vmap(euler_lagrange_acceleration))(plants, x, u)
    found = jax.jit(jax.vmap(dynamics.acceleration))(plants, x, u)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_linearisation_agrees_with_central_differences(plant):
    # Away from rest, where the Coulomb friction's slope of 100 makes finite differences poor.
    x, u, step = jnp.array([0.4, -1.1, 2.0, -3.0]), jnp.array([1.0, -0.5]), 1e-5
    A, B = linearise(plant, x, u)

    def difference(e):
        ahead = derivative(plant, x + step * e[:4], u + step * e[4:])
        behind = derivative(plant, x - step * e[:4], u - step * e[4:])
        return (ahead - behind) / (2 * step)

    columns = np.stack([difference(e) for e in np.eye(6)], axis=1)
    np.testing.assert_allclose(np.hstack([A, B]), columns, rtol=1e-6, atol=1e-6)


def test_gradients_reach_the_plant():
    plant, (x, u) = load_plant("C.1"), random_states(count=1)
    gradient = jax.jit(jax.grad(lambda p: dynamics.acceleration(p, x[0], u[0])[0]))(plant)
    # The shoulder's damping acts as the torque -b1 dq1: ∂q̈1/∂b1 = -dq1 (M⁻¹)11 = -dq1 M22 / det M.
    M = np.asarray(dynamics.mass_matrix(plant, x[0]))
    assert float(gradient.b1) == pytest.approx(-float(x[0, 2]) * M[1, 1] / np.linalg.det(M), rel=1e-9)
    assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(gradient))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_results_have_the_dtype_of_the_state(dtype):
    x, u = jnp.array([0.1, 0.2, 0.3, 0.4], dtype), jnp.array([0.5, 0.6], dtype)
    of_state = dynamics.mass_matrix, dynamics.friction_torques, dynamics.total_energy, dynamics.tip_height
    of_both = dynamics.acceleration, dynamics.derivative, dynamics.linearise, functools.partial(rk4_step, dt=0.01)
    for functions, given in ((of_state, (x,)), (of_both, (x, u))):
        for function in functions:
            leaves = jax.tree.leaves(jax.eval_shape(function, load_plant("C.1"), *given))
            assert {leaf.dtype.name for leaf in leaves} == {dtype}, function


def test_wrapped_states_by_hand():
    """q1 to [0, 2π) and q2 to [-π, π): the ends belong to the ranges once."""
    for q, wrapped in (
        ((0, 0), (0, 0)),
        ((-0.1, np.pi + 0.1), (2 * np.pi - 0.1, -np.pi + 0.1)),
        ((2 * np.pi + 0.1, np.pi), (0.1, -np.pi)),
        ((7 * np.pi, -8.5 * np.pi), (np.pi, -np.pi / 2)),
    ):
        np.testing.assert_allclose(wrap(jnp.array([*q, 30.0, -40.0])), [*wrapped, 30.0, -40.0], atol=1e-12)
    np.testing.assert_array_equal(wrap(jnp.asarray(UPRIGHT)), UPRIGHT)


def test_differences_are_the_same_in_numpy_and_jax():
    angles = np.random.default_rng(0).uniform(-30, 30, (100, 2))
    found = wrap_difference(angles)
    assert isinstance(found, np.ndarray)
    assert np.all((found >= -np.pi) & (found < np.pi))
    np.testing.assert_array_equal(found, wrap_difference(jnp.asarray(angles)))
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * angles), atol=1e-13)


@functools.partial(jax.jit, static_argnums=0)
def values_and_slopes(function, x):
    return jax.jvp(function, (x,), (jnp.ones_like(x),))


@pytest.mark.parametrize("size", [1.0, 100.0, 1e5])
def test_sine_and_cosine(size):
    angles = np.random.default_rng(0).uniform(-size, size, 10_000)
    (sine, cosine), slopes = values_and_slopes(sine_cosine, angles)
    np.testing.assert_allclose(sine, np.sin(angles), atol=4e-16)
    np.testing.assert_allclose(cosine, np.cos(angles), atol=4e-16)
    np.testing.assert_allclose(slopes, [np.cos(angles), -np.sin(angles)], atol=4e-16)


def test_arctangent():
    random = np.random.default_rng(0)
    edges = [0.0, 7 / 16, 1.0, np.tan(np.pi / 8), np.tan(3 * np.pi / 8), 1e150, np.inf, np.nan]
    values = np.concatenate([random.normal(size=10_000) * 10 ** random.uniform(-9, 9, 10_000), edges])
    values = np.concatenate([values, -values])
    found, slopes = values_and_slopes(arctan, values)
    np.testing.assert_allclose(found, np.arctan(values), rtol=4e-16)
    np.testing.assert_allclose(slopes, 1 / (1 + values**2), rtol=4e-16)


def test_in_single_precision_sines_are_the_librarys_and_arctangents_near():
    values = np.linspace(-100, 100, 1001, dtype=np.float32)
    np.testing.assert_array_equal(jax.jit(sine_cosine)(values), [jnp.sin(values), jnp.cos(values)])
    found = jax.jit(arctan)(values)
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, np.arctan(values.astype(float)), rtol=3e-7)
