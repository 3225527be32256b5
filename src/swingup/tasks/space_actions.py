"""Actions of a JAX environment's action space, made from the policy's."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

from ..common.errors import SwingupError
from ..common.foreign import attribute
from ..common.text import one_line


class SpaceActions(eqx.Module):
    """Scales numbers in [-1, 1] to the bounds of a box, or passes the numbers of choices on."""

    shape: tuple[int, ...] = eqx.field(static=True)
    """Shape of the environment's action."""
    dtype: str = eqx.field(static=True)
    choices: tuple[int, ...] = eqx.field(static=True)
    """Number of alternatives; empty for a box."""
    low: Float[Array, "..."]
    """Lower bounds, in the shape of the action; 0 for choices."""
    high: Float[Array, "..."]

    @property
    def size(self) -> int:
        """Length of the policy's action."""
        return int(np.prod(self.shape))

    def __call__(self, actions: Shaped[Array, "*b m"]) -> Shaped[Array, "..."]:
        """Actions of the environment, with the same leading axes."""
        shaped = actions.reshape(*actions.shape[:-1], *self.shape)
        if self.choices:
            return shaped.astype(self.dtype)
        return (self.low + 0.5 * (shaped + 1.0) * (self.high - self.low)).astype(self.dtype)

    def describe(self) -> dict[str, Any]:
        """The entries of a policy file about the actions, as JSON values."""
        if self.choices:
            return {"action_start": 0}
        return {"action_low": np.asarray(self.low).tolist(), "action_high": np.asarray(self.high).tolist()}


def space_actions(space: Any) -> SpaceActions:
    """The actions of a space of gymnax or envelope, which has either ``n`` or ``low`` and ``high``."""
    shown = f"actions {one_line(space, 100)}"
    number = attribute(space, "n")
    if number is not None:
        counts = np.asarray(number)
        if counts.size == 0 or counts.min() < 1:
            raise SwingupError(f"{shown} are empty: give them a choice")
        dtype, nothing = np.dtype(attribute(space, "dtype", np.int32)), jnp.zeros(())
        return SpaceActions(counts.shape, dtype.name, tuple(map(int, np.ravel(counts))), nothing, nothing)
    if any(attribute(space, name) is None for name in ("low", "high", "shape")):
        raise SwingupError(f"{shown} are not supported: use a Discrete or a bounded Box")
    shape, dtype = tuple(map(int, space.shape)), np.dtype(attribute(space, "dtype", np.float32))
    if 0 in shape:
        raise SwingupError(f"{shown} are empty: give them an entry")
    if not np.issubdtype(dtype, np.floating):
        raise SwingupError(f"{shown} are whole numbers in a Box: make them a Discrete")
    low, high = (np.broadcast_to(np.asarray(bound, np.float32), shape) for bound in (space.low, space.high))
    with np.errstate(over="ignore"):  # bounds whose difference overflows are no bounds either
        bounded = bool(np.isfinite(high - low).all())
    if not bounded:
        raise SwingupError(f"{shown} have no bounds to scale to: give its action_space finite low and high")
    return SpaceActions(shape, dtype.name, (), jnp.asarray(low), jnp.asarray(high))
