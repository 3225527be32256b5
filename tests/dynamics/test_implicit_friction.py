import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.dynamics import implicit_friction
from swingup.dynamics.dynamics import mass_matrix, total_energy
from swingup.dynamics.integrate import rk4_step
from swingup.plant.damped import Friction
from swingup.plant.equations import lump
from swingup.plant.plant import LEADERBOARD, load_plant
from swingup.plant.robots import ROBOTS

pytestmark = pytest.mark.usefixtures("x64")

C1 = load_plant("C.1")
SMALL = dataclasses.replace(load_plant("cloudpendulum-rods"), cf1=0.002, cf2=0.003)
START = np.array([0.5, -0.3, 2.0, -4.0])


def implicit_step(plant, x, u, dt):
    friction = Friction((plant.b1, plant.b2), (plant.cf1, plant.cf2))
    return jnp.stack(implicit_friction.implicit_step(lump(plant), friction, x, u, dt))


@functools.partial(jax.jit, static_argnums=0)
def run(step, plant, dt, steps, u, start):
    return jax.lax.fori_loop(0, steps, lambda _, x: step(plant, x, u, dt), start)


def follow(step, plant, dt, steps, u=(0.0, 0.0), start=START):
    """The state after so many steps; each integrator is compiled once."""
    return np.asarray(run(step, plant, dt, steps, jnp.array(u), jnp.array(start)))


def test_halving_the_step_quarters_the_error():
    # Both joints keep their direction for 40 ms, so that friction is smooth: second order.
    exact = follow(rk4_step, C1, 2.5e-5, 1600)
    errors = [np.abs(follow(implicit_step, C1, dt, round(0.04 / dt)) - exact) for dt in (2e-3, 1e-3)]
    np.testing.assert_allclose(errors[0] / errors[1], 4.0, atol=0.4)
    assert errors[0].max() < 2e-3


@pytest.mark.slow
def test_halving_the_step_through_stops_of_a_joint():
    # Friction brings both joints to rest many times in 2 s.
    exact = follow(rk4_step, SMALL, 2.5e-5, 80_000)[:2]
    errors = [np.abs(follow(implicit_step, SMALL, dt, round(2 / dt))[:2] - exact) for dt in (1e-3, 5e-4)]
    assert errors[1].max() < 0.5 * errors[0].max() < 0.02


def test_stiff_friction_is_stable():
    # λ dt = 100 cf dt / least eigenvalue of M: far above the 2.79 of RK4.
    plant = dataclasses.replace(SMALL, cf1=0.01, cf2=0.01)
    least = np.linalg.eigvalsh(jax.jit(mass_matrix)(plant, jnp.zeros(4)))[0]
    assert 100 * 0.01 * 0.002 / least > 20
    # Friction holds both joints: arctan(100 dq) lets them creep. RK4 chatters for ever.
    speeds = [np.abs(follow(step, plant, 0.002, 500)[2:]).max() for step in (implicit_step, rk4_step)]
    assert speeds[0] < 0.03 < 0.1 < speeds[1]


def test_a_torque_below_the_friction_moves_nothing():
    # At 2 mN m of 100 mN m of friction, arctan(100 dq) creeps at 2e-4 rad/s.
    plant = dataclasses.replace(C1, cf1=0.1, cf2=0.1)
    last = follow(implicit_step, plant, 0.002, 100, (0.002, 0.0), np.zeros(4))
    assert 0 < np.abs(last[:2]).max() < 1e-4


def test_energy_is_kept_without_friction():
    plant = LEADERBOARD.driven(ROBOTS["acrobot"])
    states = [np.array([np.pi / 2, 0.3, 0.0, 0.0])]
    for _ in range(100):
        states.append(follow(implicit_step, plant, 0.001, 50, start=states[-1]))
    energy = jax.jit(jax.vmap(total_energy, (None, 0)))(plant, np.array(states))
    # 4 J are exchanged; the drift of a second-order method stays bounded.
    assert np.ptp(energy) < 5e-3


def test_four_steps_of_newton_are_near_the_root(monkeypatch):
    """On C.1 at 1 ms 2e-5 rad/s of 12 steps' rates, for slow, fast and reversing joints."""
    random = np.random.default_rng(0)
    x = random.normal(size=(20_000, 4)) * [2.0, 2.0, 1.0, 1.0]
    x[:, 2:] *= 10.0 ** random.uniform(-3, 1.3, (20_000, 2))
    u, found = random.uniform(-6.0, 6.0, (20_000, 2)), []
    for steps in (4, 12):
        monkeypatch.setattr(implicit_friction, "NEWTON_STEPS", steps)
        found.append(np.asarray(jax.jit(jax.vmap(lambda x, u: implicit_step(C1, x, u, 0.001)))(x, u)))
    assert np.abs(found[0] - found[1]).max() < 2e-5
