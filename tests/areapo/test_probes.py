"""The learner on tasks with known answers: gains, bias values and the maximum-entropy policy.

By default two levers are learned. The slow tests have the others, and those of the host loop
(``learner/test_back_ends.py``); what an ending means for a single rollout is in ``test_train.py``.
"""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo import algorithm, rewards
from swingup.areapo.config import Config
from swingup.areapo.state import reward_unit
from swingup.learner.presets import PRESETS

from .probes import Bowl, Constant, Cycle, Levers, Ring, Switch, Trap, Walk, best_squashed_gaussian

SMALL = Config(
    num_envs=16, num_steps=32, num_epochs=4, batch_size=128, policy_layers=(32, 32), value_layers=(32, 32),
    clip_range=0.2, learning_rate=2e-3, gain="td", centre_values=True,
)  # fmt: skip


init, advance = jax.jit(algorithm.init), jax.jit(algorithm.train)


@functools.cache
def learn(task, iterations=300, **changes):
    """Train with a high learning rate, then with a low one to settle; the metrics are the mean of the last part."""
    config = Config(**(vars(SMALL) | changes))
    state = init(jax.random.key(0), task, config)
    state, _ = advance(state, task, config, iterations)
    fine = dataclasses.replace(config, learning_rate=config.learning_rate / 10)
    state, _ = advance(state, task, fine, 100)
    return advance(state, task, fine, 100)


def values(state, observations):
    """[v, v_H] at raw observations."""
    return np.asarray(outputs(state.critic, state, observations))


@jax.jit
def outputs(network, state, observations):
    stage = state.statistics.stage()
    return jax.vmap(lambda o: network(stage(o)))(jnp.asarray(observations)[:, None])


TD = [name for name, each in PRESETS.items() if each.config.gain == "td"]
FIRST = ("continuing",)


@pytest.mark.parametrize(
    "preset", [*FIRST, *(pytest.param(n, marks=pytest.mark.slow) for n in TD if n not in FIRST)]
)
def test_the_gains_are_right_after_three_rollouts(preset):
    """For each λ, length of a rollout, unit and cost of a reset that is shipped; one compiled program for each."""
    config = PRESETS[preset].config
    cheap = {"num_envs": 4, "num_epochs": 1, "policy_layers": (8,), "value_layers": (8,)}
    config = dataclasses.replace(config, **cheap, batch_size=4 * config.num_steps)
    two = [0.0, 2.0, 0.0, 2.0]  # two states with the mean 1 and v(1) - v(0) = 1
    for paid, offset, ends in [([1.0] * 4, 0.0, 0), ([1.0] * 4, 1000.0, 0), (two, -100.0, 0), (two, 0.0, 1)]:
        task = Ring(offset=offset, rewards=jnp.array(paid), ends=jnp.array(ends > 0))
        state, _ = advance(init(jax.random.key(0), task, config), task, config, 2)
        state, metrics = advance(state, task, config, 1)
        # Every fourth step has an end, where there are ends.
        expected = 1.0 + offset - ends * float(metrics.reset_cost) / 4
        assert float(metrics.gain) == pytest.approx(expected, rel=0.05)
        unit = float(reward_unit(state))
        soft = config.temperature * unit * float(metrics.entropy)
        assert float(metrics.entropy_gain) == pytest.approx(soft, rel=0.05)
        assert (float(metrics.reset_cost) > 0) or not ends


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, {"centre_values": False}, {"terminations": "bootstrap"}], ids=str)
def test_cycle_has_gain_one_and_bias_difference_one(changes):
    """Also where the time limit is a termination that is bootstrapped."""
    # An odd time limit visits state 0 once more than state 1 (5 : 4 in 9 steps); bootstrapping at the truncation
    # keeps v(1) - v(0) at 1 and ρ at 1 all the same, where the mean reward collected is only 8/9.
    state, metrics = learn(Cycle(max_steps=9, terminates="terminations" in changes), temperature=0.1, **changes)
    zero, one = values(state, [0.0, 1.0])[:, 0]
    assert one - zero == pytest.approx(1.0, rel=0.02)
    assert metrics.gain == pytest.approx(1.0, rel=0.02)
    assert metrics.reward == pytest.approx(8 / 9, rel=0.02)


@pytest.mark.slow  # the two levers have a default test
@pytest.mark.parametrize(("task", "temperature"), [(Bowl(), 0.1), (Bowl(), 0.5), (Constant(), 0.3)])
def test_maximum_entropy_policy_of_numbers(task, temperature):
    """Of a bowl, cold and warm, and of entropy alone."""
    bowl = isinstance(task, Bowl)
    objective, mean, log_std = best_squashed_gaussian(lambda a: -(a**2) if bowl else np.ones_like(a), temperature)
    state, metrics = learn(task, temperature=temperature)
    assert metrics.entropy_gain == pytest.approx(temperature * float(metrics.entropy), rel=0.02)
    assert metrics.gain + metrics.entropy_gain == pytest.approx(objective, rel=0.02)
    policy = state.actor(jnp.zeros(1))
    assert float(policy.mean[0]) == pytest.approx(mean, abs=0.05)
    assert float(policy.log_std[0]) == pytest.approx(log_std, abs=0.05)


