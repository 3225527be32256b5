"""Policy files: round trips, a file written by hand after docs/policy-format.md, and what may be wrong."""

import contextlib
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo.networks import init_actor
from swingup.errors import SwingupError
from swingup.policy.jax_backend.observation import Normalise, PendulumObservation
from swingup.policy.jax_backend.policy import Policy, load_any_policy, save_policy

STATES = np.random.default_rng(0).uniform(-7, 7, (50, 4))


def make_policy(angles="wrapped", size=4):
    actor = init_actor(jax.random.key(0), size, 1, (16, 16), -1.0)
    actor = jax.tree.map(lambda leaf: leaf + 0.1, actor)
    normalise = Normalise(mean=np.linspace(-1, 1, size), variance=np.linspace(0.5, 2, size), clip=10.0)
    return Policy((PendulumObservation(20.0, angles), normalise), actor)


@pytest.mark.parametrize(("angles", "size"), [("wrapped", 4), ("sincos", 6)])
def test_round_trip(tmp_path, angles, size):
    policy = make_policy(angles, size)
    save_policy(tmp_path / "p.npz", policy, {"robot": "acrobot", "frames": 3})
    loaded, metadata = load_any_policy(tmp_path / "p.npz")
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
        "observation": [
            {"name": "pendulum", "angles": "wrapped", "velocity_scale": 20.0},
            {"name": "normalise", "clip": 10.0, "epsilon": 1e-8},
        ],
    }
    text = json.dumps(head | metadata)
    np.savez(path, metadata=np.frombuffer(text.encode(), np.uint8), **arrays)
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
    arrays = write_by_hand(tmp_path / "p.npz", np.random.default_rng(1))
    policy, _ = load_any_policy(tmp_path / "p.npz")
    expected = [numpy_policy(arrays, x) for x in STATES]
    double = jax.tree.map(lambda leaf: np.asarray(leaf, np.float64), policy.actor)
    with jax.enable_x64(True):
        exact = jax.vmap(Policy(policy.stages, double))(jnp.asarray(STATES))
        actions = jax.vmap(policy)(jnp.asarray(STATES))
    np.testing.assert_allclose(exact, expected, atol=1e-13)
    np.testing.assert_allclose(actions, expected, atol=2.5e-6)  # 1.5e-5 N m of 6: the judge's single precision
    assert np.ptp(actions) > 0.1


def test_without_a_deviation_there_is_no_distribution(tmp_path):
    write_by_hand(tmp_path / "p.npz", np.random.default_rng(1))
    policy, _ = load_any_policy(tmp_path / "p.npz")
    with pytest.raises(SwingupError, match="no standard deviation"):
        policy.actor(jnp.zeros(4))


def change(path, **changes):
    """Replace (or, with None, remove) arrays of a file."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    arrays = {name: array for name, array in (arrays | changes).items() if array is not None}
    np.savez(path, **arrays)


STAGES = [{"name": "pendulum"}, {"name": "normalise"}]


@pytest.mark.parametrize(
    ("metadata", "arrays", "message"),
    [
        ({"format": "swingup checkpoint"}, {}, "a 'swingup checkpoint' file"),
        ({"activation": "tanh"}, {}, "a file with an activation must have format version 3"),
        ({"format_version": 3, "activation": "step"}, {}, "unknown activation 'step': use one of relu, tanh"),
        ({"format_version": 3, "gru": True}, {}, "array network.gru.inputs.weight is missing"),
        (
            {"format_version": 3, "gru": True},
            {
                f"network.gru.{part}.{name}": np.zeros(shape, np.float32)
                for part, rows in (("inputs", 256), ("hidden", 7))
                for name, shape in (("weight", (24, rows)), ("bias", 24))
            },
            r"a GRU of 7 after 256 values has weights \(24, 256\) and \(24, 7\)",
        ),
        ({"format_version": 3, "layer_norm": 1}, {}, "layer_norm = 1: use true or false"),
        ({"format_version": 3, "layer_norm": True}, {}, "array network.norm.0.weight is missing"),
        (
            {"format_version": 3, "layer_norm": True},
            {f"network.norm.{i}.{part}": np.ones(3, np.float32) for i in (0, 1) for part in ("weight", "bias")},
            r"a norm has shapes \(3,\) and \(3,\), its layer \(256,\)",
        ),
        ({"format_version": 5}, {}, "format version 5, this program reads 1, 2, 3 and 4"),
        ({"identifier": {}}, {}, "a file with an identifier must have format version 4"),
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
        ({}, {"observation.1.mean": np.array(["a"] * 4)}, "not a swingup policy file"),
        ({}, {"network.mean.bias": None}, "network.mean.bias"),
        (
            {},
            {"network.trunk.1.weight": np.zeros((256, 100), np.float32)},
            "a layer of 100 inputs is fed 256 values",
        ),
        ({}, {"network.trunk.0.bias": np.zeros(3, np.float32)}, r"bias \(3,\)"),
        ({}, {"network.mean.bias": np.array([np.nan], np.float32)}, "not finite"),
        ({}, {"metadata": None}, "lacks swingup's metadata"),
        ({}, {"metadata": np.frombuffer(b"{", np.uint8)}, "lacks swingup's metadata"),
    ],
)
def test_bad_files(tmp_path, metadata, arrays, message):
    path = tmp_path / "p.npz"
    write_by_hand(path, np.random.default_rng(1), **metadata)
    change(path, **arrays)
    with pytest.raises(SwingupError, match=message):
        load_any_policy(path)


@pytest.mark.parametrize("content", [b"", b"hello", b"PK\x03\x04 not really a zip", b"\x93NUMPY"])
def test_foreign_files(tmp_path, content):
    (tmp_path / "p.npz").write_bytes(content)
    with pytest.raises(SwingupError, match="truncated"):
        load_any_policy(tmp_path / "p.npz")


def test_pickles_are_refused(tmp_path):
    np.savez(tmp_path / "p.npz", metadata=np.array([{"a": 1}], dtype=object))
    with pytest.raises(SwingupError, match="not a swingup policy file"):
        load_any_policy(tmp_path / "p.npz")


@pytest.mark.parametrize("seed", range(20))
def test_damaged_bytes_never_give_a_traceback(tmp_path, seed):
    rng = np.random.default_rng(seed)
    save_policy(tmp_path / "q.npz", make_policy(), {})
    content = bytearray((tmp_path / "q.npz").read_bytes())
    for _ in range(30):
        damaged = content.copy()
        start = int(rng.integers(len(damaged)))
        damaged[start : start + 20] = rng.bytes(len(damaged[start : start + 20]))
        (tmp_path / "q.npz").write_bytes(damaged)
        with contextlib.suppress(SwingupError):
            load_any_policy(tmp_path / "q.npz")
