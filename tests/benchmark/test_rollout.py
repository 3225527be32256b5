import dataclasses
import functools
import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from swingup import AbstractController, judge
from swingup.benchmark.disturbances import PushRules, draw_pushes
from swingup.benchmark.rollout import Scenario, simulate
from swingup.benchmark.runner import run_one
from swingup.controllers.interface import PythonController
from swingup.dynamics.integrate import rk4_steps
from swingup.loop.disturbance import step_noise, undisturbed
from swingup.loop.draw import draw
from swingup.loop.resolve import resolve
from swingup.plant.plant import LEADERBOARD

from .controllers import HANGING
from .independent import World, closed_loop

run = jax.jit(simulate, static_argnames=("steps", "depth"))

GAIN = np.array([[8.0, 1.0, 0.3, 0.1], [9.0, 5.0, 0.2, 0.4]])
X0, DT, STEPS = np.array([1.5, -0.7, 0.0, 2.0]), 0.002, 400


class Feedback(AbstractController[Array]):
    """u = sin(2 t) - K x - 0.1 Σ q on both joints, Σ q summed over all calls up to this one."""

    gain: Array

    def init(self):
        return jnp.zeros((), self.gain.dtype)

    def __call__(self, carry, t, x):
        total = carry + x[0] + x[1]
        return total, jnp.sin(2 * t) - self.gain @ x - 0.1 * total


def feedback():
    """The same controller in NumPy."""
    total = 0.0

    def control(x, t):
        nonlocal total
        total += x[0] + x[1]
        return math.sin(2 * t) - GAIN @ x - 0.1 * total

    return control


# Three pushes a joint, within the 0.8 s of the run; the motor alone is limited, so that they may exceed 6 N m.
PUSHES = draw_pushes(np.random.default_rng(0), PushRules(spacing=0.1), DT * STEPS)


@pytest.mark.usefixtures("x64")
def test_closed_loop_agrees_with_a_numpy_loop(robot):
    """All disturbances. Each alone: test_robustness.py; friction and two motors: test_trials.py, test_uptime.py."""
    plant = LEADERBOARD.driven(robot)
    calm = undisturbed(3).changed(velocity_noise=0.2, torque_noise=0.4, response=0.6)
    noise = np.array([5, 17], np.uint32)
    disturbance = dataclasses.replace(calm, noise=noise, delay_steps=3, pushes=PUSHES)
    noise = jax.vmap(lambda k: step_noise(disturbance, k, jnp.dtype(float)))(jnp.arange(STEPS))
    world = World(STEPS, 0.6, 3, PUSHES, *map(np.asarray, noise))
    expected = closed_loop(plant.values(), (robot.joint,), feedback(), X0, DT, world)
    start = Feedback(jnp.array(GAIN)), jnp.array(X0), DT
    _, fault, found = run(Scenario(plant, disturbance), *start, steps=STEPS, depth=8)
    assert fault == -1
    np.testing.assert_allclose(found.time, expected[:, 0], rtol=1e-14)
    np.testing.assert_allclose(found.x, expected[:, 1:5], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.u, expected[:, 5:], rtol=0, atol=1e-8)
    # The limits were reached and left, and the first row is the state before any step.
    limited = np.abs(found.u[:, robot.joint]) >= 6.0
    assert 0 < np.sum(limited) < STEPS
    np.testing.assert_array_equal(found.x[0], X0)
    # The passive joint, though commanded, is left alone by all disturbances.
    np.testing.assert_array_equal(found.u[:, 1 - robot.joint], 0)


@pytest.mark.slow
@pytest.mark.usefixtures("x64")
def test_a_late_loop_alike_in_jax_and_on_the_host(robot):
    """Times, states and torques; each state is the one before, one recorded period later."""
    timing = {"late": 0.3, "lateness": 1e-3, "lag": 0.002, "delay": 0.002}
    domain = resolve(domain={"plant": "C.1", "quantum1": 1e-3, **timing})
    scenario = Scenario(*draw(domain, jax.random.key(5), robot), substeps=domain.substeps)
    *_, found = run(scenario, Feedback(jnp.array(GAIN)), jnp.zeros(4), DT, steps=50, depth=domain.depth)
    plain = PythonController(feedback())
    rows = run_one(plain, scenario, DT, 50, domain.depth)
    np.testing.assert_allclose(rows.time, found.time, rtol=1e-12)
    np.testing.assert_allclose(rows.x, found.x, rtol=0, atol=1e-9)
    periods = np.diff(found.time)
    assert ((periods >= DT - 1e-12) & (periods <= 3 * DT)).all()
    assert 5 <= (periods > 1.001 * DT).sum() <= 30
    step = jax.jit(jax.vmap(functools.partial(rk4_steps, scenario.parameters, number=domain.substeps)))
    np.testing.assert_allclose(step(found.x[:-1], found.u[:-1], periods), found.x[1:], rtol=0, atol=1e-12)


@pytest.mark.usefixtures("x64")
def test_noise_is_standard_normal_and_differs_from_step_to_step_and_key_to_key():
    steps = 20_000

    def draw(key):
        noisy = undisturbed().changed(velocity_noise=0.5, torque_noise=2.0)
        disturbance = dataclasses.replace(noisy, noise=np.array(key, np.uint32))
        velocity, torque = jax.vmap(lambda k: step_noise(disturbance, k, jnp.dtype(float)))(jnp.arange(steps))
        np.testing.assert_array_equal(torque[:, 0], torque[:, 1])  # one motor, one draw
        return np.column_stack([velocity, torque[:, 0]]) / [0.5, 0.5, 2.0]

    first, second = draw([0, 1]), draw([0, 2])
    # Standard errors of 20,000 draws: means 0.0071, variances 0.01, correlations 0.0071; five of each.
    assert np.abs(first.mean(axis=0)).max() < 0.036
    assert np.abs(first.var(axis=0) - 1).max() < 0.05
    both = np.corrcoef(np.column_stack([first, second, np.roll(first, 1, axis=0)]).T)
    assert np.abs(both - np.eye(9)).max() < 0.036


def test_evaluation_of_a_pendulum_that_hangs(either_robot):
    evaluation = judge(HANGING, either_robot, name="idle")
    trajectory = evaluation.trajectory
    # 5,000 rows of the true state before each step: t = 0 to 9.998 s, in float64 whatever the caller's precision.
    assert trajectory.time.shape == (5000,)
    assert trajectory.time[-1] == pytest.approx(9.998, abs=1e-12)
    assert {leaf.dtype.name for leaf in jax.tree.leaves(trajectory)} == {"float64"}
    assert jnp.zeros(1).dtype == jnp.float32
    np.testing.assert_array_equal(trajectory.x, 0)
    found = json.loads(json.dumps(evaluation.as_dict()))
    (run,) = found.pop("details")
    names = ("robot", "controller", "plant", "estimator", "seeds", "runs", "successes", "swingup_time")
    idle = (either_robot.name, "idle", "leaderboard", False, [], 1, 0, None)
    assert tuple(found[name] for name in names) == idle
    assert found["torque_over_gravity"] == pytest.approx(1.569, abs=1e-3)
    assert "disturbance" not in run
    for name in ("energy", "torque_cost", "torque_smoothness", "velocity_cost", "score"):
        assert found[name] == run[name] == 0.0
    # Hanging: both links down, l1 + l2 = 0.5 m below the shoulder.
    assert (run["highest_tip"], run["highest_tip_percent"], run["success"]) == (-0.5, -100.0, False)
