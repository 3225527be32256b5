"""Named types of JAX's arrays: the field's symbols, with their order and units, declared once; and ``fetch``."""

from typing import Any, TypeAlias

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

State: TypeAlias = Float[Array, "4"]
"""x = [q1, q2, dq1, dq2]: shoulder from hanging down, elbow relative to link 1 (rad); rates (rad/s)."""

Torque: TypeAlias = Float[Array, "2"]  # u = [u1, u2]: shoulder and elbow torque (N m)

Scalar: TypeAlias = Float[Array, ""]  # One real number

Count: TypeAlias = Int[Array, ""]  # One whole number

Flag: TypeAlias = Bool[Array, ""]  # One truth value

Observation: TypeAlias = Float[Array, "n"]  # What a policy sees, before or after normalisation

Action: TypeAlias = Float[Array, "m"]  # What a policy does: each entry in [-1, 1]

Key: TypeAlias = PRNGKeyArray  # A JAX random key: split once into named keys, each used once


def fetch(tree: Any) -> Any:
    """A compiled call's results with NumPy arrays in place of JAX's; on a CPU they share memory and are read-only.

    For a few small arrays on a CPU ``jax.device_get`` takes 0.2 ms more, as long as a step of an environment. From
    a GPU it fetches all at once.
    """
    return jax.tree.map(np.asarray, tree) if jax.default_backend() == "cpu" else jax.device_get(tree)
