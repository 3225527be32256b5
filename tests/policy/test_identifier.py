"""The identifier on motions of plants that it does not know: what it finds and tells, what the motors are asked."""

import collections
import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import lfilter

from swingup.controllers.stack.estimator import JAX
from swingup.loop.disturbance import late_period
from swingup.loop.loop import Loop
from swingup.plant.base_parameters import BASE, base_parameters
from swingup.plant.equations import NUMPY, Friction, damped_midpoint_step, friction
from swingup.plant.plant import LEADERBOARD, get_robot, lump
from swingup.policy import identifier
from swingup.policy.estimator import EstimatorSettings
from swingup.policy.identifier import (
    GAIN,
    LAG,
    IdentifierSettings,
    IdentifierState,
    JointLoads,
    compensation,
    identifier_constants,
    offsets,
)
from swingup.policy.numpy_backend import numpy_controller

from .references import policy

DT, STEPS, FINE = 0.002, 800, 4
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
LOADED = IdentifierSettings(load_deviation=0.05, spring_deviation=0.02)
"""Expects springs and constant torques."""
EVEN = np.full(STEPS, DT)
UNEVEN = np.random.default_rng(0).choice([1e-9, 0.5, 1.0, 1.2, 3.5], STEPS, p=[0.02, 0.1, 0.7, 0.15, 0.03]) * DT
UNIFORM = np.random.default_rng(1).random(STEPS, np.float32)
RECORDED = np.asarray(late_period(Loop(late=0.12, lateness=0.0012), UNIFORM, DT), float)
"""The most uneven ones of the domain ``recorded``: up to 3 DT, 5 in 100 longer than the estimator follows."""


Moved = collections.namedtuple("Moved", "loop state found unknowns rows")
"""What an identifier found and was shown."""


def moved(
    plant, settings=UNCOMPENSATED, robot=ROBOT, change=lambda step, q: q, late=0, told=0, break_at=None, push=0.0,
    periods=EVEN, gain=1.0, load=None,
):  # fmt: skip
    """An identifier beside a plant that swings under torques, and loads, on a clock with such periods (s).

    Measured angles are changed on their way, and some calls late, which is told or not. The driven joint may be
    pushed; the undriven joint's motor has the compensation's commands and some gain.
    """
    loop = identifier_constants(LEADERBOARD.driven(robot), robot.joint, DT, 25, settings)
    load, passive, limit = load or JointLoads((0.0, 0.0), (0.0, 0.0)), 1 - robot.joint, loop.passive_limit
    state, lumped, t, since = identifier.begin(NUMPY, loop), lump(plant), 0.0, DT
    past, rows, unknowns = [(0.0,) * 4] * (late + 1), [], []
    for step, (delay, period) in enumerate(zip(np.broadcast_to(told, len(periods)), periods, strict=True)):
        seen, x, u = change(step, np.array(past[-1][:2])), past[0], np.zeros(2)
        if step == break_at:
            state = identifier.restart(NUMPY, loop, state)
        with np.errstate(invalid="ignore"):
            state = identifier.observe(NUMPY, loop, state, seen, int(delay), float(since))
        b, cf = (pair[passive] for pair in identifier.identified_plant(NUMPY, loop, state).commanded_friction)
        u[robot.joint] = 1.5 * math.sin(6.5 * t) + math.sin(15 * t + 1)
        u[passive] = np.clip(friction(b, cf, x[2 + passive], math.atan), -limit, limit)
        state = identifier.remember(NUMPY, state, u)
        rows.append((step == break_at, seen, int(delay), since, u))
        unknowns.append(state.unknowns)
        applied = u * np.where(np.arange(2) == passive, gain, 1.0)
        applied[robot.joint] += push * math.exp(-0.5 * ((t - 1.2) / 0.06) ** 2)
        for _ in range(FINE):
            torques = (applied - load.at(*x[:2])).tolist()
            x = damped_midpoint_step(lumped, plant.friction, x, torques, float(period) / FINE, NUMPY)
        past, since, t = [x, *past[:late]], period, t + period
    return Moved(loop, state, identifier.identified_plant(NUMPY, loop, state), np.array(unknowns), rows)


def errors(unknowns, plant=OTHER):
    """Relative errors of the inertial parameters, the others' relative to the benchmark's ranges."""
    true = base_parameters(plant)
    return np.abs(unknowns[..., :BASE] - true) / np.concatenate([true[:4], GRID])


def check_found(unknowns):
    """1.6 s of a motion much slower than a swing-up: inertias first, small friction last."""
    assert errors(unknowns)[:4].max() < 0.025
    assert errors(unknowns).max() < 0.1


