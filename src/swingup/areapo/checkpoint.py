"""Complete, atomic checkpoints of a training state: arrays named by their path in the pytree, and metadata."""

import math
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
    save_arrays(
        path,
        CHECKPOINT_FORMAT,
        CHECKPOINT_VERSION,
        metadata,
        # NumPy has no type for keys; their words are ordinary numbers.
        {name: np.asarray(jax.random.key_data(leaf) if _is_key(leaf) else leaf) for name, leaf in _named(tree)},
    )


def load_checkpoint(path: str | Path, like: Tree) -> tuple[Tree, dict[str, Any]]:
    """Read a pytree of the structure, shapes and types of ``like`` (arrays or their shapes), and the metadata."""
    needed = dict(_named(like))
    # A configuration may need large arrays; any other file stays below the common bound.
    sizes = [math.prod(kind.shape) * np.dtype(kind.dtype).itemsize for kind in map(_kind, needed.values())]
    most = max(LARGEST_ARRAYS, sum(sizes))
    # Arrays with other names are not read: a foreign file costs no memory.
    metadata, arrays = load_arrays(path, CHECKPOINT_FORMAT, CHECKPOINT_VERSION, needed.__contains__, most)
    leaves = []
    for name, expected in needed.items():
        if name not in arrays:
            raise SwingupError(f"checkpoint {path} lacks {name}: it is of another configuration")
        leaves.append(_from_numpy(path, name, arrays[name], expected))
    return jax.tree.unflatten(jax.tree.structure(like), leaves), metadata


def read_metadata(path: str | Path) -> dict[str, Any]:
    """Read the metadata of a checkpoint alone."""
    return load_arrays(path, CHECKPOINT_FORMAT, CHECKPOINT_VERSION, lambda name: False)[0]


def _named(tree: Any) -> list[tuple[str, Any]]:
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return [(jax.tree_util.keystr(path, simple=True, separator="."), leaf) for path, leaf in leaves]


def _is_key(leaf: Any) -> bool:
    return bool(jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key))


def _kind(expected: Any) -> Any:
    """Shape and type of a leaf as it is stored: a key as its numbers."""
    return jax.eval_shape(jax.random.key_data, expected) if _is_key(expected) else expected


def _from_numpy(path: str | Path, name: str, array: np.ndarray, expected: Any) -> Any:
    kind = _kind(expected)
    # No conversion: a resumed run has the bits of an undisturbed one.
    if array.shape != kind.shape or array.dtype != kind.dtype:
        raise SwingupError(
            f"checkpoint {path} holds {name} as {array.dtype}{list(array.shape)} where the configuration "
            f"needs {kind.dtype}{list(kind.shape)}: it is of another configuration"
        )
    leaf = jnp.asarray(array)
    return jax.random.wrap_key_data(leaf) if _is_key(expected) else leaf
