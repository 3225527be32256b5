"""Dynamics beside the reference, other derivations and numbers by hand; sines and arctangents; and integrators."""

import dataclasses
import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ellipk

from identification.synthetic import step as implicit_step
from refusals import refusal
from swingup.dynamics import dynamics, integrate
from swingup.dynamics.dynamics import UPRIGHT, mass_matrix, wrap, wrap_difference
from swingup.dynamics.integrate import friction_rate, rk4_step, rk4_steps, stable_substeps
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


FRICTIONLESS = LEADERBOARD.driven(ROBOTS["acrobot"])


def test_open_loop_run_is_that_of_the_reference(robot):
    table = np.loadtxt(DATA / f"openloop-{robot.name}.csv", delimiter=",", skiprows=1)
    assert table.shape == (501, 5)
    t = 0.002 * np.arange(2501)
    u = np.outer(3 * np.sin(2 * np.pi * t) + 1.5 * np.sin(5.1 * t), robot.actuation)
    plant = LEADERBOARD.driven(robot)
    follow = jax.jit(lambda: jax.lax.scan(lambda x, u: (rk4_step(plant, x, u, 0.002), x), jnp.zeros(4), u))
    error = np.abs(follow()[1][::5] - table[:, 1:]).max(axis=1)
    # The motion is chaotic: two correct implementations part by some 4e-10 in 2 s and 4e-7 in 5 s.
    for until, tolerance in [(1.0, 1e-11), (2.0, 1e-9), (5.0, 1e-5)]:
        assert error[table[:, 0] <= until + 1e-9].max() < tolerance
    np.testing.assert_allclose(table[:, 0], t[::5], atol=1e-12)


def test_large_swing_has_the_period_of_the_elliptic_integral():
    # A second link balanced on the elbow (r2 = 0) leaves a single pendulum of inertia I1 + m2 l1². From rest at
    # 2.5 rad it hangs straight after a quarter of its period 4 K(sin²(θ/2)) / ω.
    p = FRICTIONLESS
    plant = dataclasses.replace(p, r2=0.0)
    omega = np.sqrt((p.m1 * p.r1 + p.m2 * p.l1) * p.g / (p.I1 + p.m2 * p.l1**2))
    quarter = ellipk(np.sin(2.5 / 2) ** 2) / omega
    last = followed(rk4_step, plant, quarter / 2501, 2501, start=[2.5, 0.0, 0.0, 0.0])
    # At the bottom all potential energy has become ½ θ̇²: θ̇ = -2 ω sin(θ0 / 2).
    np.testing.assert_allclose(last[:3], [0.0, 2.5, -2 * omega * np.sin(1.25)], atol=1e-9)


def small_link():
    """Two rods of 5 cm and 0.1 kg, with I = m l²/3, and the friction of small motors: λ dt is 5.2 at 2 ms."""
    rods = {"m1": 0.1, "m2": 0.1, "l1": 0.05, "l2": 0.05, "r1": 0.025, "r2": 0.025, "I1": 8.33e-5, "I2": 8.33e-5}
    frictions = {"b1": 1e-5, "b2": 1e-5, "cf1": 7e-4, "cf2": 4e-4, "Ir": 0.0}
    return dataclasses.replace(load_plant("C.1"), **rods, **frictions)


mass_matrices = jax.jit(jax.vmap(mass_matrix, (None, 0)))


@pytest.mark.parametrize("name", ["A.0", "B.0", "C.0", "C.1", "small link"])
def test_friction_rate_is_the_largest_eigenvalue(name):
    plant = small_link() if name == "small link" else load_plant(name)
    damping = np.diag([plant.b1 + 100 * plant.cf1, plant.b2 + 100 * plant.cf2])
    angles = np.arccos(np.linspace(-1, 1, 9))
    masses = np.asarray(mass_matrices(plant, angles[:, None] * [0.0, 1.0, 0.0, 0.0]))
    expected = max(np.linalg.eigvals(np.linalg.solve(mass, damping)).max() for mass in masses)
    assert friction_rate(plant) == pytest.approx(expected, rel=1e-9)


