"""The identifier on open-loop motions of plants that it does not know."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.controllers.stack.maths import JAX
from swingup.dynamics.integrate import rk4_step
from swingup.plant.base_parameters import BASE, base_parameters
from swingup.plant.equations import lump
from swingup.plant.maths import NUMPY
from swingup.plant.plant import LEADERBOARD
from swingup.plant.robots import get_robot
from swingup.policy.identifier import core
from swingup.policy.identifier.rows import hat_weights
from swingup.policy.identifier.settings import LAG, IdentifierSettings
from swingup.policy.identifier.state import make_loop

DT, STEPS = 0.002, 800
ROBOT = get_robot("acrobot")
NOMINAL = LEADERBOARD.driven(ROBOT)
OTHER = dataclasses.replace(
    NOMINAL, I1=1.1 * NOMINAL.I1, I2=0.9 * NOMINAL.I2, r1=0.92 * NOMINAL.r1, r2=1.08 * NOMINAL.r2,
    m2=1.07 * NOMINAL.m2, b1=0.02, b2=-0.01, cf1=0.03, cf2=0.05, Ir=4e-5,
)  # fmt: skip
GRID = np.array([0.1, 0.1, 0.2, 0.2, 1e-4])
"""The benchmark's half ranges of friction and rotor."""
UNCOMPENSATED = IdentifierSettings(passive_limit=0)
"""For commands of 0 to the undriven joint's motor, whatever friction is found there."""
LOADED = dataclasses.replace(UNCOMPENSATED, load_deviation=0.05, spring_deviation=0.02)


EVEN = np.full(STEPS, DT)
UNEVEN = np.random.default_rng(0).choice([1e-9, 0.5, 1.0, 1.2, 3.5], STEPS, p=[0.02, 0.1, 0.7, 0.15, 0.03]) * DT


@functools.cache
def programs(settings=UNCOMPENSATED):
    """A motion of a plant under swinging torques on the elbow, and what is found from angles and commands."""
    loop = make_loop(NOMINAL, ROBOT.joint, DT, 25, settings)
    t = jnp.arange(STEPS) * DT
    command = jnp.stack([jnp.zeros(STEPS), 1.5 * jnp.sin(6.5 * t) + jnp.sin(15 * t + 1)], axis=1)

    def move(parameters, u):
        return jax.lax.scan(lambda x, now: (rk4_step(parameters, x, now, DT), x), jnp.zeros(4), u)[1]

    def find(q, u, delay_steps, break_at, periods):
        def step(memory, row):
            index, angles, torque, period = row
            memory = jax.tree.map(
                lambda new, old: jnp.where(index == break_at, new, old), core.restart(JAX, loop, memory), memory
            )
            memory = core.observe(JAX, loop, memory, angles, delay_steps[index], period)
            return core.remember(JAX, memory, torque), memory.unknowns

        return jax.lax.scan(step, core.begin(JAX, loop), (jnp.arange(len(q)), q, u, periods))

    return loop, command, jax.jit(move), jax.jit(find)


def measured(plant, delay_steps=0, push=None):
    """Angles (n, 2), and the commands (n, 2) that moved the plant."""
    _, command, move, _ = programs()
    acting = command if push is None else command + push
    q = np.asarray(move(jax.tree.map(float, plant), acting))[:, :2]
    return np.concatenate([np.zeros((delay_steps, 2)), q])[:STEPS], command


def found(
    plant, change=lambda q: q, delay_steps=0, told=0, break_at=-1, push=None, periods=EVEN, settings=UNCOMPENSATED
):
    """The final memory and the unknowns of all steps, for angles changed on their way to the identifier."""
    loop, _, _, find = programs(settings)
    q, command = measured(plant, delay_steps, push)
    memory, unknowns = find(jnp.asarray(change(q)), command, np.full(STEPS, told), break_at, periods)
    return loop, memory, np.asarray(unknowns)


def errors(unknowns, plant):
    """Relative errors of the inertial parameters, the others' relative to the benchmark's ranges."""
    true = base_parameters(plant)
    return np.abs(unknowns[:BASE] - true) / np.concatenate([true[:4], GRID])


