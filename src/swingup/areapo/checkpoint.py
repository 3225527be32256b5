"""Complete, atomic checkpoints of a training state: arrays named by their path in the pytree, and metadata."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from ..common.arrays import LARGEST_ARRAYS, load_arrays, save_arrays
from ..common.errors import SwingupError

CHECKPOINT_FORMAT = "swingup checkpoint"
CHECKPOINT_VERSION = 1

Tree = TypeVar("Tree")


def save_checkpoint(path: str | Path, tree: Any, metadata: Mapping[str, Any]) -> None:
    """Write every leaf of a pytree, bit for bit, and the metadata (JSON values)."""
    arrays = {name: np.asarray(leaf) for name, leaf in _stored(tree).items()}
    save_arrays(path, CHECKPOINT_FORMAT, CHECKPOINT_VERSION, metadata, arrays)


def load_checkpoint(path: str | Path, like: Tree) -> tuple[Tree, dict[str, Any]]:
    """Read a pytree of the structure, shapes and types of ``like`` (arrays or their shapes), and the metadata."""
    needed = jax.eval_shape(_stored, like)
    # A configuration may need large arrays; any other file stays below the common bound.
    maximum = max(LARGEST_ARRAYS, sum(each.size * each.dtype.itemsize for each in needed.values()))
    # Arrays with other names are not read: a foreign file costs no memory.
    metadata, arrays = load_arrays(path, CHECKPOINT_FORMAT, CHECKPOINT_VERSION, needed.__contains__, maximum)
    for name, expected in needed.items():
        if name not in arrays:
            raise SwingupError(f"checkpoint {path} lacks {name}: it is of another configuration")
        array = arrays[name]
        # No conversion: a resumed run has the bits of an undisturbed one.
        if (array.shape, array.dtype) != (expected.shape, expected.dtype):
            raise SwingupError(
                f"checkpoint {path} holds {name} as {array.dtype}{list(array.shape)} where the configuration "
                f"needs {expected.dtype}{list(expected.shape)}: it is of another task or configuration"
            )

    def restored(place: Any, leaf: Any) -> jax.Array:
        array = jnp.asarray(arrays[_name(place)])
        return jax.random.wrap_key_data(array) if _is_key(leaf) else array

    return jax.tree_util.tree_map_with_path(restored, like), metadata


def read_metadata(path: str | Path) -> dict[str, Any]:
    """Read the metadata of a checkpoint alone."""
    return load_arrays(path, CHECKPOINT_FORMAT, CHECKPOINT_VERSION, lambda name: False)[0]


def _stored(tree: Any) -> dict[str, Any]:
    """The leaves by their names. NumPy has no type for keys; their words are ordinary numbers."""
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return {_name(place): jax.random.key_data(leaf) if _is_key(leaf) else leaf for place, leaf in leaves}


def _name(place: Any) -> str:
    return jax.tree_util.keystr(place, simple=True, separator=".")


def _is_key(leaf: Any) -> bool:
    return bool(jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key))
