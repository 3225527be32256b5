"""The task for the real robot against the judge's own steps, and its front end against closed forms."""

import dataclasses
import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.benchmark.rollout import Scenario, apply_torque, initial_loop, measure
from swingup.physics.parameters import get_robot
from swingup.plants.domain import load_domain, make_domain
from swingup.plants.loop import LOOP_DT
from swingup.policy.jax_backend.front_end import FrontEnd
from swingup.policy.numpy_backend.front_end import NumpyFrontEnd
from swingup.policy.settings import FrontEndSettings
from swingup.tasks.disturbance import Pushes, motor_torques, step_noise, undisturbed
from swingup.tasks.motors import Motor
from swingup.tasks.presets import sim2real_task
from swingup.tasks.sim2real import CALLS

QUIET = make_domain(
    {
        "passive_limit": 0.5, "delay": 0.01, "response": 0.9, "rate_limit": 1000.0, "ripple": 0.05,
        "ripple_periods": 36.0,
    }
)  # fmt: skip
"""No noise: the motion is determined."""

ROBOT = make_domain(
    {
        "passive_limit": 0.5, "delay": 0.002, "lag": 0.002, "gain1": 0.9, "gain2": 0.8, "quantum1": 3e-4,
        "quantum2": 4e-4, "offset1": 0.02, "offset2": -0.01, "late": 0.3, "lateness": 1e-3, "push": 2.0,
        "passive_push": 1.0,
    }
)  # fmt: skip
"""The robot's own loop: its late periods are drawn from the loop's key, and so are equal in both."""


def test_a_motor_by_hand():
    motor = Motor(rate_limit=1500.0, ripple=0.1, ripple_periods=36.0)
    before, wanted = jnp.array([0.0, -2.0]), jnp.array([6.0, -2.5])
    q = jnp.array([math.pi / 72, 0.0])  # a quarter of a period
    np.testing.assert_allclose(motor.follow(wanted, before, 0.002), [3.0, -2.5], rtol=1e-6)
    np.testing.assert_allclose(motor.ripple_torque(q), [0.1, 0.0], rtol=1e-6)


LIMITS = np.array([6.0, 0.5])


def measuring(robot, domain=None):
    """The task of a policy without an estimator: it sees measurements, late and noisy, through a filter."""
    return sim2real_task(robot, domain, estimated=False, velocity_weight=0.2, dead_band=0.1)


@functools.partial(jax.jit, static_argnums=4)
def torques(disturbance, command, q, noise, steps):
    """What acts, and the motors' own, in steps of 2 ms at fixed angles with command and noise held."""

    def step(motors, k):
        acting, motors = motor_torques(disturbance, command, motors, k * LOOP_DT, noise, LIMITS, q, LOOP_DT)
        return motors, (acting, motors)

    return jax.lax.scan(step, jnp.zeros(2), jnp.arange(steps))[1]


def test_ripple_and_noise_at_rest_do_not_integrate():
    """A slow motor with 10 N m/s and a command of 0: its own torque stays 0, whatever acts beside it."""
    motor = Motor(rate_limit=10.0, ripple=0.1, ripple_periods=36.0)
    disturbance = dataclasses.replace(undisturbed(), response=0.5, motor=motor)
    q = jnp.array([math.pi / 72, -math.pi / 72])  # a quarter of a period
    acting, own = torques(disturbance, jnp.zeros(2), q, jnp.full(2, 0.02), 10)
    np.testing.assert_allclose(acting, [[0.12, -0.08]] * 10, rtol=1e-6)
    np.testing.assert_array_equal(own, 0.0)


