"""The ``state`` and ``episode_start`` of ``AREAPO.predict``, as those of SB3-contrib's RecurrentPPO."""

from typing import Any

import numpy as np

from ..common.errors import SwingupError
from ..common.text import quoted
from ..controllers.stack.policy import Policy


def memory_before(policy: Policy[Any], state: Any, episode_start: Any, count: int) -> np.ndarray | None:
    """The memory (count, w) before some observations; None for a policy without memory.

    Args:
        policy: which acts.
        state: what the last call returned; None at the start of episodes.
        episode_start: whether each observation is the first of an episode; None where ``state`` says it.
        count: how many observations there are.

    Raises:
        SwingupError: an argument has another shape, or the policy has no memory.
    """
    size = policy.memory_size
    if not size:
        given = {"state": state, "episode_start": episode_start}
        for name in (name for name, value in given.items() if value is not None):
            raise SwingupError(f"{name} is for a policy with a memory: leave it out, or train with gru_width")
        return None
    memory = np.zeros((count, size), np.float32)
    if state is not None:
        given_state = _array(state, np.float32)
        if given_state is None or given_state.shape not in ((count, size), *([(size,)] if count == 1 else [])):
            shape = "no numbers" if given_state is None else f"shape {given_state.shape}"
            raise SwingupError(f"state has {shape}: pass what predict returned, {(count, size)}")
        if not np.isfinite(given_state).all():
            raise SwingupError("state is not finite: pass what predict returned")
        memory = given_state.reshape(count, size)
    if episode_start is None:
        return memory
    starts, shapes = _array(episode_start), ((count,), *([()] if count == 1 else []))
    if starts is None or starts.shape not in shapes or starts.dtype.kind not in "bi":
        raise SwingupError(f"episode_start = {quoted(episode_start)}: pass a truth value for each of {count}")
    return np.where(starts.reshape(count, 1).astype(bool), np.float32(0.0), memory)


def _array(values: Any, dtype: Any = None) -> np.ndarray | None:
    """An array of the values; None if they make none."""
    try:
        return np.asarray(values, dtype)
    except (TypeError, ValueError):
        return None
