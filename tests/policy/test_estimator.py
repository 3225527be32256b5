"""The estimator, against an independent Riccati iteration and in closed loops whose true state is known."""

import collections
import functools

import jax
import numpy as np
import pytest

from benchmark.independent import derivative, rk4
from swingup.plant.equations import NUMPY
from swingup.plant.plant import LEADERBOARD
from swingup.policy import estimator
from swingup.policy.estimator import POSITION_NOISE, EstimatorSettings, kalman_gains
from swingup.policy.numpy_backend import numpy_controller

from .references import DT, ENCODER, policy

STEPS = 1100


Rows = collections.namedtuple("Rows", "x measured seen delay_steps")
"""A closed loop before each of its steps."""


@functools.cache
def closed_loop(sigma=0.0, quantum=0.0, age=0, lively=0.0):
    """A swing-up of the acrobot's ``ar-eapo`` with the estimator.

    The sensor has noise of the velocities (rad/s), steps of the angles (rad) and an age (steps). Random steps of
    torque (N m) act besides the policy's: delay shows only where the torque changes.
    """
    found, p = numpy_controller(policy("acrobot-estimated")), LEADERBOARD.driven("acrobot").values()
    signs = np.random.default_rng(1).choice([-1.0, 1.0], 1000)
    noise = np.random.default_rng(0).normal(size=(STEPS, 2))
    network, shown, states, rows = found.inner._network, [], [np.zeros(4)], []

    def watched(x):
        shown.append(x)
        return network(x) + lively * signs[int(len(rows) * DT / 0.0081)]

    found.inner._network = watched
    for k in range(STEPS):
        x, past = states[-1], states[max(0, k - age)]
        q = np.round(past[:2] / quantum) * quantum if quantum else past[:2]
        measured = np.concatenate([q, past[2:] + sigma * noise[k]])
        u = found(measured, k * DT)
        rows.append((x, measured, shown[-1], int(found.inner.state.delay_steps)))
        states.append(rk4(p, x, u, DT))
    return Rows(*(np.array(column) for column in zip(*rows, strict=True)))


@pytest.mark.parametrize("changes", [{}, {"velocity_noise": 0.1}, {"dt": 0.01, "acceleration_noise": 5.0}])
def test_kalman_gains(changes):
    settings = EstimatorSettings(**changes)
    dt = settings.dt
    A = np.array([[1, dt], [0, 1]])
    # A constant acceleration over a step moves the angle by dt²/2 of it, and the rate by dt.
    Q = settings.acceleration_noise**2 * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
    R = np.diag([POSITION_NOISE, settings.velocity_noise]) ** 2
    P = np.eye(2)
    for _ in range(3000):
        K = P @ np.linalg.inv(P + R)
        # Joseph's form, which holds for any gain.
        P = A @ ((np.eye(2) - K) @ P @ (np.eye(2) - K).T + K @ R @ K.T) @ A.T + Q
    np.testing.assert_allclose(kalman_gains(settings), K, rtol=1e-9)
    # Extreme noise gives finite gains.
    for noise in (1e-6, 1e-3, 1000.0):
        settings = EstimatorSettings(velocity_noise=noise, acceleration_noise=1000.0, dt=0.1)
        assert np.isfinite(kalman_gains(settings)).all()


def by_the_document(settings, p, measurements, torques):
    """What a controller is shown, by the equations of ``policy/estimator.py``; ``torques`` are what it answers."""
    dt, N, limit = settings.dt, settings.max_delay_steps, p.tl1
    gains, values = kalman_gains(settings), p.values()

    def rates(x, u):
        return derivative(values, x, np.array([u, 0.0]))

    def midpoint(x, u, h):
        return x + h * rates(x + h / 2 * rates(x, u), u)

    def correct(e):
        return (gains @ e.reshape(2, 2)).ravel()

    estimate, u, d, S, m, shown = None, np.zeros(N + 1), np.zeros((N + 1, 4)), np.zeros(N + 1), 0, []
    for z, torque in zip(measurements, torques, strict=True):
        if estimate is None:
            estimate = seen = z
        else:
            p_next = midpoint(estimate, u[m], dt)
            e = z - p_next
            e[:2] -= 2 * np.pi * np.round(e[:2] / (2 * np.pi))
            b = (rates(estimate, 1.0) - rates(estimate, 0.0))[2:]
            for n in range(N + 1):
                a = (u[n] - u[m]) * b
                d[n] = [*(d[n, :2] + dt * d[n, 2:] + dt**2 / 2 * a), *(d[n, 2:] + dt * a)]
                far = np.sum((e - d[n])[:2] ** 2) / estimator.OUTLIER_SCALE**2
                S[n] = np.exp(-dt / estimator.EVIDENCE_TIME) * S[n] + np.log(1 + far)
                d[n] -= correct(d[n])
            m = int(np.argmin(S + estimator.DELAY_PENALTY * np.arange(N + 1)))
            estimate, d = p_next + correct(e) + d[m], d - d[m]
            seen = estimate
            U = np.concatenate([[0.0], np.cumsum(u)])
            for k in m * np.array([1.0, 0.75, 0.5, 0.25]) if m else ():
                held = np.interp(k, np.arange(N + 2), U) - np.interp(k - m / 4, np.arange(N + 2), U)
                seen = midpoint(seen, held / (m / 4), m * dt / 4)
        u = np.array([np.clip(torque, -limit, limit), *u[:-1]])
        shown.append((seen, m))
    return [np.array(each) for each in zip(*shown, strict=True)]


