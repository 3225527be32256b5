"""Hidden layers: activations, layer normalisation and shared trunks, in JAX, in NumPy and in files."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from policies import lone_policy
from swingup.areapo.config import Config
from swingup.areapo.layers import LayerKind, LayerNorm, Linear, hidden_features, init_norms
from swingup.areapo.networks import Actor, init_shared_critic, values
from swingup.areapo.recurrence import GRU
from swingup.common.errors import SwingupError
from swingup.controllers.stack.controller import save_controller
from swingup.controllers.stack.policy import Policy
from swingup.export.c_backend.header import c_header
from swingup.export.javascript_backend.page import policy_data
from swingup.export.onnx_backend.graph import onnx_model
from swingup.policy.network.layers import Layer, Network, Norm, check_plain, largest_feature
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


def of_kind(activation, layer_norm):
    """The small controller with other hidden layers, whose normalisations are no identities."""
    controller = small_policy()
    actor, norms = controller.policy.actor, ()
    if layer_norm:
        norms = tuple(
            LayerNorm(*np.linspace([0.5, -0.3], [1.5, 0.3], layer.bias.size).T.astype(np.float32))
            for layer in actor.trunk
        )
    actor = Actor(actor.trunk, norms, activation, None, actor.mean_head, actor.std_head)
    return dataclasses.replace(controller, policy=Policy(controller.policy.stages, actor))


@pytest.mark.parametrize("activation", BY_HAND)
def test_a_policy_file_in_jax_and_in_numpy(tmp_path, activation):
    """Both back ends compute what is written here by hand, from a file."""
    layer_norm = activation in ("relu", "silu")
    save_controller(tmp_path / "p.safetensors", of_kind(activation, layer_norm), {})
    found, states = read_pendulum_policy(tmp_path / "p.safetensors"), random_states()[:5]
    numpy, network = numpy_controller(found), found.network
    loaded, _ = lone_policy(tmp_path / "p.safetensors", "pendubot")
    with jax.enable_x64(True):
        judge = jax.jit(jax.vmap(lambda x: (loaded.policy.observe(x), 3.0 * loaded.policy(x)[0])))
        features, judged = map(np.asarray, judge(jnp.asarray(states)))
    for layer, norm in zip(network.trunk, network.norms or (None, None), strict=True):
        features = features @ layer.weight.T.astype(float) + layer.bias
        if norm is not None:
            centred = features - features.mean(axis=1, keepdims=True)
            features = centred / np.sqrt(features.var(axis=1, keepdims=True) + 1e-5) * norm.weight + norm.bias
        features = np.vectorize(BY_HAND[activation])(features)
    expected = 3.0 * np.tanh(features @ network.head.weight[0].astype(float) + network.head.bias[0])
    np.testing.assert_allclose([numpy(x, 0.0)[0] for x in states], expected, atol=1e-12)
    np.testing.assert_allclose(judged, expected, atol=1e-12)
    assert np.ptp(expected) > 0.01


@pytest.mark.parametrize(
    ("kind", "named"),
    [
        (("tanh", False), "activation = 'tanh'"),
        (("relu", True), "layer_norm"),
        (("elu", True), "'elu' with layer_"),
    ],
)
@pytest.mark.parametrize(
    ("write", "program"), [(c_header, "a C header"), (onnx_model, "an ONNX graph"), (policy_data, "a page")]
)
def test_programs_of_relu_alone_refuse_by_name(tmp_path, kind, named, write, program):
    save_controller(tmp_path / "p.safetensors", of_kind(*kind), {})
    with pytest.raises(
        SwingupError, match=f"{program} runs hidden layers of ReLU, not .*{named}.*: run the policy"
    ):
        write(read_pendulum_policy(tmp_path / "p.safetensors"))


def test_relu_alone_is_not_said_in_the_file(tmp_path):
    save_controller(tmp_path / "p.safetensors", small_policy(), {"activation": "tanh", "layer_norm": True})
    found = read_pendulum_policy(tmp_path / "p.safetensors")
    assert not {"activation", "layer_norm"} & found.metadata.keys()
    check_plain(found.network, "anything")


def test_a_pendulum_has_no_recurrent_policy(tmp_path):
    controller = small_policy()
    linear = Linear(np.zeros((36, 12), np.float32), np.zeros(36, np.float32))
    actor = dataclasses.replace(controller.policy.actor, gru=GRU(linear, linear))
    policy = Policy(controller.policy.stages, actor)
    save_controller(tmp_path / "p.safetensors", dataclasses.replace(controller, policy=policy), {})
    with pytest.raises(SwingupError, match=r"has a memory \(gru\), which a pendulum's controllers have not"):
        read_pendulum_policy(tmp_path / "p.safetensors")


def test_a_bound_of_the_features():
    # |x| ≤ 1 gives 2·1 + 1 = 3. A norm of three features gives at most 5·√3 + 1, the head 10 times that.
    layer = Layer(np.full((3, 1), 2, np.float32), np.ones(3, np.float32))
    head = Layer(np.full((1, 3), 10 / 3, np.float32), np.zeros(1, np.float32))
    norm = Norm(np.full(3, 5, np.float32), np.ones(3, np.float32))
    network = Network((), (layer,), head, norms=(norm,))
    assert largest_feature(network) == pytest.approx(10 * (5 * 3**0.5 + 1))
    small = Network((), (Layer(layer.weight * 0, layer.bias * 0),), head, activation="elu")
    assert largest_feature(small) == pytest.approx(10.0)


def test_a_layer_normalisation_has_mean_zero_and_deviation_one():
    norm = init_norms((16,), LayerKind("tanh", True))[0]
    x = 3.0 + 5.0 * jax.random.normal(jax.random.key(0), (16, 7))
    apply = jax.jit(lambda norm, x: (norm(x), norm(x[:, 2])))
    y, single = apply(norm, np.asarray(x))
    np.testing.assert_allclose(y.mean(axis=0), 0.0, atol=1e-5)
    np.testing.assert_allclose(y.std(axis=0), 1.0, atol=1e-4)
    # One vector and a batch are the same.
    np.testing.assert_allclose(single, y[:, 2], atol=1e-6)


def test_a_shared_critic_reads_the_actors_features():
    actor = small_policy().policy.actor
    x = jnp.linspace(-1.0, 1.0, 4)
    shared = init_shared_critic(jax.random.key(1), 12)
    found, features = jax.jit(lambda x: (values(actor, shared, x), hidden_features(actor.trunk, (), "relu", x)))(x)
    np.testing.assert_allclose(found, np.asarray(shared.heads.weight) @ features, atol=1e-6)
    assert len(jax.tree.leaves(shared)) == 2


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"activation": "Tanh"},
            "unknown activation 'Tanh': use one of relu, tanh, elu, silu, gelu; did you mean tanh",
        ),
        ({"layer_norm": 1}, "layer_norm = 1: use True or False"),
        ({"shared_trunk": "yes"}, "shared_trunk = 'yes': use True or False"),
        (
            {"normalise_rewards": True, "popart": True},
            "normalise_rewards does not go with popart, which scales as well: choose one",
        ),
    ],
)
def test_what_cannot_work_is_refused(wrong, message):
    with pytest.raises(SwingupError, match=message):
        Config(**wrong)