def test_it_finds_the_plant():
    loop, state, found, unknowns, _ = moved(OTHER)
    assert errors(unknowns[0]).max() > 0.1
    check_found(unknowns[-1])
    np.testing.assert_allclose(found.model.plant[:5], lump(OTHER)[:5], rtol=0.02)
    assert found.model.friction.coulomb[0] == pytest.approx(OTHER.cf1, abs=0.002)
    deviation = np.sqrt(np.diagonal(state.covariance) / np.diagonal(loop.covariance))
    assert (deviation >= 0).all()
    assert deviation[:4].max() < 0.25


def quantised(step, q, quantum=3.81e-4):
    return np.round(q / quantum) * quantum


def coarse(step, q):
    """As an encoder of 12 bits: without the compensation of its noise inertias are found 46 to 73 % too small."""
    return quantised(step, q, 2 * np.pi / 4096)


@pytest.mark.parametrize(
    "given",
    [
        {"change": lambda step, q: (quantised(step, q) + np.pi) % (2 * np.pi) - np.pi},
        {"change": coarse, "robot": get_robot("pendubot")},
        {"push": 3.0},
    ],
    ids=["encoder and full turns", "a coarse encoder", "a push is no mass"],
)
def test_it_finds_the_inertias_in_spite_of(given):
    assert errors(moved(OTHER, **given).unknowns[-1])[:4].max() < 0.05


def test_the_noise_of_the_angles_is_measured_and_what_it_makes_of_accelerations_is_known():
    random, deviation = np.random.default_rng(0), np.array([2e-4, 4e-4])
    state = moved(OTHER, change=lambda step, q: q + deviation * random.normal(size=2)).state
    np.testing.assert_allclose(np.sqrt(state.noise), deviation, rtol=0.4)
    # SciPy's low-passes of second differences 8 ms apart.
    noise = random.normal(size=400_000)
    rows, keep = (noise[8:] - 2 * noise[4:-4] + noise[:-8]) / 0.008**2, math.exp(-60 * DT)
    for _ in range(3):
        rows = lfilter([1 - keep], [1, -keep], rows)
    assert rows[1000:].var() == pytest.approx(identifier.noise_gain(DT), rel=0.05)


def test_delay():
    check_found(moved(OTHER, late=5, told=5).unknowns[-1])
    # 4 ms that nobody told.
    assert moved(OTHER, late=2).unknowns[-1, LAG] == pytest.approx(0.004, abs=0.0015)


def test_a_pause_keeps_what_was_found():
    _, state, _, unknowns, _ = moved(OTHER, break_at=600)
    assert np.abs(unknowns[601:608, :BASE] - unknowns[599, :BASE]).max() == 0
    check_found(unknowns[-1])
    # Enough for the longest delay: it was counted from 0 again.
    assert int(state.calls) == 42


def test_what_is_learned_is_finite_or_nothing():
    """Beside a covariance that overflows."""
    loop = identifier_constants(NOMINAL, ROBOT.joint, DT, 25, IdentifierSettings())
    state = identifier.begin(NUMPY, loop)
    for step in range(60):
        if step == 50:
            state.covariance[:], kept = 1e308, state.unknowns
        with np.errstate(over="ignore", invalid="ignore"):
            q = np.array([0.5 + 0.02 * step, 0.3 * np.sin(0.1 * step)])
            state = identifier.observe(NUMPY, loop, state, q, 0, DT)
    assert not np.array_equal(kept, loop.mean)
    np.testing.assert_array_equal(state.unknowns, kept)
    assert np.isfinite(state.covariance).all()


@pytest.mark.parametrize("by", [1.0, np.nan])
def test_one_spoilt_angle_is_soon_forgotten(by):
    _, state, _, unknowns, _ = moved(OTHER, change=lambda step, q: q + np.array([0.0, by if step == 600 else 0.0]))
    check_found(unknowns[-1])
    # Ten first deviations are the most, and they fall.
    assert max(state.variance) < 1.44
    if np.isnan(by):
        np.testing.assert_array_equal(unknowns[600], unknowns[599])


def spoilt(step, q):
    return {300: np.array([1e7, q[1]]), 600: np.array([q[0], np.nan])}.get(step, quantised(step, q))


