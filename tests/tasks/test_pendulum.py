"""The pendulums' tasks: the paper's numbers by hand, resets and ends, and the plant's own units."""

import dataclasses
import functools
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from refusals import refusal
from swingup.benchmark.board import Setting
from swingup.benchmark.boards import SIM2REAL
from swingup.common.errors import SwingupError
from swingup.dynamics.dynamics import UPRIGHT, linearise
from swingup.dynamics.integrate import rk4_step
from swingup.loop.resolve import resolve
from swingup.loop.starts import thrown_states, winnable_states
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, ROBOTS
from swingup.tasks.acrobot_swingup import CAPSULES, MAGNIFY, MJCF, UNSTABLE, AcrobotPractice, AcrobotSwingup
from swingup.tasks.pendulum import PendulumState
from swingup.tasks.presets import TASKS, get_task, paper_task, smooth_task
from swingup.tasks.task import AbstractTask, MagnifyStage, Step, check_energy

PI = np.pi
KEY = jax.random.key(0)
BATCH = 1000
"""Transitions are made in batches of one size, so that each task compiles once."""

made = functools.cache(get_task)
"""Starts after throws are simulated: each task is made once."""

rk4 = jax.jit(jax.vmap(rk4_step, (None, 0, 0, None)))


@jax.jit
def steps(task, x, count, actions, keys):
    """Many transitions at once: states, actions and keys are batched, the count of steps before is not."""
    states = PendulumState(x=x, steps=jnp.full(len(x), count))
    return jax.vmap(task.step)(states, actions, keys)


def step_from(task, x, action=0.0, count=0):
    x, action = (jnp.tile(jnp.array(entries, jnp.float32), (BATCH, 1)) for entries in (x, [action]))
    result = steps(task, x, count, action, jax.random.split(KEY, BATCH))
    return jax.tree.map(lambda leaf: np.asarray(leaf)[0], result)


def test_reward_by_hand():
    """The paper's, and the smooth task's, which bounds the cost of velocities at 20 rad/s."""
    paper, smooth = paper_task(ROBOTS["acrobot"]), smooth_task(ROBOTS["pendubot"])
    for task, x, u, reward in (
        (paper, (0, 0, 0, 0), (0, 0), -0.05 * PI**2),  # hanging: -0.001 * 50 π² = -0.4935
        (smooth, (PI, 0, 50, -99), (0, 0), -2.4),  # -0.001 * (4 * 20² + 2 * 20²)
        (smooth, (PI, 0, -10, 0), (0, 0), -0.4),
    ):
        found = task.reward(jnp.array(x, jnp.float32), jnp.array(u, jnp.float32))
        assert float(found) == pytest.approx(reward, rel=1e-5, abs=1e-6)
    assert (smooth.observation.angles, smooth.observation_size) == ("sincos", 6)


def test_passive_joint_gets_no_torque(robot):
    # Even where the plant allows both motors 10 N m.
    task = dataclasses.replace(paper_task(robot), parameters=load_plant("C.1").changed(tl1=10.0, tl2=10.0))
    expected = {"acrobot": [0.0, -5.0], "pendubot": [-5.0, 0.0]}[robot.name]
    np.testing.assert_allclose(task.torque(jnp.array([-0.5])), expected)
    np.testing.assert_array_equal(np.isnan(task.torque(jnp.array([math.nan]))), robot.actuation)


