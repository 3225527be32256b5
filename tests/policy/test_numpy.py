"""The NumPy back end beyond the conformance table: its estimates, its plant, its score, and what it refuses."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import swingup
from swingup.benchmark.boards import PERFORMANCE
from swingup.common.errors import SwingupError
from swingup.controllers.registry import get_controller
from swingup.dynamics.dynamics import acceleration
from swingup.dynamics.integrate import midpoint_step
from swingup.export.realaigym import RealAIGymController
from swingup.plant.maths import NUMPY
from swingup.plant.plant import LEADERBOARD
from swingup.policy.estimator import core as estimator
from swingup.policy.estimator.settings import EstimatorSettings
from swingup.policy.numpy_backend.controller import numpy_controller
from swingup.policy.shipped import load_policy
from swingup.runtime import load_controller

from .references import controller, faults, random_states


def test_the_checker_finds_nothing(robot):
    assert swingup.check_controller(load_controller("adaptive", robot), robot) == []


def test_the_period_is_the_estimators():
    policy = load_policy("ar-eapo", "acrobot")
    assert policy.period is None
    behind = dataclasses.replace(policy, estimator=EstimatorSettings(dt=0.001))
    assert behind.period == 0.001
    counted, timed = (RealAIGymController(numpy_controller(behind)) for _ in range(2))
    for step in range(5):
        x = np.full(4, 0.1 * step)
        np.testing.assert_array_equal(counted.get_control_output(x), timed.get_control_output(x, 0.001 * step))


@pytest.mark.slow
def test_the_score_is_the_judges(either_robot):
    name = either_robot.name
    rules = dataclasses.replace(PERFORMANCE, duration=4.0)  # a swing-up, and the way to hold
    in_numpy, in_jax = (
        swingup.judge(found, name, rules).criteria.score
        for found in (load_controller("ar-eapo", name), get_controller("ar-eapo", name))
    )
    assert in_jax > 0.3
    assert in_numpy == pytest.approx(in_jax, abs=1e-4)


@pytest.mark.slow  # the conformance table compares the torques behind the same estimators
def test_the_estimates_are_the_judges(x64):
    """The estimator's own state, call by call, over measurements that make it restart."""
    reference, found = controller("acrobot-estimated"), load_controller("ar-eapo", "acrobot", estimator=True)
    call, memory = eqx.filter_jit(reference), reference.init()
    for t, measured in zip(*faults(), strict=True):
        memory, expected = call(memory, jnp.asarray(t), jnp.asarray(measured))
        np.testing.assert_allclose(found(measured, t)[1], expected[1], rtol=0, atol=1e-7)
        np.testing.assert_allclose(found.inner.state.state, memory.estimator.state, rtol=1e-12, atol=1e-9)
        assert found.inner.state.delay_steps == memory.estimator.delay_steps


def test_the_model_is_the_leaderboards(robot, x64):
    """NumPy's step and response, against JAX's equations of motion."""
    p, loop = LEADERBOARD.driven(robot), estimator.make_loop(EstimatorSettings(), LEADERBOARD, robot.joint)
    for x, torque in zip(random_states()[:20], np.random.default_rng(1).uniform(-6, 6, 20), strict=True):
        u = torque * np.array(robot.actuation)
        stepped = estimator.step(NUMPY, loop, loop.model, x, float(torque), 0.01)
        np.testing.assert_allclose(stepped, midpoint_step(p, x, u, 0.01), rtol=1e-12)
        response = acceleration(p, x, u) - acceleration(p, x, 0 * u)
        found = torque * estimator.response(NUMPY, loop, loop.model, x)
        np.testing.assert_allclose(found, response, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("source", "robot", "message"),
    [
        ("ar-eapo", None, "shipped for both robots: name acrobot or pendubot"),
        ("ar-eapo", "cartpole", "unknown robot 'cartpole'"),
        (
            "tvlqr",
            "acrobot",
            "unknown policy 'tvlqr': use one of adaptive, ar-eapo, global or a policy file",
        ),
        ("globel", "acrobot", "did you mean global?"),
        ("nothing.safetensors", "acrobot", "no such file: nothing.safetensors"),
    ],
)
def test_what_is_refused(source, robot, message):
    with pytest.raises(SwingupError, match=message):
        load_policy(source, robot)