@pytest.mark.parametrize(
    "given",
    [
        pytest.param({"change": quantised, "late": 1, "told": 3, "break_at": 400}, marks=pytest.mark.slow),
        {"change": spoilt, "late": 1, "told": 1, "settings": LOADED},
        {"change": spoilt, "told": np.arange(STEPS) // 150 % 4, "break_at": 400, "periods": UNEVEN},
    ],
    ids=["a pause", "loads", "another clock and changing delays"],
)
def test_jax_finds_the_same(x64, given):
    loop, _, found, unknowns, rows = moved(OTHER, **given)

    def step(memory, row):
        broken, angles, delay, period, torques = row
        again = identifier.restart(JAX, loop, memory)
        memory = jax.tree.map(lambda new, old: jnp.where(broken, new, old), again, memory)
        memory = identifier.remember(JAX, identifier.observe(JAX, loop, memory, angles, delay, period), torques)
        return memory, memory.unknowns

    columns = tuple(jnp.array(column) for column in zip(*rows, strict=True))
    memory, expected = jax.jit(lambda rows: jax.lax.scan(step, identifier.begin(JAX, loop), rows))(columns)
    scale = np.sqrt(np.diagonal(loop.covariance))
    np.testing.assert_allclose(unknowns / scale, expected / scale, rtol=0, atol=1e-9)
    leaves = (jax.tree.leaves(each) for each in (found, identifier.identified_plant(JAX, loop, memory)))
    for ours, other in zip(*leaves, strict=True):
        np.testing.assert_allclose(ours, other, rtol=0, atol=1e-9)


@pytest.mark.parametrize("periods", [RECORDED, np.full(STEPS, 0.0025)], ids=["recorded", "400 Hz"])
def test_it_finds_the_plant_at_other_periods(periods):
    found = moved(OTHER, periods=periods)
    check_found(found.unknowns[-1])
    # Present angles tell no age, also where calls are uneven.
    assert found.state.age == 0


def test_uneven_calls_tell_the_age_which_makes_late_angles_as_good_as_present_ones(monkeypatch):
    known = moved(OTHER, late=3, periods=RECORDED)
    monkeypatch.setattr(identifier, "AGE_MARGIN", math.inf)  # the age stays 0
    unknown = moved(OTHER, late=3, periods=RECORDED)
    assert (known.state.age, unknown.state.age) == (3, 0)
    good, bad = (errors(each.unknowns[-1])[:4].max() for each in (known, unknown))
    assert good < 0.02
    assert bad > 4 * good
    # Of even calls an age is a delay like any other.
    assert moved(OTHER, late=1).state.age == 0


def test_old_angles_are_carried_ahead_over_the_time_that_passed():
    """Where calls come late: the time since the angles, not so many of the last call's periods."""
    steps = np.array([0.003, 0.002, 0.004, 0.002])
    for age, expected in ((0, 0.0), (1, 0.0025), (3, 0.0075)):
        state = IdentifierState(*[None] * len(IdentifierState._fields))._replace(age=np.array(age), steps=steps)
        assert identifier.elapsed(NUMPY, state, 0.0025) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize(("pause", "calls"), [(3.9, 31), (4.1, 1), (-1.0, 1), (5e-7, 30), (0.61, 31)])
def test_a_pause_interrupts(pause, calls):
    """After a longer one the motion before is forgotten; a call that comes too soon is not seen."""
    parts = {"estimator": EstimatorSettings(), "identifier": IdentifierSettings()}
    controller = numpy_controller(dataclasses.replace(policy("acrobot-sighted"), **parts))
    for call in (*range(30), 29 + pause):
        controller(np.zeros(4), DT * call)
    state = controller.inner.state.identifier
    assert state.calls == calls
    assert 0.5 * DT <= min(state.steps) <= max(state.steps) < 4 * DT


FOUND = Friction((0.02, 0.1), (0.3, -0.06))
"""The elbow's Coulomb friction is negative."""


@pytest.mark.parametrize(
    ("gain", "limit", "asks", "delivered"),
    [
        (1.0, 0.5, 1.0, 1.0),
        # In units of the driven joint's motor, which may deliver less.
        (2.0, 0.5, 0.5, 2.0),
        (0.8, 0.5, 1.25, 0.8),
        # Of a weak one 1/0.6 of the friction is asked, and half of the friction remains.
        (0.3, 0.5, 1 / 0.6, 0.3),
        (-0.2, 0.5, 1 / 0.6, 0.0),
        (1.0, 0.0, 0.0, 1.0),
    ],
)
def test_compensation_by_hand(gain, limit, asks, delivered):
    """Asked, left and predicted with: (b1, b2), (cf1, cf2). No motor is asked for negative friction."""
    rest = 1 - asks * delivered
    acrobots = [
        ((0.02 * asks, 0.1), (0.3 * asks, 0.0)),
        ((0.02 * rest, 0.0), (0.3 * rest, -0.06)),
        # The driven motor's torque is counted: all of that joint's friction is predicted with.
        ((0.02 * rest, 0.1), (0.3 * rest, 0.0)),
    ]
    pendubots = [
        ((0.02, 0.1 * asks), (0.3, 0.0)),
        ((0.0, 0.1 * rest), (0.0, -0.06)),
        ((0.02, 0.1 * rest), (0.3, 0.0)),
    ]
    for joint, expected in enumerate((pendubots, acrobots)):
        np.testing.assert_allclose(compensation(FOUND, gain, joint, limit, max), expected, rtol=1e-9, atol=1e-15)


def test_offsets_are_bounded():
    """κ1 = k o1 and κ2 = m2 r2 (o1 + o2), with k = 0.5 and m2 r2 = 0.2."""
    theta = [0.0, 0.0, 0.2, 0.5]
    assert offsets(0.015, 0.002, theta, np.clip) == pytest.approx((0.03, -0.02))
    # Neither o1 nor o1 + o2 is believed beyond 0.1 rad.
    assert offsets(1.0, -1.0, theta, np.clip) == pytest.approx((0.1, -0.2))


def finding(robot, passive, **given):
    """A plant with a heavy second link and Coulomb friction of the passive joint (N m), and what is found of it."""
    plant = LEADERBOARD.driven(robot)
    cf1, cf2 = (0.1, passive) if robot.joint == 0 else (passive, 0.1)
    plant = dataclasses.replace(plant, m2=1.1 * plant.m2, cf1=cf1, cf2=cf2, b1=0.02, b2=0.01)
    return plant, moved(
        plant, **{"settings": IdentifierSettings(), "robot": robot, "periods": np.full(1200, DT), **given}
    )


def test_it_finds_the_offsets(either_robot):
    wrong = np.array([0.03, -0.02])
    plant, (_, _, found, *_) = finding(either_robot, 0.15, change=lambda step, q: q + wrong)
    np.testing.assert_allclose(found.offsets, wrong, rtol=0, atol=0.002)
    np.testing.assert_allclose(found.theta[:4], base_parameters(plant)[:4], rtol=0.01)


def test_it_finds_springs_and_constant_torques(either_robot):
    """A motor carries all of its own joint's load; a compensating one carries it as the driven one would."""
    load = JointLoads((0.05, -0.03), (0.03, 0.02))
    _, (_, _, found, *_) = finding(either_robot, 0.15, load=load, settings=LOADED)
    np.testing.assert_allclose(found.commanded_loads.constant, load.constant, rtol=0, atol=0.01)
    # About hanging a spring at the shoulder looks like a little more of gravity.
    np.testing.assert_allclose(found.commanded_loads.spring, load.spring, rtol=0, atol=0.02)
    left = found.model.loads.at(1.0, 1.0)
    assert left[either_robot.joint] == sum(pair[either_robot.joint] for pair in found.commanded_loads)
    assert left[1 - either_robot.joint] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("gain", [0.85, 0.0])
def test_it_finds_the_gain_of_the_undriven_joints_motor(either_robot, gain):
    """A dead motor leaves all friction, a live one none: policy and regulator are told so."""
    passive, (_, (_, state, found, *_)) = 1 - either_robot.joint, finding(either_robot, 0.3, gain=gain)
    assert state.unknowns[GAIN] == pytest.approx(gain, abs=0.05)
    assert found.theta[6 + passive] == pytest.approx(0.3, abs=0.015)
    told, remaining = found.residual_base, found.model.friction
    assert told[6 + passive] == pytest.approx(0.0 if gain else 0.3, abs=0.02)
    assert told[7 - passive] == pytest.approx(0.0, abs=1e-12)
    assert remaining.coulomb[passive] == pytest.approx(told[6 + passive], abs=1e-12)
    assert remaining.coulomb[1 - passive] == pytest.approx(0.1, abs=0.01)


def test_hat():
    # Newest first: the hat's peak is 3 s ago, its area 1, its height 2/8.
    steps = np.array([1.0, 2.0, 4.0, 1.0])
    mean, slope = identifier.hat_weights(np, steps, np.array([0.0, 1.0, 3.0, 7.0, 8.0]), 3.0, 8.0)
    assert mean.sum() == pytest.approx(1)
    assert mean[0] == pytest.approx(0.5 * 1 * 0.25 / 3)
    assert slope.sum() == pytest.approx(0)
    # A ramp of 1 N m/s, which the torque follows in the middle of each step.
    assert slope @ -np.array([0.5, 2.0, 5.0, 7.5]) == pytest.approx(1)


def test_negative_friction_is_found_and_not_predicted_with():
    loop = identifier_constants(NOMINAL, ROBOT.joint, DT, 25, UNCOMPENSATED)
    state = identifier.begin(NUMPY, loop)
    state.unknowns[4:8] = -0.1, 0.1, 0.2, -0.2
    told = identifier.identified_plant(NUMPY, loop, state)
    np.testing.assert_allclose(told.theta[4:8], [-0.1, 0.1, 0.2, -0.2], rtol=1e-6)
    np.testing.assert_allclose(told.model.friction, [[0.0, 0.1], [0.2, 0.0]], rtol=1e-6, atol=1e-12)