def test_reset_hangs_with_gaussian_noise_on_all_four_states():
    task = dataclasses.replace(paper_task(ROBOTS["acrobot"]), reset_noise=0.02)
    count = 20_000
    states = jax.jit(jax.vmap(task.reset))(jax.random.split(KEY, count))
    noise = np.asarray(states.x) / 0.02
    np.testing.assert_array_equal(states.steps, 0)
    # Five standard errors: of a mean 1/√n, of a standard deviation 1/√(2n), of a correlation 1/√n.
    error = 5 / np.sqrt(count)
    np.testing.assert_allclose(noise.mean(axis=0), 0, atol=error)
    np.testing.assert_allclose(noise.std(axis=0), 1, atol=error / np.sqrt(2))
    np.testing.assert_allclose(np.corrcoef(noise.T), np.eye(4), atol=error)
    # P(|z| < 1) = 0.6827 and P(|z| > 3) = 0.0027 of a Gaussian, to five standard errors.
    assert np.mean(np.abs(noise) < 1) == pytest.approx(0.6827, abs=5 * np.sqrt(0.6827 * 0.3173 / noise.size))
    assert np.mean(np.abs(noise) > 3) == pytest.approx(0.0027, abs=5 * np.sqrt(0.0027 / noise.size))


def test_truncated_after_exactly_max_steps_and_not_reset(either_robot):
    task = dataclasses.replace(paper_task(either_robot), truncation_probability=0.0)

    def advance(state, key):
        result = task.step(state, jnp.ones(1), key)
        return result.state, result

    start = PendulumState(x=jnp.zeros(4), steps=jnp.array(0))
    results = jax.jit(lambda: jax.lax.scan(advance, start, jax.random.split(KEY, 1005))[1])()
    np.testing.assert_array_equal(results.state.steps, np.arange(1, 1006))
    # The 1000th step (10 s) is the first to be truncated, and every later one of whoever does not reset.
    np.testing.assert_array_equal(results.truncated, np.arange(1, 1006) >= 1000)
    # Nothing happens to the state at the limit: the 1001st step goes on from the 1000th.
    torques = np.tile(6.0 * np.array(either_robot.actuation), (4, 1))
    expected = rk4(task.parameters, results.state.x[999:1003], jnp.array(torques, jnp.float32), 0.01)
    np.testing.assert_allclose(results.state.x[1000:1004], expected, rtol=1e-5, atol=1e-4)
    assert np.abs(results.state.x[999:]).max() > 1


