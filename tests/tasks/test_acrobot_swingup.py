"""dm_control's acrobot beside MuJoCo's own step, and its rewards by hand."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.dynamics.integrate import rk4_step
from swingup.loop.starts import winnable_states
from swingup.plant.files import load_plant
from swingup.tasks.acrobot_swingup import CAPSULES, MJCF, AcrobotPractice, AcrobotSwingup, magnified
from swingup.tasks.pendulum import PendulumState


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
    np.testing.assert_allclose(magnified(seen), mine.observation, rtol=1e-5)
