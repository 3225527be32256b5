import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from swingup.benchmark.criteria import judge
from swingup.benchmark.evaluate import evaluate
from swingup.benchmark.rollout import simulate
from swingup.benchmark.rules import PERFORMANCE_RULES
from swingup.control.controller import AbstractController
from swingup.physics.parameters import identified_parameters, leaderboard_parameters

run = jax.jit(simulate, static_argnames="steps")


class Feedback(AbstractController[Array]):
    """u = sin(2 t) - K x - 0.1 Σ q on both joints, Σ q summed over all calls up to this one."""

    gain: Array

    def init(self):
        return jnp.zeros((), self.gain.dtype)

    def __call__(self, carry, t, x):
        total = carry + x[0] + x[1]
        return total, jnp.sin(2 * t) - self.gain @ x - 0.1 * total


class Idle(AbstractController[None]):
    """No torque."""

    def init(self):
        return None

    def __call__(self, carry, t, x):
        return carry, jnp.zeros(2, x.dtype)


def numpy_derivative(p, x, u):
    """The benchmark's equations of motion, written out as there and solved by LAPACK."""
    q1, q2, dq1, dq2 = x
    h = p["m2"] * p["l1"] * p["r2"]
    m12 = p["I2"] + h * math.cos(q2) - p["gr"] * p["Ir"]
    m22 = p["I2"] + p["gr"] ** 2 * p["Ir"]
    m11 = p["I1"] + p["I2"] + p["m2"] * p["l1"] ** 2 + 2 * h * math.cos(q2) + (p["gr"] ** 2 + 1) * p["Ir"]
    coriolis = h * math.sin(q2) * np.array([[-2 * dq2, -dq2], [dq1, 0.0]])
    gravity = -p["g"] * np.array(
        [
            p["m1"] * p["r1"] * math.sin(q1) + p["m2"] * (p["l1"] * math.sin(q1) + p["r2"] * math.sin(q1 + q2)),
            p["m2"] * p["r2"] * math.sin(q1 + q2),
        ]
    )
    friction = np.array(
        [p["b1"] * dq1 + p["cf1"] * math.atan(100 * dq1), p["b2"] * dq2 + p["cf2"] * math.atan(100 * dq2)]
    )
    ddq = np.linalg.solve([[m11, m12], [m12, m22]], gravity + u - coriolis @ x[2:] - friction)
    return np.concatenate([x[2:], ddq])


def numpy_loop(p, gain, x, dt, steps):
    """Measure, control, clip, integrate, step by step."""
    total, rows = 0.0, []
    limits = np.array([p["tl1"], p["tl2"]])
    for k in range(steps):
        total += x[0] + x[1]
        u = np.clip(math.sin(2 * k * dt) - gain @ x - 0.1 * total, -limits, limits)
        rows.append([k * dt, *x, *u])
        k1 = numpy_derivative(p, x, u)
        k2 = numpy_derivative(p, x + dt / 2 * k1, u)
        k3 = numpy_derivative(p, x + dt / 2 * k2, u)
        k4 = numpy_derivative(p, x + dt * k3, u)
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array(rows)


@pytest.mark.parametrize("friction", [False, True], ids=["leaderboard", "identified"])
@pytest.mark.usefixtures("x64")
def test_closed_loop_agrees_with_a_numpy_loop(robot, friction):
    # With friction both joints are driven (10 N m each); on the leaderboards one is, though both are commanded.
    plant = identified_parameters() if friction else leaderboard_parameters(robot)
    gain = np.array([[8.0, 1.0, 0.3, 0.1], [9.0, 5.0, 0.2, 0.4]])
    x0, dt, steps = np.array([1.5, -0.7, 0.0, 2.0]), 0.002, 400
    expected = numpy_loop(vars(plant), gain, x0, dt, steps)
    found = run(plant, Feedback(jnp.array(gain)), jnp.array(x0), dt, steps=steps)
    np.testing.assert_allclose(found.time, expected[:, 0], rtol=1e-14)
    np.testing.assert_allclose(found.x, expected[:, 1:5], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.u, expected[:, 5:], rtol=0, atol=1e-8)
    # The limits were reached and left, and the first row is the state before any step.
    limit, driven = (10.0, 0) if friction else (6.0, robot.joint)
    assert np.any(np.abs(found.u[:, driven]) == limit)
    assert np.any(np.abs(found.u[:, driven]) < limit)
    np.testing.assert_array_equal(found.x[0], x0)
    if not friction:
        np.testing.assert_array_equal(found.u[:, 1 - robot.joint], 0)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.usefixtures("x64")
def test_trajectory_has_the_dtype_of_the_first_state(robot, dtype):
    def simulated(x0):
        return simulate(leaderboard_parameters(robot), Idle(), x0, 0.002, 3)

    leaves = jax.tree.leaves(jax.eval_shape(simulated, jnp.zeros(4, dtype)))
    assert {leaf.dtype.name for leaf in leaves} == {dtype}
    assert [leaf.shape for leaf in leaves] == [(3,), (3, 4), (3, 2)]


def test_evaluation_of_a_pendulum_that_hangs(robot):
    evaluation = evaluate(Idle(), robot, name="idle")
    trajectory = evaluation.trajectory
    # 5,000 rows of the true state before each step: t = 0 to 9.998 s, in float64 whatever the caller's precision.
    assert trajectory.time.shape == (5000,)
    assert trajectory.time[-1] == pytest.approx(9.998, abs=1e-12)
    assert {leaf.dtype.name for leaf in jax.tree.leaves(trajectory)} == {"float64"}
    assert all(isinstance(leaf, np.ndarray) for leaf in jax.tree.leaves(trajectory))
    assert jnp.zeros(1).dtype == jnp.float32
    np.testing.assert_array_equal(trajectory.x, 0)
    assert evaluation.criteria == judge(
        trajectory.time, trajectory.x, trajectory.u, 0.2, 0.3, PERFORMANCE_RULES["v2"]
    )
    assert json.loads(json.dumps(evaluation.as_dict())) == {
        "robot": robot.name,
        "controller": "idle",
        "success": False,
        "swingup_time": None,
        "energy": 0.0,
        "torque_cost": 0.0,
        "torque_smoothness": 0.0,
        "velocity_cost": 0.0,
        "score": 0.0,
    }
