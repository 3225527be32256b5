"""Gains and the loss, by hand."""

import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo import algorithm
from swingup.areapo.algorithm import lambda_advantages, update_gains
from swingup.areapo.config import Config
from swingup.areapo.initial import init_actor, init_critic
from swingup.areapo.state import Frames, LearnerState
from swingup.areapo.statistics import standardise

# One program each costs less than compiling operation by operation.
loss, gradient = jax.jit(algorithm.loss), jax.jit(jax.grad(algorithm.loss, has_aux=True))
log_probs = jax.jit(lambda actor, o, z: jax.vmap(lambda o, z: actor(o).log_prob(z))(o, z))
NETWORKS = jax.jit(lambda a, c: (init_actor(a, 3, 1, (8,), -1.0), init_critic(c, 3, (8,))))(
    jax.random.key(0), jax.random.key(1)
)
OBSERVATIONS = jax.random.normal(jax.random.key(2), (4, 3))
LATENTS = jax.random.normal(jax.random.key(3), (4, 1))
LOG_PROBS = log_probs(NETWORKS[0], OBSERVATIONS, LATENTS)
VALUES = jax.jit(lambda critic, o: jax.vmap(critic)(o))(NETWORKS[1], OBSERVATIONS)
CONFIG = Config(num_envs=2, num_steps=2, batch_size=4)


def batch(log_ratios=0.0, advantages=(1.0, -1.0, 1.0, -1.0), errors=0.0):
    """A batch whose probability ratios are e^log_ratios and whose value errors are ``errors``."""
    return Frames(OBSERVATIONS, LATENTS, LOG_PROBS - log_ratios, jnp.array(advantages), VALUES - errors)


def test_loss_by_hand():
    # Errors 2 and 3: 0.25 (2² + 0.5 · 3²) = 2.125; at ratio 1 the normalised advantages average to 0.
    total, metrics = loss(NETWORKS, batch(errors=jnp.array([2.0, 3.0])), CONFIG)
    np.testing.assert_allclose(
        [total, metrics.value_loss, metrics.entropy_value_loss], [2.125, 4.0, 9.0], rtol=1e-5
    )
    # ε = 0.05 and ratio 1.2: A = 1 counts 1.05, A = -1 counts -1.2; -mean of (1.05, -1.2, 1.05, -1.2) = 0.075.
    total, metrics = loss(NETWORKS, batch(log_ratios=jnp.log(jnp.full(4, 1.2))), CONFIG)
    assert total == pytest.approx(0.075, rel=1e-4)
    assert metrics.clip_fraction == 1.0
    # mean(r - 1 - log r) = 0.2 - log 1.2
    assert metrics.approximate_kl == pytest.approx(0.2 - np.log(1.2), rel=1e-4)
    # Ratio 0.8: A = 1 counts 0.8, A = -1 counts -0.95; -mean of (0.8, -0.95, 0.8, -0.95) = 0.075.
    assert loss(NETWORKS, batch(log_ratios=jnp.log(jnp.full(4, 0.8))), CONFIG)[0] == pytest.approx(0.075, rel=1e-4)


def test_gradient_at_ratio_one_is_the_policy_gradient():
    advantages = jnp.array([0.3, -1.0, 2.0, 0.7])

    def reinforce(actor):
        return -jnp.mean(log_probs(actor, OBSERVATIONS, LATENTS) * standardise(advantages))

    expected = jax.jit(jax.grad(reinforce))(NETWORKS[0])
    frames = batch(advantages=advantages)
    actual = gradient(NETWORKS, frames, CONFIG)[0][0]
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), actual, expected)


GAINS = {"gains": jnp.zeros(2), "gain_trace": jnp.zeros(())}
START = LearnerState(**dict.fromkeys(LearnerState.__dataclass_fields__) | GAINS)
"""Only the gains matter."""


@jax.jit
def history(rewards, config):
    """ρ after rollouts of one constant reward each, for values that stay at 0."""

    def learn(state, reward):
        deltas = jnp.full((config.num_steps, 1, 2), reward) - state.gains
        if config.gain == "advantage":
            deltas = lambda_advantages(deltas, jnp.zeros(deltas.shape[:2], bool), config)
        after = update_gains(state, deltas, types.SimpleNamespace(counted=None), config)
        return after, after.gains[0]

    return jax.lax.scan(learn, START, rewards)[1]


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


def test_rows_that_do_not_count_move_no_gain():
    errors = jnp.array([[[1.0, 1.0]], [[100.0, 100.0]]])
    rollout = types.SimpleNamespace(counted=jnp.array([[1.0], [0.0]]))
    np.testing.assert_allclose(update_gains(START, errors, rollout, Config()).gains, 1.0, rtol=1e-6)