def check_found(unknowns, plant):
    """1.6 s of a motion much slower than a swing-up: inertias first, small friction last."""
    assert errors(unknowns, plant)[:4].max() < 0.025
    assert errors(unknowns, plant).max() < 0.1


@pytest.fixture(autouse=True)
def _double():
    with jax.enable_x64(True):
        yield


def test_it_finds_the_plant():
    loop, memory, unknowns = found(OTHER)
    assert errors(unknowns[0], OTHER).max() > 0.1
    check_found(unknowns[-1], OTHER)
    plant, friction = core.found(JAX, loop, memory)[1:3]
    np.testing.assert_allclose(plant[:5], lump(OTHER)[:5], rtol=0.02)
    assert float(friction.coulomb[0]) == pytest.approx(OTHER.cf1, abs=0.002)
    deviation = np.sqrt(np.diagonal(memory.covariance) / np.diagonal(loop.covariance))
    assert (deviation >= 0).all()
    assert deviation[:4].max() < 0.25


def test_the_nominal_plant_stays():
    _, _, unknowns = found(NOMINAL)
    assert max(errors(row, NOMINAL)[:4].max() for row in unknowns) < 0.025
    assert max(errors(row, NOMINAL).max() for row in unknowns) < 0.1


def quantised(q):
    """An encoder's steps."""
    return np.round(q / 3.81e-4) * 3.81e-4


PUSH = 3.0 * np.exp(-0.5 * ((np.arange(STEPS) * DT - 1.2) / 0.06) ** 2)[:, None] * [0.0, 1.0]
"""On the driven joint (N m)."""


@pytest.mark.parametrize(
    "given",
    [{"change": lambda q: (quantised(q) + np.pi) % (2 * np.pi) - np.pi}, {"push": PUSH}],
    ids=["encoder and full turns", "a push is no mass"],
)
def test_it_finds_the_inertias_in_spite_of(given):
    _, _, unknowns = found(OTHER, **given)
    assert errors(unknowns[-1], OTHER)[:4].max() < 0.05


def test_delay():
    _, _, told = found(OTHER, delay_steps=5, told=5)
    check_found(told[-1], OTHER)
    _, _, untold = found(OTHER, delay_steps=2)
    # 4 ms that nobody told.
    assert untold[-1, LAG] == pytest.approx(0.004, abs=0.0015)


def test_a_pause_keeps_what_was_found():
    _, memory, unknowns = found(OTHER, break_at=600)
    assert np.abs(unknowns[601:608, :BASE] - unknowns[599, :BASE]).max() == 0
    check_found(unknowns[-1], OTHER)
    # Enough for the longest delay: it was counted from 0 again.
    assert int(memory.calls) == 42


def test_what_is_learned_is_finite_or_nothing():
    """Beside a covariance that overflows; in NumPy as well."""
    loop = make_loop(NOMINAL, ROBOT.joint, DT, 25, IdentifierSettings())
    state = core.begin(NUMPY, loop)
    with jax.enable_x64(True), np.errstate(over="ignore", invalid="ignore"):
        observe = jax.jit(lambda memory, q: core.observe(JAX, loop, memory, q, jnp.array(0), jnp.array(DT)))
        memory = core.begin(JAX, loop)
        for step in range(60):
            q = np.array([0.5 + 0.02 * step, 0.3 * np.sin(0.1 * step)])
            if step == 50:
                memory = memory._replace(covariance=jnp.full_like(memory.covariance, 1e308))
                state.covariance[:] = 1e308
                kept = state.unknowns
            memory = observe(memory, jnp.asarray(q))
            state = core.observe(NUMPY, loop, state, q, 0, DT)
    assert not np.array_equal(kept, loop.mean)
    np.testing.assert_array_equal(state.unknowns, kept)
    np.testing.assert_allclose(memory.unknowns, kept, rtol=1e-6, atol=1e-9)
    assert np.isfinite(memory.covariance).all()


