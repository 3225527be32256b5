import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo import initial

# One program each costs less than compiling operation by operation.
init_actor = jax.jit(initial.init_actor, static_argnums=(1, 2, 3))
init_critic = jax.jit(initial.init_critic, static_argnums=(1, 2))


def test_actor_starts_near_zero_with_the_given_deviation():
    actor = init_actor(jax.random.key(0), 4, 1, (64, 64), -1.0)
    observations = np.random.default_rng(1).normal(size=(100, 4)).astype(np.float32)
    distribution = jax.jit(lambda actor, o: jax.vmap(actor)(o))(actor, observations)
    # σ = softplus(w·h + b) with b = log(e^(e^-1) - 1) and |w·h| small.
    np.testing.assert_allclose(distribution.log_std, -1.0, atol=0.5)
    assert abs(float(np.mean(distribution.log_std)) + 1.0) < 0.1
    assert float(np.max(np.abs(distribution.mean))) < 0.1


def test_a_clamped_deviation_is_not_stuck():
    """A policy whose log σ had passed 2 never learned again: `fast`, acrobot, after 189 million frames."""
    wide = init_actor(jax.random.key(0), 4, 1, (8,), 3.0)
    log_std, gradient = jax.jit(jax.value_and_grad(lambda actor: actor(jnp.zeros(4)).log_std[0]))(wide)
    assert float(log_std) == pytest.approx(2.0, abs=1e-6)
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
