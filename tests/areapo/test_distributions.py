"""Networks, and distributions of actions, in choices and in numbers: probabilities, samples, gradients."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo import initial
from swingup.areapo.networks import BoundedGaussian, Categoricals

# Probabilities 0.2, 0.3, 0.5 of the first action and 0.9, 0.1 of the second; logits are free up to a constant.
PAIR = Categoricals(np.float32([*(np.log([0.2, 0.3, 0.5]) + 4.0), *(np.log([0.9, 0.1]) - 2.0)]), (3, 2))
init_categorical_actor = jax.jit(initial.init_categorical_actor, static_argnums=(1, 2, 3))
log_prob = jax.jit(lambda distribution, action: distribution.log_prob(action))


def test_log_prob_by_hand():
    # P(2, 0) = 0.5 · 0.9
    assert log_prob(PAIR, np.array([2, 0])) == pytest.approx(np.log(0.45), rel=1e-5)
    assert log_prob(PAIR, np.array([0, 1])) == pytest.approx(np.log(0.02), rel=1e-5)
    assert sum(np.exp(log_prob(PAIR, np.array(pair))) for pair in np.ndindex(3, 2)) == pytest.approx(1.0, abs=1e-6)


def test_samples_follow_the_probabilities():
    actor = init_categorical_actor(jax.random.key(1), 3, PAIR.choices, (8,))
    draw = jax.jit(lambda key: jax.vmap(PAIR.sample, 1)(actor.noise(key, (100_000,))))
    drawn = np.asarray(draw(jax.random.key(0)))
    # Standard deviation of a share: at most 0.5 / sqrt(100,000) = 0.0016.
    np.testing.assert_allclose(np.bincount(drawn[:, 0]) / 1e5, [0.2, 0.3, 0.5], atol=0.007)
    np.testing.assert_allclose(np.bincount(drawn[:, 1]) / 1e5, [0.9, 0.1], atol=0.007)
    # The actions are drawn apart: P(2, 1) = 0.5 · 0.1.
    assert np.mean((drawn == [2, 1]).all(axis=1)) == pytest.approx(0.05, abs=0.005)


def test_a_new_policy_is_next_to_uniform():
    actor = init_categorical_actor(jax.random.key(0), 3, (3, 2), (32, 32))
    observations = np.random.default_rng(1).normal(size=(3, 20)).astype(np.float32)
    log_probs = jax.jit(lambda actor, pair: actor(observations).log_prob(jnp.tile(pair[:, None], 20)))
    for pair in np.ndindex(3, 2):
        np.testing.assert_allclose(np.exp(log_probs(actor, np.array(pair))), 1 / 6, atol=0.007)


def density(distribution, actions):
    """π(a) at actions in (-1, 1), through the samples before tanh."""
    return np.exp(log_probs(distribution, np.arctanh(actions)))


@jax.jit
def log_probs(distribution, z):
    """At samples z (n,) of one action before tanh."""
    return jax.vmap(lambda z: distribution.log_prob(z[None]))(z)


@pytest.mark.parametrize(("mean", "log_std"), [(0.0, -1.0), (0.7, -2.0), (-1.2, 0.3), (0.0, 1.0)])
def test_density_integrates_to_one(mean, log_std):
    with jax.enable_x64(True):
        distribution = BoundedGaussian(np.array([mean]), np.array([log_std]))
        # With a = tanh(z) the integral over [-1, 1] is one over z, which a plain sum resolves.
        z = np.linspace(-40.0, 40.0, 400_001)
        integral = np.sum(np.exp(log_probs(distribution, z)) / np.cosh(z) ** 2) * (z[1] - z[0])
        assert integral == pytest.approx(1.0, abs=1e-9)


def test_log_prob_of_numbers_by_hand():
    # Standard normals at z = 0 and 1: log N = -log sqrt(2π) - z² / 2; the slopes of tanh are 1 and 1 - tanh(1)².
    pair = BoundedGaussian(np.zeros(2, np.float32), np.zeros(2, np.float32))
    expected = -np.log(2 * np.pi) - 0.5 - np.log(1 - np.tanh(1.0) ** 2)
    assert log_prob(pair, np.float32([0, 1])) == pytest.approx(expected, rel=1e-6)
    # A clipped action has the density of z.
    clipped = BoundedGaussian(np.zeros(1, np.float32), np.zeros(1, np.float32), "clip")
    assert log_prob(clipped, np.float32([2])) == pytest.approx(-0.5 * np.log(2 * np.pi) - 2.0, rel=1e-6)
    np.testing.assert_array_equal(clipped.action(np.float32([-3.0, 0.25, 1.5])), [-1.0, 0.25, 1.0])
    # 1 - tanh(z)² → 4 e^(-2z) far out, where tanh(z) rounds to 1 in float32.
    distribution = BoundedGaussian(np.float32([15.0]), np.zeros(1, np.float32))
    expected = -0.5 * np.log(2 * np.pi) - (np.log(4.0) - 2 * 15.0)
    assert log_prob(distribution, np.float32([15])) == pytest.approx(expected, rel=1e-6)


def test_samples_follow_the_density():
    distribution = BoundedGaussian(np.float32([0.4]), np.float32([-0.5]))

    @jax.jit
    def draw(key):
        noise = init_actor(key, 4, 1, (8,), -1.0).noise(key, (200_000,))
        return distribution.action(jax.vmap(distribution.sample, 1, 1)(noise))[0]

    actions = np.asarray(draw(jax.random.key(0)))
    counts, edges = np.histogram(actions, bins=20, range=(-1, 1), density=True)
    centres = 0.5 * (edges[1:] + edges[:-1])
    # The density bends little within a bin but for the outermost ones.
    np.testing.assert_allclose(counts[2:-2], density(distribution, centres)[2:-2], atol=0.03)
    assert np.all(np.abs(actions) <= 1.0)


# One program each costs less than compiling operation by operation.
init_actor = jax.jit(initial.init_actor, static_argnums=(1, 2, 3))
init_critic = jax.jit(initial.init_critic, static_argnums=(1, 2))


def test_a_clamped_deviation_is_not_stuck():
    """A policy whose log σ had passed 2 never learned again: `fast`, acrobot, after 189 million frames."""
    wide = init_actor(jax.random.key(0), 4, 1, (8,), 3.0)
    log_std, gradient = jax.jit(jax.value_and_grad(lambda actor: actor(jnp.zeros(4)).log_std[0]))(wide)
    assert float(log_std) == pytest.approx(2.0, abs=1e-6)
    usual = init_actor(jax.random.key(0), 4, 1, (8,), -1.0)
    assert float(usual(jnp.zeros(4)).log_std[0]) == pytest.approx(-1.0, abs=1e-5)
    assert float(gradient.std_head.bias[0]) > 0.1


def test_weights_are_orthogonal():
    actor = init_actor(jax.random.key(0), 4, 1, (64, 64), -1.0)
    critic = init_critic(jax.random.key(0), 4, (96, 96))
    square = np.asarray(actor.trunk[1].weight)
    # Gain √2: W Wᵀ = 2 I.
    np.testing.assert_allclose(square @ square.T, 2.0 * np.eye(64), atol=1e-4)
    first = np.asarray(critic.trunk[0].weight)
    np.testing.assert_allclose(first.T @ first, 2.0 * np.eye(4), atol=1e-4)
    # One row each: norm 0.01 for the mean, 1 for both values.
    assert float(np.linalg.norm(actor.mean_head.weight)) == pytest.approx(0.01, rel=1e-4)
    np.testing.assert_allclose(np.linalg.norm(critic.heads.weight, axis=1), 1.0, rtol=1e-4)
    assert all(not np.any(layer.bias) for layer in (*actor.trunk, *critic.trunk, actor.mean_head, critic.heads))
    # The sizes of Table I: 4·256 + 256 + 256·256 + 256 + 2 (256 + 1) and 4·512 + 512 + 512·512 + 512 + 2 (512 + 1).
    actor = jax.eval_shape(lambda key: init_actor(key, 4, 1, (256, 256), -1.0), jax.random.key(0))
    critic = jax.eval_shape(lambda key: init_critic(key, 4, (512, 512)), jax.random.key(0))
    assert sum(leaf.size for leaf in jax.tree.leaves(actor)) == 67_586
    assert sum(leaf.size for leaf in jax.tree.leaves(critic)) == 266_242


def test_layers_of_seeds_side_by_side_are_factored_one_by_one():
    """LAPACK of two batches at once may wait for ever on two cores: of 135 runs of two seeds 12 never began."""
    keys = jax.random.split(jax.random.key(3), 3)

    def init(key):
        return initial.init_critic(key, 4, (64, 64))

    together = jax.jit(jax.vmap(init))
    matrices = re.findall(r"geqrf.*-> \(tensor<([\dx]+)xf32>", together.lower(keys).as_text())
    assert set(matrices) == {"64x4", "64x64", "64x1"}
    alone = [init_critic(key, 4, (64, 64)) for key in keys]
    jax.tree.map(lambda a, *b: np.testing.assert_array_equal(a, np.stack(b)), together(keys), *alone)


def test_a_deviation_that_does_not_depend_on_the_state():
    actor = jax.jit(lambda key: initial.init_actor(key, 4, 2, (8,), -0.5, bounds="clip"))(jax.random.key(0))
    observations = 3 * np.random.default_rng(1).normal(size=(4, 50)).astype(np.float32)

    @jax.jit
    @jax.grad
    def slope(actor):
        # Both rows of log σ, weighted: its gradient is not zero by symmetry.
        return jnp.sum(actor(observations).log_std * observations[:2] ** 2)

    np.testing.assert_allclose(jax.jit(lambda actor: actor(observations).log_std)(actor), -0.5, atol=1e-6)
    gradient = slope(actor)
    assert not np.any(gradient.std_head.weight)
    assert not any(np.any(layer.weight) for layer in gradient.trunk)
    np.testing.assert_allclose(gradient.std_head.bias, np.sum(observations[:2] ** 2, axis=1), rtol=1e-4)