def test_halved_steps_agree_where_single_ones_do_not():
    """A joint that rests under a small torque: one step of RK4 rings about rest, stable ones stay."""
    plant = small_link()
    stiff = dataclasses.replace(plant, name="stiff", b2=1e9)
    assert refusal(stable_substeps, stiff, 0.002).startswith("stiff: friction would stop its joints within")
    number = stable_substeps(plant, 0.002)
    assert number >= 2

    @functools.partial(jax.jit, static_argnums=0)
    def speeds(substeps):
        def step(x, _):
            return (after := rk4_steps(plant, x, jnp.array([4e-4, 0.0]), 0.002, substeps)), after[2:]

        return jax.lax.scan(step, jnp.array([0.0, 0.0, 0.005, -0.005]), length=60)[1]

    single, chosen, halved = (np.asarray(speeds(count)) for count in (1, number, 2 * number))
    np.testing.assert_allclose(chosen[20:], halved[20:], atol=2e-4)
    assert np.abs(single[20:] - halved[20:]).max() > 20 * np.abs(chosen[20:] - halved[20:]).max()


C1 = load_plant("C.1")
SMALL = dataclasses.replace(load_plant("cloudpendulum-rods"), cf1=0.002, cf2=0.003)
START = np.array([0.5, -0.3, 2.0, -4.0])


@functools.partial(jax.jit, static_argnums=0)
def repeat(step, plant, dt, steps, u, start):
    return jax.lax.fori_loop(0, steps, lambda _, x: step(plant, x, u, dt), start)


def followed(step, plant, dt, steps, u=(0.0, 0.0), start=START):
    """The state after so many steps; each integrator is compiled once."""
    return np.asarray(repeat(step, plant, dt, steps, jnp.array(u), jnp.array(start)))


def test_halving_the_step_quarters_the_error():
    # Both joints keep their direction for 40 ms, so that friction is smooth: second order.
    exact = followed(rk4_step, C1, 2.5e-5, 1600)
    errors = [np.abs(followed(implicit_step, C1, dt, round(0.04 / dt)) - exact) for dt in (2e-3, 1e-3)]
    np.testing.assert_allclose(errors[0] / errors[1], 4.0, atol=0.4)
    assert errors[0].max() < 2e-3


def test_stiff_friction_is_stable():
    # λ dt = 100 cf dt / least eigenvalue of M: far above the 2.79 of RK4.
    plant = dataclasses.replace(SMALL, cf1=0.01, cf2=0.01)
    least = np.linalg.eigvalsh(jax.jit(mass_matrix)(plant, jnp.zeros(4)))[0]
    assert 100 * 0.01 * 0.002 / least > 20
    # Friction holds both joints: arctan(100 dq) lets them creep. RK4 chatters for ever.
    speeds = [np.abs(followed(step, plant, 0.002, 500)[2:]).max() for step in (implicit_step, rk4_step)]
    assert speeds[0] < 0.03 < 0.1 < speeds[1]


def test_four_steps_of_newton_are_near_the_root(monkeypatch):
    """On C.1 at 1 ms 2e-5 rad/s of 12 steps' rates, for slow, fast and reversing joints."""
    random = np.random.default_rng(0)
    x = random.normal(size=(2_000, 4)) * [2.0, 2.0, 1.0, 1.0]
    x[:, 2:] *= 10.0 ** random.uniform(-3, 1.3, (2_000, 2))
    u, found = random.uniform(-6.0, 6.0, (2_000, 2)), []
    for steps in (4, 12):
        monkeypatch.setattr(integrate, "NEWTON_STEPS", steps)
        found.append(np.asarray(jax.jit(jax.vmap(lambda x, u: implicit_step(C1, x, u, 0.001)))(x, u)))
    assert np.abs(found[0] - found[1]).max() < 2e-5
