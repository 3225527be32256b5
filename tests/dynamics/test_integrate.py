"""Integrators: the reference's runs, a closed form, order of the implicit one's errors, and stiff friction."""

import dataclasses
import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ellipk

from identification.synthetic import step as implicit_step
from swingup.dynamics import integrate
from swingup.dynamics.dynamics import mass_matrix
from swingup.dynamics.integrate import friction_rate, rk4_step, rk4_steps, stable_substeps
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, ROBOTS

DATA = Path(__file__).parent / "data"
FRICTIONLESS = LEADERBOARD.driven(ROBOTS["acrobot"])

pytestmark = pytest.mark.usefixtures("x64")


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
