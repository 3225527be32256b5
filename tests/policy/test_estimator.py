"""The estimator, against an independent Riccati iteration and in closed loops whose true state is known."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from policies import lone_policy
from swingup.common.errors import SwingupError
from swingup.common.settings import read_settings
from swingup.controllers.interface.controller import AbstractController, check_interface
from swingup.controllers.stack.estimator import with_estimator
from swingup.dynamics.dynamics import acceleration
from swingup.dynamics.integrate import rk4_step
from swingup.plant.plant import LEADERBOARD
from swingup.plant.robots import ROBOTS
from swingup.policy.estimator import core
from swingup.policy.estimator.settings import POSITION_NOISE, EstimatorSettings, default_estimator, kalman_gains

DT, STEPS, PAST = 0.002, 1500, 32
UP = np.array([np.pi, 0.0, 0.0, 0.0])
SIGNS = np.random.default_rng(1).choice([-1.0, 1.0], 1000)
HELD = 0.0081  # s

SENSORS = {
    # Noise of the velocities (rad/s), age (steps), steps of the angles (rad), whether angles are wrapped, and
    # random steps of torque besides the policy's (N m): delay shows only where the torque changes.
    "perfect": (0.0, 0, 0.0, False, 0.0),
    "noisy": (0.5, 0, 0.0, False, 0.0),
    "wrapped": (0.0, 0, 0.0, True, 0.0),
    "encoder": (0.5, 0, 2 * np.pi / 2**14, False, 0.0),
    "old by 1": (0.0, 1, 0.0, False, 4.0),
    "old by 7": (0.0, 7, 0.0, False, 4.0),
    "old by 20": (0.0, 20, 0.0, False, 4.0),
}


class Watching(AbstractController):
    """Remembers the state that the controller behind is shown."""

    controller: AbstractController

    def init(self):
        return jnp.zeros(4)

    def __call__(self, carry, t, x):
        return x, self.controller(None, t, x)[1]


class Lively(AbstractController):
    """Adds random steps of torque."""

    controller: AbstractController
    size: float

    def init(self):
        return None

    def __call__(self, carry, t, x):
        sign = jnp.asarray(SIGNS)[jnp.asarray(t / HELD, int)]
        return None, self.controller(None, t, x)[1] + self.size * sign


class Constant(AbstractController):
    torque: float

    def init(self):
        return None

    def __call__(self, carry, t, x):
        return None, jnp.array([self.torque, 0.0])


@dataclasses.dataclass
class Rows:
    """A closed loop before each of its steps."""

    x: np.ndarray
    measured: np.ndarray
    seen: np.ndarray
    u: np.ndarray
    delay_steps: np.ndarray


@functools.cache
def closed_loops():
    """One swing-up of the acrobot's shipped policy with the estimator for each sensor."""
    robot = ROBOTS["acrobot"]
    p, policy = LEADERBOARD.driven(robot), lone_policy("ar-eapo", robot)[0]
    limits = np.array([p.tl1, p.tl2])
    noise = np.random.default_rng(0).normal(size=(STEPS, 2))

    def run(sigma, age, quantum, wrapped, lively):
        controller = with_estimator(Watching(Lively(policy, lively)), robot, p)

        def step(carry, now):
            x, past, memory = carry
            index, normal = now
            past = past.at[index % PAST].set(x)
            angles, rates = jnp.split(past[(index - age) % PAST], 2)
            angles = jnp.where(quantum > 0, jnp.round(angles / (quantum + 1e-30)) * quantum, angles)
            angles = jnp.where(wrapped, (angles + jnp.pi) % (2 * jnp.pi) - jnp.pi, angles)
            measured = jnp.concatenate([angles, rates + sigma * normal])
            memory, u = controller(memory, index * DT, measured)
            row = Rows(x, measured, memory.controller, u, memory.estimator.delay_steps)
            u = jnp.clip(u, -limits, limits)
            return (rk4_step(p, x, u, DT), past, memory), tuple(vars(row).values())

        start = (jnp.zeros(4), jnp.zeros((PAST, 4)), controller.init())
        return jax.lax.scan(step, start, (jnp.arange(STEPS), noise))[1]

    with jax.enable_x64(True):
        columns = [jnp.array(column) for column in zip(*SENSORS.values(), strict=True)]
        rows = [np.asarray(part) for part in jax.jit(jax.vmap(run))(*columns)]
    return {sensor: Rows(*(part[index] for part in rows)) for index, sensor in enumerate(SENSORS)}


