import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo.advantage import Gains, advantages, init_gains, update_gains
from swingup.areapo.config import Config


def plain_gae(rewards, values, next_values, cuts, gain, discount, gae_lambda):
    """The estimator as sums over the future: A_t = Σ_k (γλ)^k δ_{t+k}, until the first cut."""
    steps, envs = rewards.shape
    result = np.zeros_like(rewards)
    for env in range(envs):
        for start in range(steps):
            weight = 1.0
            for t in range(start, steps):
                delta = rewards[t, env] - gain + discount * next_values[t, env] - values[t, env]
                result[start, env] += weight * delta
                if cuts[t, env]:
                    break
                weight *= discount * gae_lambda
    return result


@pytest.mark.parametrize("discount", [1.0, 0.9])
@pytest.mark.parametrize("gae_lambda", [0.0, 0.6, 0.8, 1.0])
def test_advantages_equal_a_plain_loop(discount, gae_lambda):
    rng = np.random.default_rng(0)
    rewards, values, next_values = rng.normal(size=(3, 17, 5))
    cuts = rng.random((17, 5)) < 0.2
    with jax.enable_x64(True):
        result = advantages(rewards, values, next_values, cuts, jnp.array(0.3), discount, gae_lambda)
    np.testing.assert_allclose(
        result, plain_gae(rewards, values, next_values, cuts, 0.3, discount, gae_lambda), atol=1e-12
    )


def test_exact_values_leave_no_advantage():
    # Rewards 0, 2, 0, 2, ...: ρ = 1 and v = -½, ½ solve the Bellman equation v + ρ = r + v'.
    values = jnp.array([-0.5, 0.5, -0.5, 0.5])[:, None]
    next_values = jnp.array([0.5, -0.5, 0.5, -0.5])[:, None]
    rewards = jnp.array([0.0, 2.0, 0.0, 2.0])[:, None]
    result = advantages(rewards, values, next_values, jnp.zeros((4, 1), bool), jnp.array(1.0), 1.0, 0.8)
    np.testing.assert_allclose(result, 0.0, atol=1e-7)


def gains_under_constant_reward(config, updates):
    """ρ after each update, for reward 1 and values that stay at 0."""
    zeros = jnp.zeros((config.num_steps, 1))

    @jax.jit
    def update(gains):
        result = advantages(zeros + 1.0, zeros, zeros, zeros > 0, gains.reward, 1.0, config.gae_lambda)
        return update_gains(gains, result, 0.0 * result, config)

    gains, history = init_gains(), []
    for _ in range(updates):
        gains = update(gains)
        history.append(float(gains.reward))
    return history


def test_gain_starts_at_full_step_with_the_trace():
    # Over 128 steps mean(Σ 0.8^k) = 4.844: ρ_1 = 4.84, ρ_2 = 4.84 + 0.5025 · 4.84 (1 - 4.84) = -4.51, and so on.
    history = gains_under_constant_reward(Config(), 5)
    np.testing.assert_allclose(history, [4.84, -4.51, 4.48, 0.20, 0.99], atol=0.01)


def test_gain_without_the_trace_takes_the_papers_step():
    # ρ_1 = η · 4.844 = 0.04844.
    assert gains_under_constant_reward(Config(gain_trace=False), 1)[0] == pytest.approx(0.04844, abs=1e-5)


def test_gain_is_the_mean_reward_in_the_end():
    assert gains_under_constant_reward(Config(), 200)[-1] == pytest.approx(1.0, abs=1e-4)


def test_both_gains_share_the_trace():
    config = Config(gain_step_size=0.5)
    ones = jnp.ones((2, 1))
    gains = update_gains(Gains(jnp.array(1.0), jnp.array(2.0), jnp.array(0.5)), ones, 3 * ones, config)
    # trace = 0.5 + 0.5 · 0.5 = 0.75; the step is 0.5 / 0.75 = 2/3.
    assert gains.trace == pytest.approx(0.75)
    assert gains.reward == pytest.approx(1.0 + 2 / 3)
    assert gains.entropy == pytest.approx(2.0 + 2.0)


def test_discounted_learning_has_no_gain():
    config = Config(average_reward=False, discount=0.99, entropy_discount=0.99)
    gains = update_gains(init_gains(), jnp.ones((2, 1)), jnp.ones((2, 1)), config)
    assert (float(gains.reward), float(gains.entropy), float(gains.trace)) == (0.0, 0.0, 0.0)
