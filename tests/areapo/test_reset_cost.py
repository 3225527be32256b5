import dataclasses

import jax
import jax.numpy as jnp
import pytest

from swingup.areapo import algorithm
from swingup.areapo.config import Config
from swingup.areapo.reset_cost import COST_STEP, TERMINATION_TARGET, adapted_cost, charge_resets
from swingup.areapo.state import Rollout

from .probes import Trap

CONFIG = Config(
    num_envs=2, num_steps=4, batch_size=8, num_epochs=1, policy_layers=(8,), value_layers=(8,), reset_cost=3.0
)  # fmt: skip
ADAPTIVE = dataclasses.replace(CONFIG, terminations="adaptive_cost")


@pytest.mark.parametrize(
    ("cost", "rate", "expected"),
    [
        (3.0, 1.5 * TERMINATION_TARGET, 3.0 + 0.5 * COST_STEP),
        (3.0, 9.0 * TERMINATION_TARGET, 3.0 + COST_STEP),  # never by more than the step, whatever the excess
        (3.0, 0.0, 3.0 - COST_STEP),
        (0.1, 0.0, 0.0),  # never below zero
    ],
)
def test_the_cost_follows_the_rate_of_a_rollout(cost, rate, expected):
    assert float(adapted_cost(jnp.array(cost), jnp.array(rate))) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("terminations", "reward", "cost"),
    [
        ("reset_cost", 0.5, 3.0),
        ("adaptive_cost", 0.5, 1.5),  # what three steps earn
        ("adaptive_cost", -0.5, 0.0),
        ("bootstrap", 0.5, 0.0),
    ],
)
def test_what_a_reset_costs(terminations, reward, cost):
    config = dataclasses.replace(CONFIG, terminations=terminations)
    state = algorithm.init(jax.random.key(0), Trap(), config)
    nothing, ended = jnp.zeros((4, 2)), jnp.zeros((4, 2), bool).at[1, 0].set(True)
    # The row of a reset is not a step: its reward of 0 does not enter the mean.
    counted = jnp.ones((4, 2)).at[2, 0].set(0.0)
    rewards = reward * counted
    rollout = Rollout(nothing, nothing, nothing, rewards, nothing, ended, nothing > 0, counted)
    after, charged, found = charge_resets(state, rollout, config)
    assert float(found) == pytest.approx(cost)
    assert jnp.allclose(charged.rewards, rewards - cost * ended)
    assert (float(after.reset_cost) == 3.0) == (terminations != "adaptive_cost")


@pytest.mark.slow  # compiles for seconds
def test_the_cost_of_a_run_is_in_its_state():
    state = algorithm.init(jax.random.key(0), Trap(), ADAPTIVE)
    assert float(state.reset_cost) == 3.0
    after, metrics = jax.jit(algorithm.iteration)(state, Trap(), ADAPTIVE)
    assert float(after.reset_cost) == 3.0 + COST_STEP  # half of the first actions end the task
    # The first rollout has the first cost; the next one has another.
    assert float(metrics.reset_cost) == pytest.approx(3.0 * float(metrics.reward), rel=1e-5)
