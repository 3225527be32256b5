"""Tasks in their plant's own units: C.1's as they are, and the same decision process for a similar pendulum."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.benchmark.board import Setting
from swingup.benchmark.boards import SIM2REAL
from swingup.loop.domain import load_domain, make_domain
from swingup.loop.supervisors.throws import thrown_states
from swingup.plant.plant import LEADERBOARD
from swingup.tasks.presets import get_task, smooth_task

STEPS = 60


SLOW_GLOBAL = pytest.param("global", marks=pytest.mark.slow)
"""Its many throws take seconds."""


@pytest.mark.parametrize("name", ["paper", "smooth", SLOW_GLOBAL])
def test_the_leaderboards_plant_gives_todays_task(name, either_robot):
    assert get_task(name, either_robot, LEADERBOARD.driven(either_robot)) == get_task(name, either_robot)


def test_a_scaled_task_has_the_numbers_of_its_units(either_robot, similar):
    # T = 0.5 and torques of 0.025: rates are doubled, their weights 0.5², the torque's weight 1 / 0.025².
    task = smooth_task(either_robot, similar(LEADERBOARD.driven(either_robot)))
    rates = (task.reset_rate, task.cost_velocity_limit, task.observation.velocity_scale)
    assert (task.dt, task.torque_cost, *rates) == pytest.approx((0.005, 1600.0, 2.0, 40.0, 40.0))
    assert task.state_cost == pytest.approx((50.0, 50.0, 1.0, 0.5))
    assert (task.reward_scale, task.max_steps, task.reset_noise) == (0.001, 1000, 0.01)


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
    actions = jnp.asarray(np.random.default_rng(0).uniform(-1, 1, (STEPS, 1)))
    task = get_task(name, either_robot)
    twin = get_task(name, either_robot, similar(task.parameters))
    expected, found = episode(task, actions), episode(twin, actions)
    # It moves, and both angles and rates are observed.
    assert np.ptp(expected[1][0], axis=0).min() > 0.05
    for mine, theirs in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-8, atol=1e-10)


@pytest.mark.slow
def test_throws_of_a_similar_pendulum_are_the_same_in_its_units(either_robot, x64, similar):
    plant = LEADERBOARD.driven(either_robot)
    expected, found = (thrown_states(np.random.default_rng(0), each, 8, 10) for each in (plant, similar(plant)))
    assert np.abs(expected[:, 2:]).max() > 5
    np.testing.assert_allclose(found, expected * [1, 1, 2, 2], rtol=1e-8, atol=1e-10)


@pytest.mark.slow
def test_the_global_tasks_starts_and_line_are_in_the_plants_units(either_robot, similar):
    task = get_task("global", either_robot)
    twin = get_task("global", either_robot, similar(task.parameters))
    assert twin.up_line_width == pytest.approx(0.25 * 0.01)
    # The last thousands are drawn, not simulated: anywhere, then hanging.
    np.testing.assert_allclose(twin.starts[-6000:], task.starts[-6000:] * np.array([1, 1, 2, 2]), rtol=1e-6)


def test_the_rules_of_a_swing_up_are_in_the_units_of_the_domains_plant(either_robot):
    around_c1 = load_domain("randomised")
    assert SIM2REAL.on(Setting(either_robot, LEADERBOARD, around_c1)).limits == SIM2REAL.limits
    # T is 0.4258 of C.1's: speeds up to 20 / 0.4258 rad/s.
    small = make_domain({"plant": "cloudpendulum", "m1": [0.1, 0.11]})
    board = SIM2REAL.on(Setting(either_robot, small.design, small))
    assert board.limits.speed == pytest.approx(46.97, abs=0.01)