def alone(states):
    """The policy's own torques (n, 2) for states."""
    policy = lone_policy("ar-eapo", "acrobot")[0]
    with jax.enable_x64(True):
        return np.asarray(jax.jit(jax.vmap(lambda x: policy(None, jnp.zeros(()), x)[1]))(jnp.asarray(states)))


@pytest.mark.parametrize(
    "changes",
    [{}, {"velocity_noise": 0.1}, {"dt": 0.01, "acceleration_noise": 5.0}],
)
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


@pytest.mark.parametrize("noise", [1e-6, 1e-3, 1000.0])
def test_kalman_gains_of_extreme_noise_are_finite(noise):
    settings = EstimatorSettings(velocity_noise=noise, acceleration_noise=1000.0, dt=0.1)
    assert np.isfinite(kalman_gains(settings)).all()


@pytest.mark.slow
def test_a_perfect_measurement_is_believed():
    rows = closed_loops()["perfect"]
    np.testing.assert_allclose(rows.seen[:, :2], rows.x[:, :2], atol=1e-6)
    np.testing.assert_allclose(rows.seen, rows.x, atol=5e-3)  # the midpoint rule is not Runge and Kutta's
    np.testing.assert_allclose(rows.u, alone(rows.x), atol=5e-3)
    assert np.all(rows.delay_steps == 0)
    assert np.abs(rows.x).max() > 3


def by_the_document(settings, p, measurements, torques):
    """What a controller is shown, by the equations of ``estimator/core.py``; ``torques`` are what it answers."""
    dt, N, limit = settings.dt, settings.max_delay_steps, p.tl1
    gains = kalman_gains(settings)

    def rates(x, u):
        return np.array([*x[2:], *acceleration(p, x, np.array([u, 0.0]))])

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
                far = np.sum((e - d[n])[:2] ** 2) / core.RESIDUAL**2
                S[n] = np.exp(-dt / core.MEMORY) * S[n] + np.log(1 + far)
                d[n] -= correct(d[n])
            m = int(np.argmin(S + core.CAUTION * np.arange(N + 1)))
            estimate, d = p_next + correct(e) + d[m], d - d[m]
            seen = estimate
            U = np.concatenate([[0.0], np.cumsum(u)])
            for k in m * np.array([1.0, 0.75, 0.5, 0.25]) if m else ():
                held = np.interp(k, np.arange(N + 2), U) - np.interp(k - m / 4, np.arange(N + 2), U)
                seen = midpoint(seen, held / (m / 4), m * dt / 4)
        u = np.array([np.clip(torque, -limit, limit), *u[:-1]])
        shown.append((seen, m))
    return [np.array(each) for each in zip(*shown, strict=True)]


