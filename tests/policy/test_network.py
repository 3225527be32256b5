"""A policy's network: what it sees of state and plant, folded and told anew, and its layers in all forms."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from policies import lone_policy
from swingup.areapo.networks import Actor
from swingup.controllers.stack.policy import Policy, policy_of, save_controller
from swingup.plant.base_parameters import base_parameters
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD
from swingup.policy.network import Layer, Network, PlantStage, fold, max_feature
from swingup.policy.numpy_backend import TorqueNetwork, numpy_controller
from swingup.policy.pendulum import policy_plant, read_pendulum_policy
from swingup.tasks.task import PendulumStage

from .references import in_double, random_layer, random_states, sighted_policy, small_policy

PI = np.pi


@pytest.mark.parametrize(
    ("angles", "x", "expected"),
    [
        # [(q1 mod 2π - π)/π, (q2 mod 2π - π)/π, dq1/20, dq2/20], velocities clipped to ±20 rad/s.
        ("wrapped", (0, 0, 0, 0), (-1, -1, 0, 0)),  # hanging: 0 - π
        # [sin q1, cos q1, sin q2, cos q2, dq1/20, dq2/20]
        ("sincos", (0, 0, 0, 0), (0, 1, 0, 1, 0, 0)),
        ("sincos", (PI, 0, 0, 0), (0, -1, 0, 1, 0, 0)),
        ("sincos", (PI / 6, -PI / 2, 5, -30), (0.5, 0.75**0.5, -1, 0, 0.25, -1)),
        ("sincos", (PI / 6 - 4 * PI, 2.5 * PI, 30, 20), (0.5, 0.75**0.5, 1, 0, 1, 1)),
    ],
)
def test_observation_by_hand(angles, x, expected):
    observed = PendulumStage(angles=angles)(jnp.array(x, jnp.float32))
    np.testing.assert_allclose(observed, expected, atol=2e-6)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize(("angles", "size"), [("wrapped", 4), ("sincos", 6)])
def test_every_entry_lies_in_the_unit_interval_and_has_the_dtype_of_the_state(x64, angles, size, dtype):
    # Among them angles so close below a whole turn that their remainder rounds to 2π.
    edges = [0, -1e-30, -1e-9, 2 * PI, -2 * PI, 1e6]
    seen = np.concatenate([edges, np.random.default_rng(0).uniform(-50, 50, 1000)])
    observe = PendulumStage(angles=angles)
    x = jnp.array(np.stack([seen, seen, 10 * seen, -10 * seen], axis=1), dtype)
    observed = jax.vmap(observe)(x)
    assert (observed.shape, observed.dtype) == ((len(seen), observe.size()), dtype)
    assert observe.size() == size
    assert np.abs(observed).max() <= 1.0


def outputs(network, seen):
    """Heads of a network, in double precision."""
    for weight, bias in ((each.weight, each.bias) for each in network.trunk):
        seen = np.maximum(weight.astype(float) @ seen + bias, 0)
    heads = [network.head, *([] if network.std is None else [network.std])]
    return np.array([each.weight.astype(float) @ seen + each.bias for each in heads])


@pytest.mark.parametrize("depth", [0, 1])
def test_a_folded_network_gives_the_same(depth):
    trunk = (random_layer(7, 15, 1),) * depth
    size = 7 if depth else 15
    state, plant = PendulumStage("sincos"), PlantStage(np.linspace(-1, 1, 9), np.linspace(1, 2, 9), clip=2.0)
    network = Network((state, plant), trunk, random_layer(1, size, 2), random_layer(1, size, 3))
    base, seen = np.arange(9.0), np.linspace(-1, 1, 6)
    # By hand: (0 + 1)/1 = 1, and (1 + 0.75)/1.125 = 1.56; then (2 + 0.5)/1.25 = 2, and all others are clipped to 2.
    inputs = np.array([1, 1.75 / 1.125, 2, 2, 2, 2, 2, 2, 2])
    folded = fold(network, base)
    assert folded.stages == (state,)
    found, expected = outputs(folded, seen), outputs(network, np.concatenate([seen, inputs]))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


def test_told_plants_are_those_of_files():
    """A batch of plants, traced, and NumPy's network told one, are the networks of files with that plant."""
    policy, states = policy_of(sighted_policy()), random_states()[:20]
    plants = [policy_plant(each, policy.robot) for each in (LEADERBOARD, load_plant("C.1"))]
    with jax.enable_x64(True):
        controller = in_double(sighted_policy())
        batch = jax.tree.map(lambda *each: jnp.array(each), *plants)
        bases = jax.jit(jax.vmap(lambda plant: base_parameters(plant, jnp)))(batch)
        each_state = jax.vmap(lambda x, base: controller.control(None, jnp.zeros(()), x, base)[1][1], (0, None))
        found = np.asarray(jax.jit(jax.vmap(each_state, (None, 0)))(jnp.asarray(states), bases))
    told = TorqueNetwork(policy)
    for row, plant in zip(found, plants, strict=True):
        network = TorqueNetwork(dataclasses.replace(policy, plant=plant))
        expected = [network(x) for x in states]
        np.testing.assert_allclose(row, expected, rtol=0, atol=1e-11)
        told.set_plant(base_parameters(plant).tolist())
        np.testing.assert_allclose([told(x) for x in states], expected, rtol=0, atol=1e-13)
    assert np.abs(found[0] - found[1]).max() > 0.01


