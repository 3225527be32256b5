import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from refusals import refusal
from swingup.areapo import checkpoint
from swingup.areapo.checkpoint import load_checkpoint, read_metadata, save_checkpoint

TREE = {
    "weights": jnp.array([1.0, jnp.pi, 1e-38]),
    "nested": (jnp.arange(3), jnp.array(True)),
    "key": jax.random.key(7),
    "keys": jax.random.split(jax.random.key(8), 2),
}
LIKE = jax.eval_shape(lambda: TREE)


@pytest.fixture
def path(tmp_path):
    save_checkpoint(tmp_path / "c.safetensors", TREE, {"frames": 12, "best": [0.1]})
    return tmp_path / "c.safetensors"


def test_round_trip_is_exact(path):
    tree, metadata = load_checkpoint(path, LIKE)
    assert eqx.tree_equal(tree, TREE)
    assert (metadata["frames"], metadata["best"]) == (12, [0.1])
    # The keys draw what they drew.
    np.testing.assert_array_equal(jax.random.normal(tree["key"], (3,)), jax.random.normal(TREE["key"], (3,)))


def test_other_configurations_are_refused(path):
    for changes, named in (
        ({"weights": jnp.zeros(4)}, "weights as float32[3]"), ({"weights": jnp.zeros(3, jnp.int32)}, "needs int32"),
        ({"extra": jnp.zeros(1)}, "lacks extra"),
    ):  # fmt: skip
        assert named in refusal(load_checkpoint, path, TREE | changes)


def test_a_large_configuration_is_read_and_a_large_foreign_array_is_not(path, monkeypatch):
    # The bound of files is 2 kB here: the tree of 17 kB is more than that, and what it needs.
    monkeypatch.setattr(checkpoint, "LARGEST_ARRAYS", 2000)
    large = {"weights": jnp.zeros(4096)}
    save_checkpoint(path, large, {})
    assert eqx.tree_equal(load_checkpoint(path, jax.eval_shape(lambda: large))[0], large)
    small = {"weights": jax.ShapeDtypeStruct((3,), jnp.float32)}
    assert "MB of arrays, where a swingup checkpoint file may have" in refusal(load_checkpoint, path, small)
    # Names that the configuration does not have are not even looked at.
    assert load_checkpoint(path, {})[0] == {}
    assert read_metadata(path)["format"] == "swingup checkpoint"