def test_a_push_adds_to_a_motor_that_hardly_moves():
    """At 10 N m/s a motor gains 0.02 N m a step: after k steps at a command of 6 N m, 0.02 k and the push act."""
    pushes = Pushes(np.full((2, 1), 0.01), np.full((2, 1), 0.01), np.array([[1.0], [0.0]]))
    disturbance = dataclasses.replace(undisturbed(), pushes=pushes, motor=Motor(10.0, 0.0, 36.0))
    acting, _ = torques(disturbance, jnp.array([6.0, 0.0]), jnp.zeros(2), jnp.zeros(2), 400)
    k = np.arange(400)
    push = np.exp(-0.5 * ((0.002 * k - 0.01) / 0.01) ** 2)
    np.testing.assert_allclose(acting[:, 0], np.minimum(0.02 * (k + 1), 6.0) + push, rtol=1e-4)
    assert float(acting.max()) <= 7.0


def test_each_motor_has_its_own_noise():
    disturbance = dataclasses.replace(undisturbed(), torque_noise=0.5, motor=Motor(1e6, 0.0, 36.0))
    noise = jax.vmap(lambda k: step_noise(disturbance, k, jnp.dtype("float32"))[1])(jnp.arange(5000))
    # Standard errors of 5,000 draws: deviations 0.005, the correlation 0.014.
    np.testing.assert_allclose(noise.std(axis=0), 0.5, atol=0.025)
    assert abs(float(np.corrcoef(noise.T)[0, 1])) < 0.07


@pytest.mark.parametrize("domain", [pytest.param(QUIET, marks=pytest.mark.slow), ROBOT], ids=["typical", "robot"])
@pytest.mark.slow
def test_steps_are_the_judges(either_robot, domain):
    """Actions held for 10 ms on a plant without noise, beside the judge's loop and NumPy's front end."""
    task = dataclasses.replace(measuring(either_robot, domain), reset_noise=0.3)
    actions = np.random.default_rng(1).uniform(-1, 1, (8, 1))
    with jax.enable_x64(True):
        state = jax.jit(lambda key: task.reset(key))(jax.random.key(4))
        start = np.asarray(state.x)
        scenario = Scenario(state.plant, state.disturbance, substeps=domain.substeps)
        judged = initial_loop(jnp.asarray(start), domain.depth, state.disturbance)
        front = NumpyFrontEnd(task.front_end.settings, either_robot.joint)
        step, half, other = jax.jit(lambda *given: task.step(*given)), jax.jit(measure), jax.jit(apply_torque)
        judged, seen, _ = half(scenario, judged, 0)
        shown = front.see(0.0, np.asarray(seen))
        for number, action in enumerate(actions):
            result = step(state, jnp.asarray(action), jax.random.key(number))
            state = result.state
            for call in range(number * CALLS, (number + 1) * CALLS):
                judged = other(scenario, judged, call, front.command(6.0 * float(action[0])), LOOP_DT)
                judged, seen, _ = half(scenario, judged, call + 1)
                shown = front.see((call + 1) * LOOP_DT, np.asarray(seen))
            np.testing.assert_allclose(state.x, judged.x, rtol=0, atol=1e-9)
            np.testing.assert_allclose(state.u, judged.u, rtol=0, atol=1e-9)
            np.testing.assert_allclose(result.observation, task.observation(jnp.asarray(shown)), rtol=0, atol=1e-9)
    passive = 1 - either_robot.joint
    assert 0 < abs(float(judged.u[passive])) <= 0.5  # friction compensation
    assert abs(float(judged.x[passive]) - start[passive]) > 1e-3


@jax.jit
def fifty(task):
    """Fresh states and their observations."""
    states = jax.vmap(task.reset)(jax.random.split(jax.random.key(0), 50))
    return states, jax.vmap(task.observe)(states)


@pytest.mark.slow
def test_ends():
    """Never terminated; truncated by the limit of steps, and where the integrator diverges."""
    task = dataclasses.replace(measuring(get_robot("acrobot")), truncation_probability=0.0)
    states, _ = fifty(task)
    fast = states.x.at[:10, 2].set(5000.0)
    states = eqx.tree_at(lambda s: (s.x, s.steps), states, (fast, states.steps.at[40:].set(999)))
    results = jax.jit(jax.vmap(lambda *given: task.step(*given)))(
        states, jnp.zeros((50, 1)), jax.random.split(jax.random.key(1), 50)
    )
    assert not results.terminated.any()
    assert results.truncated.nonzero()[0].tolist() == [*range(10), *range(40, 50)]
    np.testing.assert_array_equal(results.state.x[:10], fast[:10])
    assert np.isfinite(results.observation).all()