BY_HAND = {
    "relu": lambda x: max(x, 0.0),
    "tanh": math.tanh,
    "elu": lambda x: x if x > 0 else math.exp(x) - 1,
    "silu": lambda x: x / (1 + math.exp(-x)),
    "gelu": lambda x: x / 2 * (1 + math.tanh(math.sqrt(2 / math.pi) * (x + 0.044715 * x**3))),
}


def of_kind(activation, bounds="tanh"):
    """The small controller with another activation and other bounds."""
    controller = small_policy()
    actor = controller.policy.actor
    actor = Actor(actor.trunk, activation, actor.mean_head, actor.std_head, bounds)
    return dataclasses.replace(controller, policy=Policy(controller.policy.stages, actor))


@pytest.mark.parametrize(("activation", "bounds"), [*((name, "tanh") for name in BY_HAND), ("tanh", "clip")])
def test_a_policy_file_in_jax_and_in_numpy(tmp_path, activation, bounds):
    save_controller(tmp_path / "p.safetensors", of_kind(activation, bounds), {})
    found, states = read_pendulum_policy(tmp_path / "p.safetensors"), random_states()[:5]
    numpy, network = numpy_controller(found), found.network
    loaded, _ = lone_policy(tmp_path / "p.safetensors", "pendubot")
    assert loaded.policy.actor(jnp.zeros(4)).log_std.shape == (1,)
    with jax.enable_x64(True):
        judge = jax.jit(jax.vmap(lambda x: (loaded.policy.observe(x), 3.0 * loaded.policy(x)[0])))
        features, judged = map(np.asarray, judge(jnp.asarray(states)))
    for layer in network.trunk:
        features = features @ layer.weight.T.astype(float) + layer.bias
        features = np.vectorize(BY_HAND[activation])(features)
    means = features @ network.head.weight[0].astype(float) + network.head.bias[0]
    expected = 3.0 * (np.tanh(means) if bounds == "tanh" else np.clip(means, -1.0, 1.0))
    np.testing.assert_allclose([numpy(x, 0.0)[0] for x in states], expected, atol=1e-12)
    np.testing.assert_allclose(judged, expected, atol=1e-12)
    assert np.ptp(expected) > 0.01


def test_a_bound_of_the_features():
    # |x| ≤ 1 gives 2·1 + 1 = 3, the head 10 times that.
    layer = Layer(np.full((3, 1), 2, np.float32), np.ones(3, np.float32))
    head = Layer(np.full((1, 3), 10 / 3, np.float32), np.zeros(1, np.float32))
    assert max_feature(Network((), (layer,), head)) == pytest.approx(30.0)
    small = Network((), (Layer(layer.weight * 0, layer.bias * 0),), head, activation="elu")
    assert max_feature(small) == pytest.approx(10.0)
