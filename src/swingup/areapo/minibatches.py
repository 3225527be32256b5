"""Minibatches of a rollout: frames in a random order, or for a recurrent policy whole rollouts of environments."""

from collections.abc import Callable
from dataclasses import replace

import jax
from jaxtyping import Array, Int

from ..common.types import Key
from .config import Config
from .loss import Frames
from .shuffle import shuffled


def minibatches(
    key: Key, frames: Frames, config: Config
) -> tuple[Int[Array, "minibatches k"], Callable[[Array], Frames]]:
    """The rows of all minibatches of all epochs, and the function that picks their frames.

    The batch size divides the rollout: no minibatch has frames of two epochs.
    """
    if frames.memory is None:
        flat = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), frames)
        orders = shuffled(key, config.num_epochs, config.rollout_size)
        return orders.reshape(-1, config.batch_size), lambda rows: jax.tree.map(lambda leaf: leaf[rows], flat)
    memory, others = frames.memory, replace(frames, memory=None)

    def pick(envs: Int[Array, "k"]) -> Frames:
        return replace(jax.tree.map(lambda leaf: leaf[:, envs], others), memory=memory[envs])

    orders = shuffled(key, config.num_epochs, config.num_envs)
    return orders.reshape(-1, config.batch_size // config.num_steps), pick
