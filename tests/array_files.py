"""Policies, checkpoints and trajectories in tests, read and written by safetensors' own package."""

import json

import numpy as np
from safetensors import safe_open
from safetensors.numpy import load_file, save_file


def read_metadata(path):
    with safe_open(path, "np") as file:
        return json.loads(file.metadata()["swingup"])


def write_file(path, metadata, arrays):
    """Write a file; the metadata may be a text in the place of JSON."""
    text = metadata if isinstance(metadata, str) else json.dumps(metadata)
    save_file({name: np.array(array, order="C") for name, array in arrays.items()}, path, {"swingup": text})


def change_file(path, metadata=None, arrays=None):
    """Replace entries of a file's metadata and arrays; those with a new value of None are removed."""
    kept = ({**old, **(new or {})} for old, new in ((read_metadata(path), metadata), (load_file(path), arrays)))
    write_file(path, *({name: value for name, value in each.items() if value is not None} for each in kept))