def test_it_does_what_the_document_says(x64, monkeypatch):
    robot = ROBOTS["pendubot"]
    settings = EstimatorSettings(max_delay_steps=5)
    # So that the delay changes within some calls.
    monkeypatch.setattr(core, "CAUTION", 0.1)
    monkeypatch.setattr(core, "MEMORY", 0.05)
    p, steps = LEADERBOARD.driven(robot), 60
    controller = with_estimator(Watching(Lively(Constant(1.0), 7.0)), robot, p, settings)
    random = np.random.default_rng(3)
    measured = np.cumsum(random.normal(size=(steps, 4)) * [5e-4, 5e-4, 0.2, 0.2], axis=0)
    measured += np.array([3.0, 0.5, 0.0, 0.0])
    measured[30:, 0] -= 2 * np.pi
    times = np.arange(steps) * DT

    def step(memory, now):
        memory, u = controller(memory, *now)
        return memory, (memory.controller, memory.estimator.delay_steps, u[0])

    rows = jax.lax.scan(step, controller.init(), (jnp.asarray(times), jnp.asarray(measured)))[1]
    shown, delay_steps, torques = (np.asarray(part) for part in rows)
    expected, chosen = by_the_document(settings, p, measured, torques)
    np.testing.assert_array_equal(delay_steps, chosen)
    assert len(set(chosen)) > 2
    np.testing.assert_allclose(shown, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_noise_of_the_velocities_is_filtered():
    rows = closed_loops()["noisy"]
    measured, seen = (np.sqrt(np.mean((given - rows.x)[:, 2:] ** 2)) for given in (rows.measured, rows.seen))
    assert measured == pytest.approx(0.5, rel=0.05)
    assert seen < 0.1 * measured


@pytest.mark.slow
@pytest.mark.parametrize("age", [1, 7, 20])
def test_the_delay_is_found_and_compensated(age):
    rows = closed_loops()[f"old by {age}"]
    assert np.all(rows.delay_steps[500:] == age)
    error, lag = (np.abs(given - rows.x)[500:].max(axis=0) for given in (rows.seen, rows.measured))
    assert np.all(error < 0.05 * lag)
    assert np.all(lag > 0.01)


def test_an_encoder_with_noisy_velocities_swings_up():
    rows = closed_loops()["encoder"]
    away = (rows.x - UP + np.pi) % (2 * np.pi) - np.pi
    assert np.all(np.abs(away[1000:, :2]) < 0.35)
    np.testing.assert_allclose(rows.seen[:, :2], rows.x[:, :2], atol=5e-4)


def test_wrapped_angles_do_no_harm():
    rows, same = (closed_loops()[name] for name in ("wrapped", "perfect"))
    assert np.abs(np.diff(rows.measured[:, :2], axis=0)).max() > 6  # there was a jump
    np.testing.assert_allclose(rows.x, same.x, atol=1e-4)
    np.testing.assert_allclose(rows.seen, rows.x, atol=5e-3)


@pytest.fixture(scope="module")
def controller():
    """A constant torque behind the estimator of the pendubot."""
    robot = ROBOTS["pendubot"]
    return with_estimator(Watching(Constant(9.0)), robot, LEADERBOARD.driven(robot))


@pytest.fixture(scope="module")
def call(controller):
    """Its compiled call for two pendulums side by side at a time (s): measurements (2, 4), or one for both."""
    batched = jax.jit(jax.vmap(controller, in_axes=(0, None, 0)))

    def call(memory, t, x):
        return batched(memory, jnp.asarray(t), jnp.tile(jnp.asarray(x), (2, 1))[-2:])[0]

    return call


def feed(controller, call, *measurements):
    """What is remembered after measurements, each a step after the other."""
    memory = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), controller.init())
    for index, x in enumerate(measurements):
        memory = call(memory, index * DT, x)
    return memory


HERE, THERE = np.array([0.1, 0.2, 0.3, 0.4]), np.array([1.0, -1.0, 2.0, -2.0])
NEAR = HERE + 0.01


@pytest.mark.slow  # compiles for seconds
@pytest.mark.parametrize("t", [2.6 * DT, 60.0, 0.0])
def test_a_pause_or_a_clock_set_back_restarts_from_the_measurement(x64, controller, call, t):
    memory = feed(controller, call, HERE, HERE)
    memory = memory._replace(estimator=memory.estimator._replace(delay_steps=jnp.array([3, 3])))
    again = call(memory, t, NEAR)
    np.testing.assert_array_equal(again.controller[0], NEAR)
    state = again.estimator
    np.testing.assert_array_equal(state.state[0], NEAR)
    np.testing.assert_array_equal(state.delay_steps, 3)
    assert not np.any(state.deviations)
    np.testing.assert_array_equal(state.torques[:, 0], 6.0)  # of 9 N m that were asked for
    assert not state.torques[:, 1:].any()


