"""An estimate of a training's memory, before anything is allocated: absurd sizes end in one line."""

import itertools
import os

import jax

from ..areapo.config import Config
from ..common.errors import SwingupError
from ..tasks.task import Spaces

FLOAT = 4
"""Bytes of a number in single precision."""
COPIES = 8
"""Copies of the weights: weights and Adam's two moments before and after an iteration, gradients, update."""
FRAME_NUMBERS = 24
"""Numbers of a frame besides observations, actions and hidden units: values, advantages, shuffled indices."""
GIB = 2**30


def check_memory(config: Config, spaces: Spaces, seeds: int = 1) -> None:
    """Refuse sizes for which this machine has no memory."""
    available = available_bytes()
    weights, rollouts = (seeds * each for each in training_bytes(config, spaces))
    if available is not None and weights + rollouts > available:
        raise SwingupError(
            f"this training needs about {_gib(weights + rollouts)} GiB (networks and optimiser {_gib(weights)}, "
            f"rollouts {_gib(rollouts)}), and there are {_gib(available)} GiB: reduce policy_layers, value_layers, "
            f"num_envs, num_steps or seeds"
        )


def training_bytes(config: Config, spaces: Spaces) -> tuple[int, int]:
    """Least memory of one seed for its networks with their optimiser, and for its rollouts (bytes)."""
    # Of a continuous action: mean and standard deviation.
    outputs = sum(spaces.choices) or 2 * spaces.action_size
    weights = _layers(spaces.observation_size, config.policy_layers, outputs)
    weights += _layers(spaces.observation_size, config.value_layers, 2)
    # The critic is evaluated on a whole rollout at once: its widest layer counts with its input.
    frame = 2 * spaces.observation_size + spaces.action_size + 2 * max(config.value_layers) + FRAME_NUMBERS
    # Random bits and the order that sorts them, for each epoch.
    frame += 2 * config.num_epochs
    return COPIES * FLOAT * weights, FLOAT * frame * config.rollout_size


def available_bytes() -> int | None:
    """Memory of the accelerators together, else of the machine (bytes); None if neither is known."""
    limits = [(device.memory_stats() or {}).get("bytes_limit") for device in jax.local_devices()]
    # A CPU device reports no limit.
    if limits and all(limits):
        return sum(int(limit) for limit in limits if limit)
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # Windows has no sysconf
        return None


def _layers(inputs: int, widths: tuple[int, ...], outputs: int) -> int:
    """Weights and biases of a network."""
    return sum((one + 1) * other for one, other in itertools.pairwise((inputs, *widths, outputs)))


def _gib(count: int) -> str:
    return f"{count / GIB:,.1f}" if count < 1000 * GIB else f"{count // GIB:,}"
