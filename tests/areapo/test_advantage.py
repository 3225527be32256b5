import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo.algorithm import lambda_advantages, update_gains
from swingup.areapo.config import Config
from swingup.areapo.state import LearnerState

ROLLOUT = types.SimpleNamespace(counted=None)


def gains(reward=0.0, entropy=0.0, trace=0.0):
    """A state of which only the gains matter."""
    others = dict.fromkeys(LearnerState.__dataclass_fields__)
    return LearnerState(**others | {"gains": jnp.array([reward, entropy]), "gain_trace": jnp.array(trace)})


def plain_gae(deltas, cuts, discount, gae_lambda):
    """The estimator as sums over the future: A_t = Σ_k (γλ)^k δ_{t+k}, until the first cut."""
    result = np.zeros_like(deltas)
    for start in range(len(deltas)):
        for env in range(deltas.shape[1]):
            weight = np.ones(2)
            for t in range(start, len(deltas)):
                result[start, env] += weight * deltas[t, env]
                if cuts[t, env]:
                    break
                weight = weight * discount * gae_lambda
    return result


@pytest.mark.parametrize("discount", [(1.0, 1.0), (0.9, 0.8)])
@pytest.mark.parametrize("gae_lambda", [(0.0, 1.0), (0.8, 0.6)])
def test_advantages_equal_a_plain_loop(discount, gae_lambda):
    rng = np.random.default_rng(0)
    deltas, cuts = rng.normal(size=(17, 5, 2)), rng.random((17, 5)) < 0.2
    with jax.enable_x64(True):
        found = jax.jit(lambda_advantages)(deltas, cuts, Config(discount=discount, gae_lambda=gae_lambda))
    expected = plain_gae(deltas, cuts, np.array(discount), np.array(gae_lambda))
    np.testing.assert_allclose(found, expected, atol=1e-12)


@jax.jit
def history(rewards, config):
    """ρ after rollouts of one constant reward each, for values that stay at 0."""

    def learn(state, reward):
        deltas = jnp.full((config.num_steps, 1, 2), reward) - state.gains
        if config.gain == "advantage":
            deltas = lambda_advantages(deltas, jnp.zeros(deltas.shape[:2], bool), config)
        after = update_gains(state, deltas, ROLLOUT, config)
        return after, after.gains[0]

    return jax.lax.scan(learn, gains(), rewards)[1]


def test_the_authors_gain_starts_at_full_step():
    # Over 128 steps mean(Σ 0.8^k) = 4.844: ρ_1 = 4.84, ρ_2 = 4.84 + 0.5025 · 4.84 (1 - 4.84) = -4.51, and so on.
    found = history(jnp.ones(200), Config())
    np.testing.assert_allclose(found[:5], [4.84, -4.51, 4.48, 0.20, 0.99], atol=0.01)
    assert found[-1] == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("gae_lambda", [0.0, 0.8, 0.98, 1.0])
def test_the_gain_of_errors_is_the_mean_reward(gae_lambda):
    """In each rollout, for every λ: mean(δ) = r - ρ with values that stay at 0."""
    found = history(jnp.array([0.0, 3.0, -9.0, 1009.0]), Config(gain="td", gae_lambda=(gae_lambda, 0.6)))
    np.testing.assert_allclose(found, [0.0, 3.0, -9.0, 1009.0], atol=1e-6)


def test_both_gains_share_the_trace():
    errors = jnp.broadcast_to(jnp.array([1.0, 3.0]), (2, 1, 2))
    after = update_gains(gains(1.0, 2.0, 0.5), errors, ROLLOUT, Config(gain_step_size=0.5))
    # trace = 0.5 + 0.5 · 0.5 = 0.75; the step is 0.5 / 0.75 = 2/3.
    assert after.gain_trace == pytest.approx(0.75)
    np.testing.assert_allclose(after.gains, [1.0 + 2 / 3, 2.0 + 2.0], rtol=1e-6)
    # Rows that do not count move no gain.
    errors = jnp.array([[[1.0, 1.0]], [[100.0, 100.0]]])
    rollout = types.SimpleNamespace(counted=jnp.array([[1.0], [0.0]]))
    np.testing.assert_allclose(update_gains(gains(), errors, rollout, Config()).gains, 1.0, rtol=1e-6)
