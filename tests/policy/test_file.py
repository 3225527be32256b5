"""Policy files: round trips, a file written by hand after docs/policy-format.md, and what may be wrong."""

import contextlib
import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from array_files import change_file, write_file
from policies import load_any_policy
from swingup.areapo.networks import init_actor
from swingup.common.errors import SwingupError
from swingup.controllers.stack.policy import Policy, network_of, save_policy
from swingup.plant.plant import LEADERBOARD
from swingup.policy.file import read_network, write_network
from swingup.policy.pendulum import read_pendulum_policy, write_pendulum_policy
from swingup.policy.plant_facts import write_plant
from swingup.policy.shipped import load_policy
from swingup.tasks.observation import Normalise, PendulumObservation

STATES = np.random.default_rng(0).uniform(-7, 7, (50, 4))


def make_policy(angles="wrapped", size=4):
    actor = init_actor(jax.random.key(0), size, 1, (16, 16), -1.0)
    actor = jax.tree.map(lambda leaf: leaf + 0.1, actor)
    normalise = Normalise(mean=np.linspace(-1, 1, size), variance=np.linspace(0.5, 2, size), clip=10.0)
    return Policy((PendulumObservation(20.0, angles), normalise), actor)


@pytest.mark.parametrize(("angles", "size"), [("wrapped", 4), ("sincos", 6)])
def test_round_trip(tmp_path, angles, size):
    policy = make_policy(angles, size)
    save_policy(tmp_path / "p.safetensors", policy, {"robot": "acrobot", "frames": 3})
    loaded, metadata = load_any_policy(tmp_path / "p.safetensors")
    assert (metadata["robot"], metadata["frames"]) == ("acrobot", 3)
    for x in STATES[:5]:
        assert loaded(jnp.asarray(x)) == policy(jnp.asarray(x))
    assert loaded.actor(loaded.observe(jnp.asarray(STATES[0]))).log_std.shape == (1,)


def write_by_hand(path, rng, std=False, **metadata):
    """The paper's architecture as another program would write it; returns its arrays."""
    arrays = {
        "network.trunk.0.weight": rng.normal(size=(256, 4)),
        "network.trunk.0.bias": rng.normal(size=256),
        "network.trunk.1.weight": rng.normal(size=(256, 256)) / 16,
        "network.trunk.1.bias": rng.normal(size=256),
        "network.mean.weight": rng.normal(size=(1, 256)) / 16,
        "network.mean.bias": rng.normal(size=1),
    }
    arrays = {name: array.astype(np.float32) for name, array in arrays.items()}
    arrays |= {"observation.1.mean": rng.normal(size=4), "observation.1.variance": rng.uniform(0.1, 1, 4)}
    head = {
        "format": "swingup policy",
        "format_version": 1,
        "robot": "acrobot",
        "torque_limit": 6.0,
        "plant": write_plant(LEADERBOARD.driven("acrobot")),
        "observation": [
            {"name": "pendulum", "angles": "wrapped", "velocity_scale": 20.0},
            {"name": "normalise", "clip": 10.0, "epsilon": 1e-8},
        ],
    }
    write_file(path, head | metadata, arrays)
    return arrays


def numpy_policy(a, x):
    """The paper's deterministic policy, written again with NumPy in float64."""
    q, rates = x[:2], x[2:]
    observation = np.concatenate([(np.mod(q, 2 * np.pi) - np.pi) / np.pi, np.clip(rates, -20, 20) / 20])
    scaled = (observation - a["observation.1.mean"]) / np.sqrt(a["observation.1.variance"] + 1e-8)
    features = np.clip(scaled, -10, 10)
    for layer in ("trunk.0", "trunk.1"):
        features = np.maximum(a[f"network.{layer}.weight"] @ features + a[f"network.{layer}.bias"], 0.0)
    return np.tanh(a["network.mean.weight"] @ features + a["network.mean.bias"])


def test_a_file_written_by_hand(tmp_path):
    arrays = write_by_hand(tmp_path / "p.safetensors", np.random.default_rng(1))
    policy, _ = load_any_policy(tmp_path / "p.safetensors")
    expected = [numpy_policy(arrays, x) for x in STATES]
    double = jax.tree.map(lambda leaf: np.asarray(leaf, np.float64), policy.actor)
    with jax.enable_x64(True):
        exact = jax.vmap(Policy(policy.stages, double))(jnp.asarray(STATES))
        actions = jax.vmap(policy)(jnp.asarray(STATES))
    np.testing.assert_allclose(exact, expected, atol=1e-13)
    np.testing.assert_allclose(actions, expected, atol=2.5e-6)  # 1.5e-5 N m of 6: the judge's single precision
    assert np.ptp(actions) > 0.1


