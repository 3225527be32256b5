"""PopArt: rescaling changes no value; the statistics are those of the returns."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo import train
from swingup.areapo.config import Config
from swingup.areapo.networks import init_critic
from swingup.areapo.popart import MIN_SCALE, init_value_scale, rescale

from .probes import Cycle


def test_statistics_by_hand():
    scale = init_value_scale()
    np.testing.assert_array_equal(scale.scale, [1.0, 1.0])
    # Returns {1, 3} and {-2, -2}: means 2 and -2, mean squares 5 and 4.
    first = scale.update(jnp.array([2.0, -2.0]), jnp.array([5.0, 4.0]), 0.1)
    np.testing.assert_allclose(first.mean, [2.0, -2.0], rtol=1e-6)
    np.testing.assert_allclose(first.scale, [1.0, MIN_SCALE], rtol=1e-4)
    # The trace goes 0.1, 0.19, so that the second step is 0.1 / 0.19: μ = 2 + (10 - 2) / 1.9.
    second = first.update(jnp.array([10.0, -2.0]), jnp.array([110.0, 4.0]), 0.1)
    assert second.mean[0] == pytest.approx(2.0 + 8.0 / 1.9, rel=1e-6)
    assert second.square[0] == pytest.approx(5.0 + 105.0 / 1.9, rel=1e-6)


@pytest.mark.parametrize("moments", [([2.0, -3.0], [6.0, 10.0]), ([500.0, 0.1], [251_000.0, 0.02])])
def test_rescaling_keeps_all_values(moments):
    with jax.enable_x64(True):
        critic = jax.tree.map(lambda leaf: leaf.astype(jnp.float64), init_critic(jax.random.key(0), 3, (16,)))
        old = init_value_scale().update(jnp.array([1.0, 2.0]), jnp.array([2.0, 8.0]), 0.1)
        new = old.update(*map(jnp.array, moments), 0.1)
        observations = jax.random.normal(jax.random.key(1), (100, 3), jnp.float64)
        values = jax.jit(lambda critic, scale, o: scale.denormalise(jax.vmap(critic)(o)))
        before = values(critic, old, observations)
        after = values(rescale(critic, old, new), new, observations)
        assert not np.allclose(old.scale, new.scale)
        np.testing.assert_allclose(after, before, rtol=1e-12, atol=1e-12)


def test_an_estimate_changes_no_value_and_normalises_the_targets():
    config = Config(
        num_envs=8, num_steps=16, batch_size=128, policy_layers=(8,), value_layers=(8,), average_reward=False,
        discount=0.9, entropy_discount=0.9, popart=True, temperature=0.1,
    )  # fmt: skip
    plain = Config(**(vars(config) | {"popart": False}))
    task = Cycle(max_steps=5)
    init, collect, estimate = jax.jit(train.init), jax.jit(train.collect), jax.jit(train.estimate)
    start = init(jax.random.key(0), task, config)
    state, rollout = collect(start, jax.random.key(1), task, config)
    after, batch, _ = estimate(state, rollout, config)
    outputs = jax.jit(lambda critic, observations: jax.vmap(jax.vmap(critic))(observations))
    values = after.value_scale.denormalise(outputs(after.critic, rollout.observations))
    np.testing.assert_allclose(values, outputs(state.critic, rollout.observations), atol=1e-5)
    # Advantages and returns are those without PopArt; the targets have mean 0 and deviation 1.
    unscaled = init(jax.random.key(0), task, plain)
    _, expected, _ = estimate(*collect(unscaled, jax.random.key(1), task, plain), plain)
    np.testing.assert_allclose(batch.advantages, expected.advantages, atol=1e-5)
    np.testing.assert_allclose(after.value_scale.denormalise(batch.returns), expected.returns, atol=1e-5)
    np.testing.assert_allclose(jnp.mean(batch.returns, axis=(0, 1)), 0.0, atol=1e-4)
    np.testing.assert_allclose(jnp.std(batch.returns, axis=(0, 1)), 1.0, atol=1e-3)
