import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo.initial import init_actor
from swingup.areapo.networks import SquashedGaussian


def density(distribution, actions):
    """π(a) at actions in (-1, 1), through the samples before tanh."""
    return jnp.exp(jax.vmap(lambda a: distribution.log_prob(jnp.arctanh(a)[None]))(actions))


@pytest.mark.parametrize(("mean", "log_std"), [(0.0, -1.0), (0.7, -2.0), (-1.2, 0.3), (0.0, 1.0)])
def test_density_integrates_to_one(mean, log_std):
    with jax.enable_x64(True):
        distribution = SquashedGaussian(jnp.array([mean]), jnp.array([log_std]))
        # With a = tanh(z) the integral over [-1, 1] is one over z, which a plain sum resolves.
        z = jnp.linspace(-40.0, 40.0, 400_001)
        log_prob = jax.vmap(lambda z: distribution.log_prob(z[None]))(z)
        integral = jnp.sum(jnp.exp(log_prob) / jnp.cosh(z) ** 2) * (z[1] - z[0])
        assert integral == pytest.approx(1.0, abs=1e-9)


def test_entries_are_independent():
    distribution = SquashedGaussian(jnp.array([0.3, -0.5]), jnp.array([-1.0, 0.2]))
    z = jnp.array([0.1, 0.4])
    parts = [SquashedGaussian(distribution.mean[i : i + 1], distribution.log_std[i : i + 1]) for i in (0, 1)]
    total = sum(part.log_prob(z[i : i + 1]) for i, part in enumerate(parts))
    assert distribution.log_prob(z) == pytest.approx(float(total), rel=1e-6)


def test_log_prob_by_hand():
    # Standard normal at z = 0: log N = -log sqrt(2π); tanh has slope 1 there.
    distribution = SquashedGaussian(jnp.zeros(1), jnp.zeros(1))
    assert distribution.log_prob(jnp.zeros(1)) == pytest.approx(-0.5 * np.log(2 * np.pi), rel=1e-6)
    # At z = 1 log N falls by 1/2 and the slope is 1 - tanh(1)².
    expected = -0.5 * np.log(2 * np.pi) - 0.5 - np.log(1 - np.tanh(1.0) ** 2)
    assert distribution.log_prob(jnp.ones(1)) == pytest.approx(expected, rel=1e-6)


def test_log_prob_is_exact_near_saturation():
    # 1 - tanh(z)² → 4 e^(-2z) far out, where tanh(z) rounds to 1 in float32.
    distribution = SquashedGaussian(jnp.array([15.0]), jnp.zeros(1))
    expected = -0.5 * np.log(2 * np.pi) - (np.log(4.0) - 2 * 15.0)
    assert distribution.log_prob(jnp.array([15.0])) == pytest.approx(expected, rel=1e-6)


def test_samples_follow_the_density():
    distribution = SquashedGaussian(jnp.array([0.4]), jnp.array([-0.5]))
    actor = init_actor(jax.random.key(1), 4, 1, (8,), -1.0)
    z = jax.vmap(distribution.sample, 1, 1)(actor.noise(jax.random.key(0), (200_000,)))
    actions = np.asarray(distribution.action(z))[0]
    counts, edges = np.histogram(actions, bins=20, range=(-1, 1), density=True)
    centres = 0.5 * (edges[1:] + edges[:-1])
    # The density bends little within a bin but for the outermost ones.
    np.testing.assert_allclose(counts[2:-2], density(distribution, jnp.asarray(centres))[2:-2], atol=0.03)
    assert np.all(np.abs(actions) <= 1.0)