@pytest.mark.slow
def test_a_late_call_is_no_pause(x64, controller, call):
    memory = call(feed(controller, call, HERE), 1.4 * DT, NEAR)
    assert np.abs(memory.controller - NEAR).max() > 0.001


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e200])
def test_impossible_measurements_spoil_nothing(x64, controller, call, bad):
    memory = feed(controller, call, HERE, HERE, np.full(4, bad), HERE, THERE, THERE)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(memory))
    np.testing.assert_allclose(memory.controller[0, :2], THERE[:2], atol=0.2)


def test_a_jump_restarts_from_the_measurement(x64, controller, call):
    # An angle that is off by 1 rad would make a rate of 348 rad/s of the filter's.
    jumped = HERE + np.array([0.0, 1.0, 0.0, 0.0])
    np.testing.assert_array_equal(feed(controller, call, HERE, HERE, jumped).controller[0], jumped)


def test_batched_is_single(x64, controller, call):
    memory = feed(controller, call, HERE, HERE)
    mixed, one, other = (call(memory, 2 * DT, x) for x in (np.array([HERE, THERE]), HERE, THERE))
    for index, single in enumerate((one, other)):
        jax.tree.map(lambda a, b, k=index: np.testing.assert_array_equal(a[k], b[k]), mixed, single)
    assert np.abs(mixed.estimator.state[0] - mixed.estimator.state[1]).max() > 0.1


@pytest.mark.parametrize("double", [False, True])
def test_memory_keeps_its_types(controller, double):
    with jax.enable_x64(double):
        check_interface(controller)
        assert controller.init().estimator.state.dtype == (jnp.float64 if double else jnp.float32)


def test_a_controller_of_the_other_robot_is_refused():
    acrobot = ROBOTS["acrobot"]
    with pytest.raises(SwingupError, match="it is for the pendubot, not the acrobot"):
        with_estimator(lone_policy("ar-eapo", "pendubot")[0], acrobot, LEADERBOARD.driven(acrobot))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("dt", 0, "dt = 0: use a number from 1e-06 to 0.1"),
        ("dt", 2, "dt = 2: use a number from 1e-06 to 0.1"),
        ("velocity_noise", "1", "velocity_noise = '1': use a number from 1e-06 to 1000"),
        ("velocity_noise", float("nan"), "velocity_noise = nan"),
        ("acceleration_noise", float("inf"), "acceleration_noise = inf"),
        ("max_delay_steps", 2.5, "max_delay_steps = 2.5: use a whole number"),
        ("max_delay_steps", 1001, "max_delay_steps = 1001"),
        ("velocity_noise", None, "velocity_noise = None"),
    ],
)
def test_settings_refuse_bad_values(name, value, message):
    with pytest.raises(SwingupError) as error:
        EstimatorSettings(**{name: value})
    assert message in str(error.value)


def test_settings_of_a_policy_file():
    assert read_settings({"robot": "acrobot"}, EstimatorSettings) is None
    assert read_settings({"estimator": {}}, EstimatorSettings) == EstimatorSettings()
    some = {"max_delay_steps": 0, "dt": 0.004}
    expected = EstimatorSettings(dt=0.004, max_delay_steps=0)
    assert read_settings({"estimator": some}, EstimatorSettings) == expected
    with pytest.raises(SwingupError, match="unknown estimator setting 'delay': use some of dt, velocity_noise"):
        read_settings({"estimator": {"delay": 3}}, EstimatorSettings)
    for other in (True, None, [], "default"):
        with pytest.raises(SwingupError, match="is not an object of settings"):
            read_settings({"estimator": other}, EstimatorSettings)


def test_default_settings_are_in_the_plants_units(either_robot, similar):
    plant = LEADERBOARD.driven(either_robot)
    assert default_estimator(plant) == EstimatorSettings()
    # Half C.1's unit of time: twice its velocities and four times its accelerations. Encoder and loop are the same.
    found = default_estimator(similar(plant))
    assert (found.velocity_noise, found.acceleration_noise) == pytest.approx((0.5, 200.0))
    assert dataclasses.replace(found, velocity_noise=0.25, acceleration_noise=50.0) == EstimatorSettings()