def test_noise_and_plants_differ():
    task = measuring(get_robot("acrobot"), load_domain("randomised"))
    states, observations = fifty(task)
    assert len(np.unique(states.plant.cf1)) == 50
    noise = states.memory.seen[:, 2:] - jnp.where(jnp.abs(states.memory.seen[:, 2:]) > 0, states.x[:, 2:], 0.0)
    assert 0.02 < float(noise.std()) < 0.2
    assert observations.shape == (50, task.observation_size) == (50, 6)


def test_behind_an_estimator_the_state_is_seen():
    task = sim2real_task(get_robot("acrobot"))
    states, observations = fifty(task)
    observe = jax.jit(jax.vmap(task.observation))
    np.testing.assert_allclose(observations, observe(states.x), rtol=0, atol=1e-6)
    step = jax.jit(jax.vmap(lambda *given: task.step(*given)))
    after = step(states, jnp.ones((50, 1)), jax.random.split(jax.random.key(1), 50))
    np.testing.assert_allclose(after.observation, observe(after.state.x), rtol=0, atol=1e-6)


def test_filter_and_dead_band():
    """The response of the low-pass to a step is 1 - (1 - w)ⁿ; slow is seen as still."""
    front = FrontEnd(FrontEndSettings(velocity_weight=0.2, dead_band=0.1))
    update = jax.jit(lambda *given: front.measure(*given))
    memory = front.begin(jnp.zeros(4))
    for n in range(1, 10):
        memory = update(memory, jnp.array([0.5, -0.5, 1.0, 0.15]))
        expected = 1 - 0.8**n
        np.testing.assert_allclose(memory.rates, [expected, 0.15 * expected], rtol=1e-5)
        slow = 0.15 * expected
        seen = [0.5, -0.5, expected, slow if slow >= 0.1 else 0.0]
        np.testing.assert_allclose(memory.seen, seen, rtol=1e-5)
    assert slow > 0.1


def test_friction_compensation(robot):
    settings = FrontEndSettings(damping=(0.1, 0.2), coulomb=(0.3, 0.4), passive_limit=0.5)
    front = FrontEnd(settings)
    memory = front.begin(jnp.array([0.0, 0.0, 1.0, -3.0]))
    u = front.command(memory, jnp.array(2.0), robot)
    friction = [0.1 + 0.3 * math.atan(100), -0.6 - 0.4 * math.atan(300)]
    expected = np.clip(friction, -0.5, 0.5)
    expected[robot.joint] = friction[robot.joint] + 2.0
    np.testing.assert_allclose(u, expected, rtol=1e-5)
    assert float(front.command(front.begin(jnp.zeros(4)), jnp.array(2.0), robot)[robot.joint]) == 2.0


def test_the_compensated_friction_is_the_domains():
    settings = sim2real_task(get_robot("acrobot")).front_end.settings
    assert settings == FrontEndSettings(damping=(0.001, 0.001), coulomb=(0.16, 0.12), passive_limit=0.5)
    mine = make_domain({"cf1": [0.1, 0.3], "b2": -0.1, "passive_limit": [0.25, 0.75]})
    settings = sim2real_task(get_robot("acrobot"), mine).front_end.settings
    np.testing.assert_allclose(settings.coulomb, [0.2, 0.12], rtol=1e-12)  # cf2 and b1 as identified
    assert (settings.damping, settings.passive_limit, settings.dead_band) == ((0.001, 0.0), 0.5, 0.0)


def test_settings_are_data():
    assert FrontEndSettings(**dataclasses.asdict(FrontEndSettings(coulomb=(0.1, 0.2)))).coulomb == (0.1, 0.2)
    assert FrontEndSettings(coulomb=[0.1, 0.2]).coulomb == (0.1, 0.2)
