"""Hidden layers and their activations, in JAX, in NumPy and in files."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from policies import lone_policy
from swingup.areapo.networks import Actor
from swingup.controllers.stack.controller import save_controller
from swingup.controllers.stack.policy import Policy
from swingup.policy.network.layers import Layer, Network, largest_feature
from swingup.policy.numpy_backend.controller import numpy_controller
from swingup.policy.pendulum import read_pendulum_policy

from .references import random_states, small_policy

BY_HAND = {
    "relu": lambda x: max(x, 0.0),
    "tanh": math.tanh,
    "elu": lambda x: x if x > 0 else math.exp(x) - 1,
    "silu": lambda x: x / (1 + math.exp(-x)),
    "gelu": lambda x: x / 2 * (1 + math.tanh(math.sqrt(2 / math.pi) * (x + 0.044715 * x**3))),
}


def of_kind(activation):
    """The small controller with another activation."""
    controller = small_policy()
    actor = controller.policy.actor
    actor = Actor(actor.trunk, activation, actor.mean_head, actor.std_head)
    return dataclasses.replace(controller, policy=Policy(controller.policy.stages, actor))


@pytest.mark.parametrize("activation", BY_HAND)
def test_a_policy_file_in_jax_and_in_numpy(tmp_path, activation):
    """Both back ends compute what is written here by hand, from a file."""
    save_controller(tmp_path / "p.safetensors", of_kind(activation), {})
    found, states = read_pendulum_policy(tmp_path / "p.safetensors"), random_states()[:5]
    numpy, network = numpy_controller(found), found.network
    loaded, _ = lone_policy(tmp_path / "p.safetensors", "pendubot")
    with jax.enable_x64(True):
        judge = jax.jit(jax.vmap(lambda x: (loaded.policy.observe(x), 3.0 * loaded.policy(x)[0])))
        features, judged = map(np.asarray, judge(jnp.asarray(states)))
    for layer in network.trunk:
        features = features @ layer.weight.T.astype(float) + layer.bias
        features = np.vectorize(BY_HAND[activation])(features)
    expected = 3.0 * np.tanh(features @ network.head.weight[0].astype(float) + network.head.bias[0])
    np.testing.assert_allclose([numpy(x, 0.0)[0] for x in states], expected, atol=1e-12)
    np.testing.assert_allclose(judged, expected, atol=1e-12)
    assert np.ptp(expected) > 0.01


def test_a_bound_of_the_features():
    # |x| ≤ 1 gives 2·1 + 1 = 3, the head 10 times that.
    layer = Layer(np.full((3, 1), 2, np.float32), np.ones(3, np.float32))
    head = Layer(np.full((1, 3), 10 / 3, np.float32), np.zeros(1, np.float32))
    assert largest_feature(Network((), (layer,), head)) == pytest.approx(30.0)
    small = Network((), (Layer(layer.weight * 0, layer.bias * 0),), head, activation="elu")
    assert largest_feature(small) == pytest.approx(10.0)
