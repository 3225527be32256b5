"""The ``state`` and ``episode_start`` of ``AREAPO.predict``, as those of SB3-contrib's RecurrentPPO."""

from typing import Any

import numpy as np

from ..errors import SwingupError
from ..policy.jax_backend.policy import Policy
from ..text import quoted


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
        if np.shape(state) not in ((count, size), *([(size,)] if count == 1 else [])):
            raise SwingupError(f"state has shape {np.shape(state)}: pass what predict returned, {(count, size)}")
        memory = np.asarray(state, np.float32).reshape(count, size)
    if episode_start is None:
        return memory
    starts = np.asarray(episode_start)
    if starts.shape not in ((count,), *([()] if count == 1 else [])) or starts.dtype.kind not in "bif":
        raise SwingupError(f"episode_start = {quoted(episode_start)}: pass a truth value for each of {count}")
    return np.where(starts.reshape(count, 1).astype(bool), np.float32(0.0), memory)