PENDUBOT = LEADERBOARD.driven("pendubot")


def test_it_does_what_the_document_says(monkeypatch):
    settings, steps = EstimatorSettings(max_delay_steps=5), 60
    # So that the delay changes within some calls.
    monkeypatch.setattr(estimator, "DELAY_PENALTY", 0.1)
    monkeypatch.setattr(estimator, "EVIDENCE_TIME", 0.05)
    random = np.random.default_rng(3)
    measured = np.cumsum(random.normal(size=(steps, 4)) * [5e-4, 5e-4, 0.2, 0.2], axis=0)
    measured += np.array([3.0, 0.5, 0.0, 0.0])
    measured[30:, 0] -= 2 * np.pi
    torques = np.clip(1.0 + 7.0 * random.choice([-1.0, 1.0], steps // 4).repeat(4), -6.0, 6.0)
    loop = estimator.estimator_constants(settings, PENDUBOT, 0)
    state, shown = estimator.begin(NUMPY, loop), []
    for k in range(steps):
        state, seen = estimator.observe(NUMPY, loop, state, None, k * DT, measured[k])
        shown.append((seen, int(state.delay_steps)))
        state = estimator.remember(NUMPY, loop, state, np.array([torques[k], 0.0]))
    found, delay_steps = (np.array(each) for each in zip(*shown, strict=True))
    expected, chosen = by_the_document(settings, PENDUBOT, measured, torques)
    np.testing.assert_array_equal(delay_steps, chosen)
    assert len(set(chosen)) > 2
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("age", [1, 20])
def test_the_delay_is_found_and_compensated(age):
    rows = closed_loop(age=age, lively=4.0)
    assert np.all(rows.delay_steps[500:] == age)
    error, lag = (np.abs(given - rows.x)[500:].max(axis=0) for given in (rows.seen, rows.measured))
    assert np.all(error < 0.05 * lag)
    assert np.all(lag > 0.01)


def test_an_encoder_with_noisy_velocities_swings_up():
    rows = closed_loop(sigma=0.5, quantum=ENCODER)
    away = (rows.x - [np.pi, 0, 0, 0] + np.pi) % (2 * np.pi) - np.pi
    assert np.all(np.abs(away[1000:, :2]) < 0.35)
    np.testing.assert_allclose(rows.seen[:, :2], rows.x[:, :2], atol=5e-4)
    measured, seen = (np.sqrt(np.mean((given - rows.x)[:, 2:] ** 2)) for given in (rows.measured, rows.seen))
    assert measured == pytest.approx(0.5, rel=0.05)
    assert seen < 0.14 * measured


LOOP = estimator.estimator_constants(EstimatorSettings(), PENDUBOT, 0)
HERE, THERE = np.array([0.1, 0.2, 0.3, 0.4]), np.array([1.0, -1.0, 2.0, -2.0])
NEAR = HERE + 0.01


def fed(*measurements):
    """What is remembered after measurements, each a step after the other, and what is seen last."""
    state, seen = estimator.begin(NUMPY, LOOP), None
    for index, x in enumerate(measurements):
        with np.errstate(all="ignore"):
            state, seen = estimator.observe(NUMPY, LOOP, state, None, index * DT, x)
        state = estimator.remember(NUMPY, LOOP, state, np.array([6.0, 0.0]))
    return state, seen


@pytest.mark.parametrize("t", [5.1 * DT, 60.0, 0.0])
def test_a_pause_or_a_clock_set_back_restarts_from_the_measurement(t):
    state = fed(HERE, HERE)[0]._replace(delay_steps=np.array(3))
    state, seen = estimator.observe(NUMPY, LOOP, state, None, t, NEAR)
    np.testing.assert_array_equal(seen, NEAR)
    np.testing.assert_array_equal(state.state, NEAR)
    assert state.delay_steps == 3
    assert not np.any(state.deviations)
    assert not np.any(state.torques)


def test_a_late_call_is_no_pause():
    seen = estimator.observe(NUMPY, LOOP, fed(HERE)[0], None, 1.4 * DT, NEAR)[1]
    assert np.abs(seen - NEAR).max() > 0.001


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e200])
def test_impossible_measurements_spoil_nothing(bad):
    state, seen = fed(HERE, HERE, np.full(4, bad), HERE, THERE, THERE)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(state))
    np.testing.assert_allclose(seen[:2], THERE[:2], atol=0.2)


def test_a_jump_restarts_from_the_measurement():
    # An angle that is off by 1 rad would make a rate of 348 rad/s of the filter's.
    jumped = HERE + np.array([0.0, 1.0, 0.0, 0.0])
    np.testing.assert_array_equal(fed(HERE, HERE, jumped)[1], jumped)