@pytest.mark.slow
def test_soft_gain_where_actions_choose_states():
    # The choice pays one step later and is the same in both states, so that it is the bandit r(a) = [a > 0].
    temperature = 0.3
    objective, mean, _ = best_squashed_gaussian(lambda a: (a > 0).astype(float), temperature)
    state, metrics = learn(Switch(), temperature=temperature)
    # A reset puts the state at 0 every 10 steps; bootstrapping makes the gain that of the endless task.
    assert metrics.gain + metrics.entropy_gain == pytest.approx(objective, rel=0.02)
    assert mean > 0.3
    # v(1) - v(0) = 1 + (p(1) - p(0)) (v(1) - v(0)) with p(s) = P(a > 0 | s) = Φ(mean / σ) of the policy as it is.
    policy = outputs(state.actor, state, [0.0, 1.0])
    p_zero, p_one = np.asarray(jax.scipy.stats.norm.cdf(policy.mean / jnp.exp(policy.log_std)))[:, 0]
    zero, one = values(state, [0.0, 1.0])[:, 0]
    # State 0 is rare under this policy: its value carries the noise of few samples.
    assert one - zero == pytest.approx(1.0 / (1.0 - (p_one - p_zero)), rel=0.1)


def softmax_policy(rewards, temperature):
    """The maximum-entropy policy of a bandit, exp(r/τ)/Z, and its objective τ log Z."""
    weights = np.exp(np.asarray(rewards) / temperature)
    return weights / weights.sum(), temperature * np.log(weights.sum())


def test_maximum_entropy_policy_of_two_levers():
    # The first choice pays one step later, the second nothing: softmax(0, 1/τ) and uniform.
    best, objective = softmax_policy([0.0, 1.0], 0.5)
    state, metrics = learn(Levers(), 150, temperature=0.5)
    assert metrics.gain + metrics.entropy_gain == pytest.approx(objective + 0.5 * np.log(4.0), rel=0.02)
    odds = np.exp(outputs(state.actor, state, [0.0, 1.0]).logits)
    first, second = (part / part.sum(axis=1, keepdims=True) for part in (odds[:, :2], odds[:, 2:]))
    np.testing.assert_allclose(first[1], best, atol=0.02)
    np.testing.assert_allclose(second[1], 0.25, atol=0.02)
    # As for the switch: v(1) - v(0) = 1 / (1 - (p(1) - p(0))), p(s) = P(first choice = 1 | s) of this policy.
    p_zero, p_one = first[:, 1]
    zero, one = values(state, [0.0, 1.0])[:, 0]
    assert one - zero == pytest.approx(1.0 / (1.0 - (p_one - p_zero)), rel=0.1)


@pytest.mark.slow
def test_a_termination_costs_and_goes_on_from_a_new_start():
    # Four steps of reward 1, of which the last costs 10 and leads back to the start: ρ = (4 - 10) / 4 = -1.5.
    # v(s_k+1) - v(s_k) = ρ - 1 = -2.5 for the states 0, 1, 2, 3 of the walk.
    state, metrics = learn(Walk(max_steps=4, terminates=True), temperature=0.0)
    assert metrics.gain == pytest.approx(-1.5, rel=0.02)
    np.testing.assert_allclose(np.diff(values(state, [0.0, 1.0, 2.0, 3.0])[:, 0]), -2.5, rtol=0.02)


@pytest.mark.slow
def test_a_reset_cost_is_the_multiplier_of_a_rate_of_terminations():
    # The best policy at a cost c has the odds exp((1 - c) / τ) of the trap: c = 1 - τ log(f / (1 - f)) for f.
    rate, temperature = 0.1, 0.5
    cost = 1 - temperature * np.log(rate / (1 - rate))
    _, metrics = learn(Trap(), temperature=temperature, reset_cost=cost)
    assert metrics.reward == pytest.approx(rate, rel=0.05)


@pytest.mark.slow
def test_discounted_values_of_a_terminating_task():
    # Three steps of reward 1 and the end: v(s0) = 1 + γ + γ² with γ = 0.5. The probe's one state hides the step,
    # so that its value is the mean over the three steps: (1.75 + 1.5 + 1) / 3.
    state, _ = learn(
        Constant(max_steps=3, terminates=True), temperature=0.0, gain="none", terminations="end",
        centre_values=False, discount=(0.5, 0.5), num_steps=30, batch_size=96,
    )  # fmt: skip
    assert values(state, [0.0])[0, 0] == pytest.approx((1.75 + 1.5 + 1.0) / 3, rel=0.02)


@pytest.mark.slow
def test_the_reset_cost_ends_at_zero_where_the_target_permits_the_best_policy(monkeypatch):
    monkeypatch.setattr(rewards, "TERMINATION_TARGET", 0.95)
    # Without a cost the odds are exp(1 / 0.5), a probability of 0.88.
    state, metrics = learn(Trap(), temperature=0.5, terminations="adaptive_cost", reset_cost=1.0)
    assert float(state.reset_cost) == 0.0
    assert metrics.reward == pytest.approx(1 / (1 + np.exp(-2)), rel=0.02)
