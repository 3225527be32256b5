"""Actions of an environment's action space, made from the policy's; for Gymnasium, gymnax and envelope alike."""

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float, Shaped

from ..common.errors import SwingupError, attribute, one_line


class SpaceActions(eqx.Module):
    """Scales numbers in [-1, 1] to the bounds of a box, or counts choices from the first; in NumPy and in JAX."""

    shape: tuple[int, ...] = eqx.field(static=True)
    """Shape of the environment's action."""
    dtype: str = eqx.field(static=True)
    choices: tuple[int, ...] = eqx.field(static=True)
    """Number of alternatives; empty for a box."""
    low: Float[np.ndarray, "..."]
    """Lower bounds, in the shape of the action; of choices, the number of the first."""
    high: Float[np.ndarray, "..."]

    @property
    def size(self) -> int:
        """Length of the policy's action."""
        return int(np.prod(self.shape))

    def __call__(self, actions: Shaped[Any, "*b m"]) -> Shaped[Any, "..."]:
        """Actions of the environment, with the same leading axes."""
        shaped = actions.reshape(*actions.shape[:-1], *self.shape)
        if self.choices:
            return (shaped + self.low).astype(self.dtype)
        return (self.low + 0.5 * (shaped + 1.0) * (self.high - self.low)).astype(self.dtype)

    def describe(self) -> dict[str, Any]:
        """The entries of a policy file about the actions, as JSON values."""
        low, high = np.asarray(self.low).tolist(), np.asarray(self.high).tolist()
        return {"action_start": low} if self.choices else {"action_low": low, "action_high": high}


def space_actions(space: Any) -> SpaceActions:
    """The actions of a space that has ``n`` or ``nvec``, or ``low`` and ``high``."""
    shown = f"actions {one_line(space, 200)}"
    counts = attribute(space, "n", attribute(space, "nvec"))
    if counts is not None:
        counts, kind = np.asarray(counts), np.dtype(attribute(space, "dtype", np.int32))
        if counts.size == 0 or counts.min() < 1:
            raise SwingupError(f"{shown} are empty: give them a choice")
        # Gymnasium's discrete spaces may count from another number than 0.
        start = np.broadcast_to(np.asarray(attribute(space, "start", 0)), counts.shape)
        return SpaceActions(counts.shape, kind.name, tuple(map(int, counts.ravel())), start, start)
    if any(attribute(space, name) is None for name in ("low", "high", "shape")):
        raise SwingupError(f"{shown} are not supported: use a bounded Box, Discrete or MultiDiscrete")
    shape, kind = tuple(map(int, space.shape)), np.dtype(attribute(space, "dtype", np.float32))
    if 0 in shape:
        raise SwingupError(f"{shown} are empty: give them an entry")
    if not np.issubdtype(kind, np.floating):
        raise SwingupError(f"{shown} are whole numbers in a Box: make them discrete")
    low, high = (np.broadcast_to(np.asarray(bound, kind), shape) for bound in (space.low, space.high))
    with np.errstate(over="ignore"):  # bounds whose difference overflows are not bounds either
        bounded = bool(np.isfinite(np.float32(high) - np.float32(low)).all())
    if not bounded:
        raise SwingupError(f"{shown} have no bounds to scale to: give the space finite low and high")
    return SpaceActions(shape, kind.name, (), low, high)
