import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo import algorithm
from swingup.areapo.config import Config
from swingup.areapo.state import Rollout
from swingup.areapo.terminations import COST_STEP, TERMINATION_TARGET, adapted_cost, charge_resets

from .probes import Trap

CONFIG = Config(
    num_envs=2, num_steps=4, batch_size=8, num_epochs=1, policy_layers=(8,), value_layers=(8,), reset_cost=3.0
)  # fmt: skip
ADAPTIVE = dataclasses.replace(CONFIG, terminations="adaptive_cost")
init, charge = jax.jit(algorithm.init), jax.jit(charge_resets)


@pytest.mark.parametrize(
    ("cost", "terminations", "frames", "expected"),
    [
        (30.0, 6, 4000, 30.0 + 2 * COST_STEP),  # 4 are permitted
        (30.0, 36, 4000, 30.0 + 4 * COST_STEP),  # no more count than are permitted,
        (30.0, 3, 500, 30.0 + COST_STEP),  # or one
        (30.0, 0, 4000, 30.0 - 4 * COST_STEP),
        (0.1, 0, 4000, 0.0),  # never below zero
    ],
)
def test_the_cost_follows_the_terminations_of_a_rollout(cost, terminations, frames, expected):
    assert TERMINATION_TARGET == 1e-3
    found = adapted_cost(jnp.array(cost), jnp.array(terminations / frames), frames)
    assert float(found) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("terminations", "offset", "cost"),
    [
        ("reset_cost", 0.0, 3.0),
        ("adaptive_cost", 0.0, 1.5),  # three deviations
        ("adaptive_cost", -1000.0, 1.5),
        ("bootstrap", 0.0, 0.0),
    ],
)
def test_what_a_reset_costs(terminations, offset, cost):
    config = dataclasses.replace(CONFIG, terminations=terminations)
    state = init(jax.random.key(0), Trap(), config)
    nothing, ended = np.zeros((4, 2), np.float32), np.zeros((4, 2), bool)
    ended[1, 0] = True
    # The row of a reset is not a step: its reward of 0 does not enter the deviation.
    counted = np.float32([[1.0], [1.0], [0.0], [1.0]]) * np.ones((4, 2), np.float32)
    rewards = (offset + np.float32([0.5, -0.5])) * counted
    rollout = Rollout(nothing, nothing, nothing, rewards, nothing, ended, nothing > 0, counted)
    after, charged, found = charge(state, rollout, config)
    assert float(found) == pytest.approx(cost)
    np.testing.assert_allclose(charged.rewards, rewards - cost * ended, rtol=1e-5)
    assert (float(after.reset_cost) == 3.0) == (terminations != "adaptive_cost")


@pytest.mark.slow  # compiles for seconds
def test_the_cost_of_a_run_is_in_its_state():
    state = init(jax.random.key(0), Trap(), ADAPTIVE)
    assert float(state.reset_cost) == 3.0
    after, metrics = jax.jit(algorithm.iteration)(state, Trap(), ADAPTIVE)
    assert float(after.reset_cost) == 3.0 + COST_STEP  # half of the first actions end the task
    # The first rollout has the first cost; the next one has another.
    rate = float(metrics.reward)
    assert float(metrics.reset_cost) == pytest.approx(3.0 * (rate * (1.0 - rate)) ** 0.5, rel=1e-5)