@pytest.mark.parametrize(("changes", "probability"), [({}, 1e-3), ({"truncation_probability": 0.2}, 0.2)])
def test_truncated_at_random_about_as_often_as_the_paper_says_or_as_asked(changes, probability):
    task = dataclasses.replace(paper_task(ROBOTS["acrobot"]), **changes)
    count, x, actions = 100 * BATCH, jnp.zeros((BATCH, 4)), jnp.zeros((BATCH, 1))
    keys = jax.random.split(KEY, (100, BATCH))
    truncated = sum(int(steps(task, x, 0, actions, row).truncated.sum()) for row in keys)
    deviation = np.sqrt(count * probability * (1 - probability))
    assert abs(truncated - count * probability) < 5 * deviation


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in ("short", "anywhere"))) for name in TASKS]
)
def test_never_terminated_and_cut_where_it_diverges(name, either_robot):
    # Neither at the limit of steps, nor at velocities where the integrator diverges.
    generator, keys = np.random.default_rng(0), jax.random.split(KEY, BATCH)
    x = generator.uniform([-7, -7, -15, -15], [7, 7, 15, 15], (BATCH, 4)).astype(np.float32)
    actions = generator.uniform(-1, 1, (BATCH, 1)).astype(np.float32)
    task = made(name, either_robot)
    assert task.robot == either_robot
    result = steps(task, x * np.tile(np.float32([[1e3], [1.0]]), (BATCH // 2, 1)), 999, actions, keys)
    assert not np.any(result.terminated)
    assert np.all(result.truncated)
    assert not step_from(task, [0.3, 0.2, 20.0, -20.0], 1.0).truncated  # fast, but sound
    # At such rates a Runge-Kutta step of 0.01 s overshoots without bound, to inf and NaN: the last state is kept.
    task = dataclasses.replace(task, truncation_probability=0.0)
    for rates in ((500.0, -500.0), (1e30, 1e30), (2000.0, 0.0)):
        x = np.array([0.3, 0.2, *rates], np.float32)
        beyond = rk4(task.parameters, jnp.tile(x, (BATCH, 1)), jnp.zeros((BATCH, 2)), 0.01)
        assert not np.all(np.abs(beyond[0, 2:]) < 1000)
        result = step_from(task, x)
        assert (bool(result.truncated), bool(result.terminated), int(result.state.steps)) == (True, False, 1)
        np.testing.assert_array_equal(result.state.x, x)
        assert np.all(np.isfinite(result.observation))


def test_the_global_task_starts_thrown_anywhere_or_hanging_and_is_rewarded_for_being_up(either_robot):
    task, still = made("global", either_robot), jnp.zeros(2)
    x = np.asarray(jax.jit(jax.vmap(task.reset))(jax.random.split(jax.random.key(0), 2000)).x)
    assert np.abs(x[:, :2]).max() <= np.pi
    assert np.all(np.abs(x) < 0.3, axis=1).mean() == pytest.approx(0.15, abs=0.03)  # hanging
    # Upright the tip is 0.05 m above the line, five widths of the smoothed edge.
    assert float(task.reward(jnp.float32(UPRIGHT), still)) == pytest.approx(-0.5 / (1 + np.exp(5.0)), rel=1e-4)
    # Hanging costs 50 π² / 1000 before it is saturated; the tip is down.
    saturated = 1 - np.exp(-0.05 * np.pi**2 / 0.3)
    assert float(task.reward(jnp.zeros(4), still)) == pytest.approx(-0.5 * (saturated + 1), rel=1e-5)
    assert float(task.reward(jnp.array([0.0, 0.0, 15.0, 15.0]), still)) >= -1.0  # nor for being slow
    # The anywhere task has its starts, the same for every task of the robot, so that runs repeat. Hanging costs
    # -0.001 · 50 π² = -0.4935 of the paper's reward, saturated: -(1 - exp(-0.4935)).
    anywhere = made("anywhere", either_robot)
    assert np.array_equal(anywhere.starts, task.starts)
    for q1, reward in ((0.0, -0.3895), (PI, 0.0)):
        assert float(anywhere.reward(jnp.array([q1, 0.0, 0.0, 0.0]), still)) == pytest.approx(reward, abs=1e-4)


@eqx.filter_jit
def episode(task, actions):
    """Observations, rewards and tip heights over the length of an episode from one key."""
    start = task.reset(jax.random.key(1))

    def advance(state, action):
        step = task.step(state, action, jax.random.key(2))
        return step.state, (step.observation, step.reward)

    return task.observe(start), jax.lax.scan(advance, start, actions)[1]


@pytest.mark.parametrize("name", ["smooth", pytest.param("paper", marks=pytest.mark.slow)])
def test_a_similar_pendulum_has_the_same_decision_process(name, either_robot, x64, similar):
    actions = jnp.asarray(np.random.default_rng(0).uniform(-1, 1, (60, 1)))
    task = get_task(name, either_robot)
    twin = get_task(name, either_robot, similar(task.parameters))
    expected, found = episode(task, actions), episode(twin, actions)
    assert twin.cost_velocity_limit == pytest.approx(2 * task.cost_velocity_limit)  # T = 0.5
    # It moves, and both angles and rates are observed.
    assert np.ptp(expected[1][0], axis=0).min() > 0.05
    for mine, theirs in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-8, atol=1e-10)


@pytest.mark.slow
def test_the_global_task_of_a_similar_pendulum_is_in_its_units(either_robot, x64, similar):
    task = get_task("global", either_robot)
    plant = task.parameters
    twin = get_task("global", either_robot, similar(plant))
    assert twin.up_line_width == pytest.approx(0.25 * 0.01)
    # The last thousands are drawn, not simulated: anywhere, then hanging.
    np.testing.assert_allclose(twin.starts[-6000:], task.starts[-6000:] * np.array([1, 1, 2, 2]), rtol=1e-6)
    thrown = functools.partial(thrown_states, number=8, duration=0.02)
    expected, found = (thrown(np.random.default_rng(0), each) for each in (plant, similar(plant)))
    assert np.abs(expected[:, 2:]).max() > 5
    np.testing.assert_allclose(found, expected * [1, 1, 2, 2], rtol=1e-8, atol=1e-10)


def test_the_rules_of_a_swing_up_are_in_the_units_of_the_domains_plant(either_robot):
    around_c1 = resolve(domain="randomised")
    assert SIM2REAL.on(Setting(either_robot, LEADERBOARD, around_c1)).limits == SIM2REAL.limits
    # T is 0.4258 of C.1's: speeds up to 20 / 0.4258 rad/s.
    small = resolve(domain={"plant": "cloudpendulum", "m1": [0.1, 0.11]})
    board = SIM2REAL.on(Setting(either_robot, small.design, small))
    assert board.limits.speed == pytest.approx(46.97, abs=0.01)


def test_a_step_is_mujocos(x64, tmp_path):
    mujoco = pytest.importorskip("mujoco")
    (tmp_path / "acrobot.xml").write_text(MJCF)
    assert load_plant(tmp_path / "acrobot.xml").values() == pytest.approx(CAPSULES.values(), rel=1e-15)
    model = mujoco.MjModel.from_xml_string(MJCF)
    data, random, step = mujoco.MjData(model), np.random.default_rng(0), jax.jit(rk4_step)
    for _ in range(100):
        angles, rates, action = random.uniform(-3, 3, 2), 4 * random.normal(size=2), random.uniform(-1, 1)
        data.qpos[:], data.qvel[:], data.ctrl[:] = angles, rates, action
        mujoco.mj_step(model, data)
        x = jnp.array([angles[0] + math.pi, angles[1], *rates])
        found = step(CAPSULES, x, jnp.array([0.0, 2.0 * action]), 0.01)
        expected = [data.qpos[0] + math.pi, data.qpos[1], *data.qvel]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_the_reward_by_hand():
    for q1, dense, sparse in (
        (math.pi, 1.0, 1.0),
        # Stretched and leaning by a, the tip is 4 sin(a/2) from the top: 0.2 m within, 1.2 m at a tenth.
        (math.pi + 2 * math.asin(0.199 / 4), 1.0, 1.0),
        (math.pi + 2 * math.asin(1.2 / 4), 0.1, 0.0),
        (0.0, 0.1 ** (3.8**2), 0.0),
    ):
        x = jnp.array([q1, 0.0, 0.0, 0.0])
        assert AcrobotSwingup().reward(x) == pytest.approx(dense, rel=1e-4)
        assert AcrobotSwingup(sparse=True).reward(x) == pytest.approx(sparse)


def test_observation_start_and_end():
    task = AcrobotSwingup()
    states = np.asarray(jax.jit(jax.vmap(task.reset))(jax.random.split(jax.random.key(0), 2000)).x)
    assert not states[:, 2:].any()
    # The deviation of a uniform angle is π / √3; 2,000 draws are within 3 %.
    np.testing.assert_allclose(states[:, :2].std(axis=0), math.pi / math.sqrt(3), rtol=0.03)
    x = jnp.array([math.pi + 0.1, 0.2, 3.0, 4.0])
    expected = [math.sin(0.1), math.sin(0.3), math.cos(0.1), math.cos(0.3), 3.0, 4.0]
    np.testing.assert_allclose(task.observe(PendulumState(x, jnp.array(0))), expected, rtol=1e-5)
    last = jax.jit(task.step)(PendulumState(x, jnp.array(999)), jnp.zeros(1), jax.random.key(0))
    assert last.truncated
    assert not last.terminated


def test_practice_observes_and_acts_as_the_task():
    starts = np.asarray(winnable_states(jax.random.key(0), CAPSULES, 500, 100, 0.5))
    assert starts.shape[1] == 4
    assert 250 < len(starts) <= 500
    # Those of the shortest paths can be held, and are closer to upright than the others.
    assert np.quantile(np.abs(starts[:, 1]), 0.2) < 0.01 < np.quantile(np.abs(starts[:, 1]), 0.8)
    practice, task = AcrobotPractice(starts=starts, start_share=1.0), AcrobotSwingup()
    state = jax.jit(lambda key: practice.reset(key))(jax.random.key(1))
    assert np.any(np.all(starts == state.x, axis=1))
    mine = jax.jit(lambda *given: practice.step(*given))(state, np.array([0]), jax.random.key(2))
    step = jax.jit(task.step)(state, np.array([-1.0], np.float32), jax.random.key(2))
    np.testing.assert_allclose(mine.state.x, step.state.x, rtol=1e-6)
    seen = np.asarray(step.observation)
    np.testing.assert_allclose(mine.observation[:6], seen, rtol=1e-5)
    assert mine.observation[6] == pytest.approx(math.asinh(1000 * seen[0]), rel=1e-5)
    np.testing.assert_allclose(MAGNIFY(seen), mine.observation, rtol=1e-5)
    # Upright is [π, 0], and angles are within ± π.
    x = np.asarray(step.state.x, float) - [math.pi, 0.0, 0.0, 0.0]
    x[:2] = (x[:2] + math.pi) % (2 * math.pi) - math.pi
    np.testing.assert_allclose(mine.observation[12:], np.arcsinh(10.0 * UNSTABLE @ x), rtol=1e-4)


@pytest.mark.parametrize(
    ("factors", "rows", "before"), [(6, (2, 4), 8), (3, (2, 4), 6), (6, (2, 3), 6), (6, (4,), 6)]
)
def test_a_magnify_stage_of_other_shapes_is_refused(factors, rows, before):
    stage = MagnifyStage(np.ones(factors), np.ones(rows))
    assert "factors and combinations have shapes" in refusal(stage.size, before)


def test_the_unstable_coordinates_of_dm_controls_acrobot():
    """c = w·x has c' = λ c + w·B u, with w·B u = λ at full torque: it brings back what is within ± 1."""
    A, B = linearise(CAPSULES, jnp.asarray(UPRIGHT, jnp.float32), jnp.zeros(2, jnp.float32))
    for row, rate in zip(UNSTABLE, (6.5423, 2.6574), strict=True):
        np.testing.assert_allclose(row @ np.asarray(A), rate * row, rtol=1e-4)
        assert row @ np.asarray(B)[:, 1] * CAPSULES.tl2 == pytest.approx(rate, rel=1e-4)


class Spring(AbstractTask[Any]):
    """A mass on a spring, by Euler's explicit or symplectic method, in steps of 0.1 s."""

    symplectic: bool = eqx.field(static=True)
    observation_size = action_size = 1

    def reset(self, key):
        return jnp.ones(2)

    def observe(self, state):
        return state

    def step(self, state, action, key):
        position, speed = state
        after = position + 0.1 * speed
        state = jnp.array([after, speed - 0.1 * (after if self.symplectic else position) + action[0]])
        return Step(state, state, jnp.zeros(()), jnp.array(False), jnp.array(False))


def test_an_integrator_that_gains_energy_is_found():
    """Explicit Euler multiplies the energy by 1 + dt² a step; the symplectic rule keeps it within dt/2 or so."""
    states, energy = jnp.array([[1.0, 0.0], [3.0, 0.0]]), lambda state: 0.5 * jnp.sum(state**2)
    assert 0.0 < check_energy(Spring(True), energy, states, [0.0], tolerance=0.1) < 0.1
    # (1.01^100 - 1) · 4.5 J, of a range of 4 J.
    with pytest.raises(SwingupError, match=r"gains 1\.92 of its range of energies in 100 steps"):
        check_energy(Spring(False), energy, states, [0.0], steps=100)