def test_hat():
    # Newest first: the hat's peak is 3 s ago, its area 1, its height 2/8.
    steps = np.array([1.0, 2.0, 4.0, 1.0])
    mean, slope = hat_weights(np, steps, np.array([0.0, 1.0, 3.0, 7.0, 8.0]), 3.0, 8.0)
    assert mean.sum() == pytest.approx(1)
    assert mean[0] == pytest.approx(0.5 * 1 * 0.25 / 3)
    assert slope.sum() == pytest.approx(0)
    # A ramp of 1 N m/s, which the torque follows in the middle of each step.
    assert slope @ -np.array([0.5, 2.0, 5.0, 7.5]) == pytest.approx(1)
    even = hat_weights(np, np.full(6, 0.002), 0.002 * np.arange(7), 0.006, 0.012)
    np.testing.assert_allclose(even[0], np.array([0.5, 1.5, 2.5, 2.5, 1.5, 0.5]) / 9, rtol=1e-12)
    np.testing.assert_allclose(even[1], np.array([1, 1, 1, -1, -1, -1]) / (9 * 0.002), rtol=1e-12)


@pytest.mark.parametrize("by", [1.0, np.nan])
def test_one_spoilt_angle_is_soon_forgotten(by):
    def spoil(q):
        q[600, 1] += by
        return q

    _, memory, unknowns = found(OTHER, spoil)
    check_found(unknowns[-1], OTHER)
    # Ten first deviations are the most, and they fall.
    assert float(max(memory.variance)) < 1.44
    if np.isnan(by):
        np.testing.assert_array_equal(unknowns[600], unknowns[599])


def test_negative_friction_is_found_and_not_predicted_with():
    loop = make_loop(NOMINAL, ROBOT.joint, DT, 25, UNCOMPENSATED)
    memory = core.begin(JAX, loop)
    memory = memory._replace(unknowns=memory.unknowns.at[4:8].set(jnp.array([-0.1, 0.1, 0.2, -0.2])))
    told = core.found(JAX, loop, memory)
    np.testing.assert_allclose(told.theta[4:8], [-0.1, 0.1, 0.2, -0.2], rtol=1e-6)
    np.testing.assert_allclose(told.friction, [[0.0, 0.1], [0.2, 0.0]], rtol=1e-6, atol=1e-12)


def spoilt(q):
    q = quantised(q)
    q[300, 0], q[600, 1] = 1e7, np.nan
    return q


@pytest.mark.parametrize(
    ("change", "told", "break_at", "periods", "settings"),
    [
        (lambda q: q, 0, -1, EVEN, UNCOMPENSATED),
        (quantised, 3, 400, EVEN, UNCOMPENSATED),
        (spoilt, 1, -1, EVEN, LOADED),
        (spoilt, np.arange(STEPS) // 150 % 4, 400, UNEVEN, UNCOMPENSATED),
    ],
)
def test_numpy_finds_the_same(change, told, break_at, periods, settings):
    """Also with the clock of another loop, changing delays and loads."""
    loop, memory, unknowns = found(OTHER, change, 1, told, break_at, periods=periods, settings=settings)
    q, command = measured(OTHER, 1)
    state, scale = core.begin(NUMPY, loop), np.sqrt(np.diagonal(loop.covariance))
    rows = []
    told = np.broadcast_to(told, STEPS).tolist()
    for index, (angles, torque) in enumerate(zip(change(q).tolist(), command.tolist(), strict=True)):
        if index == break_at:
            state = core.restart(NUMPY, loop, state)
        with np.errstate(invalid="ignore"):
            state = core.observe(NUMPY, loop, state, np.array(angles), told[index], periods[index])
        state = core.remember(NUMPY, state, np.array(torque))
        rows.append(state.unknowns)
    np.testing.assert_allclose(np.array(rows) / scale, unknowns / scale, rtol=0, atol=1e-9)
    leaves = (jax.tree.leaves(each) for each in (core.found(NUMPY, loop, state), core.found(JAX, loop, memory)))
    for ours, other in zip(*leaves, strict=True):
        np.testing.assert_allclose(ours, other, rtol=0, atol=1e-9)
    if periods is EVEN:
        assert errors(state.unknowns, OTHER)[:4].max() < 0.05