def test_without_a_deviation_there_is_no_distribution(tmp_path):
    write_by_hand(tmp_path / "p.safetensors", np.random.default_rng(1))
    policy, _ = load_any_policy(tmp_path / "p.safetensors")
    with pytest.raises(SwingupError, match="no standard deviation"):
        policy.actor(jnp.zeros(4))


STAGES = [{"name": "pendulum"}, {"name": "normalise"}]


@pytest.mark.parametrize(
    ("metadata", "arrays", "message"),
    [
        ({"format": "swingup checkpoint"}, {}, "a 'swingup checkpoint' file"),
        ({"activation": "step"}, {}, "unknown activation 'step': use one of relu, tanh"),
        ({"format_version": 2}, {}, "format version 2, this program reads 1"),
        ({"format_version": True}, {}, "format version True, this program reads 1"),
        ({"observation": [{"name": "kalman"}, *STAGES]}, {}, "unknown observation stage 'kalman'"),
        (
            {"observation": [{"name": "pendulum", "angles": "polar"}, STAGES[1]]},
            {},
            "unknown angle encoding 'polar'",
        ),
        ({"observation": [{"name": "pendulum", "speed": 3}, STAGES[1]]}, {}, "speed"),
        ({"observation": [{"name": "pendulum", "angles": "sincos"}]}, {}, "a layer of 4 inputs is fed 6 values"),
        (
            {"observation": [{"name": "pendulum", "velocity_scale": 0}, STAGES[1]]},
            {},
            "velocity_scale = 0: use a number from 1e-06",
        ),
        (
            {"observation": [STAGES[0], {"name": "normalise", "clip": "10"}]},
            {},
            "clip = '10': use a number from 1e-06",
        ),
        ({}, {"observation.1.mean": np.zeros(3)}, r"shapes \(3,\) and \(4,\), the observation \(4,\)"),
        ({}, {"observation.1.variance": -np.ones(4)}, "a variance is negative"),
        (
            {},
            {"observation.1.mean": np.zeros(4, np.int32)},
            "observation.1.mean holds values that are not finite floating",
        ),
        ({}, {"network.mean.bias": None}, "network.mean.bias"),
        (
            {},
            {"network.trunk.1.weight": np.zeros((256, 100), np.float32)},
            "a layer of 100 inputs is fed 256 values",
        ),
        ({}, {"network.trunk.0.bias": np.zeros(3, np.float32)}, r"bias \(3,\)"),
        ({}, {"network.mean.bias": np.array([np.nan], np.float32)}, "not finite"),
    ],
)
def test_bad_files(tmp_path, metadata, arrays, message):
    path = tmp_path / "p.safetensors"
    write_by_hand(path, np.random.default_rng(1), **metadata)
    change_file(path, arrays=arrays)
    with pytest.raises(SwingupError, match=message):
        load_any_policy(path)


@pytest.mark.parametrize("content", [b"", b"hello", b"PK\x03\x04 not really a zip", b"\x93NUMPY"])
def test_foreign_files(tmp_path, content):
    (tmp_path / "p.safetensors").write_bytes(content)
    with pytest.raises(SwingupError, match="truncated"):
        load_any_policy(tmp_path / "p.safetensors")


@pytest.mark.parametrize("foreign", [{}, {"observation": [{"name": "plant"}], "choices": [3]}])
def test_metadata_of_another_network_does_not_change_this_one(tmp_path, foreign):
    network = network_of(make_policy())
    write_network(tmp_path / "p.safetensors", network, {"format": "x", "robot": "acrobot"} | foreign)
    found, metadata = read_network(tmp_path / "p.safetensors")
    assert [type(stage) for stage in found.stages] == [type(stage) for stage in network.stages]
    assert (found.choices, metadata["robot"]) == (None, "acrobot")


def test_a_folded_policy_is_written_with_its_own_metadata(tmp_path):
    """The network of ``adaptive`` for one plant, with the shipped file's metadata as provenance."""
    policy = load_policy("adaptive", "acrobot")
    folded = dataclasses.replace(policy, network=policy.folded)
    write_pendulum_policy(tmp_path / "p.safetensors", folded, policy.metadata)
    found = read_pendulum_policy(tmp_path / "p.safetensors")
    assert len(found.network.stages) == len(policy.folded.stages) < len(policy.network.stages)
    assert found.metadata["command"] == policy.metadata["command"]


@pytest.mark.parametrize("seed", range(20))
def test_damaged_bytes_never_give_a_traceback(tmp_path, seed):
    rng = np.random.default_rng(seed)
    save_policy(tmp_path / "q.safetensors", make_policy(), {})
    content = bytearray((tmp_path / "q.safetensors").read_bytes())
    for _ in range(30):
        damaged = content.copy()
        start = int(rng.integers(len(damaged)))
        damaged[start : start + 20] = rng.bytes(len(damaged[start : start + 20]))
        (tmp_path / "q.safetensors").write_bytes(damaged)
        with contextlib.suppress(SwingupError):
            load_any_policy(tmp_path / "q.safetensors")
