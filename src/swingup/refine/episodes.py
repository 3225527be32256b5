"""The episodes that a policy is refined on: first states drawn at random, new ones for every gradient step.

Throws are drawn by the rules of the global-policy score; none of them is one of the benchmark's own.
"""

from dataclasses import dataclass

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float

from ..loop.supervisors.throws import thrown_states
from ..plant.plant import LEADERBOARD, PlantLike, load_plant
from ..plant.robots import Robot


@dataclass(frozen=True)
class EpisodeSettings:
    """How many episodes of each kind a step has, and the spread of their first states."""

    nominal: int = 4
    """Episodes that start hanging."""
    anywhere: int = 18
    """Episodes that start in any configuration, with random velocities; see ``speed``."""
    thrown: int = 180
    """Episodes that start where the throws of the global-policy score leave the pendulum."""
    speed: float = 8.0
    """Largest standard deviation of the first velocities of ``anywhere`` (rad/s)."""
    spread: float = 0.02
    """Largest standard deviation of the first states of ``nominal`` (rad, rad/s)."""


class EpisodeBatch(eqx.Module):
    """The first states of a batch of episodes on the nominal plant."""

    x0: Float[Array | np.ndarray, "n 4"]
    """rad, rad/s"""
    nominal: Bool[Array | np.ndarray, "n"]
    """Whether the episode starts hanging."""


def sample_episodes(
    random: np.random.Generator, robot: Robot, settings: EpisodeSettings, plant: PlantLike = LEADERBOARD
) -> EpisodeBatch:
    """Draw the episodes of one step, in single precision."""
    nominal, anywhere, thrown = settings.nominal, settings.anywhere, settings.thrown
    hanging = settings.spread * random.uniform(size=(nominal, 1)) * random.normal(size=(nominal, 4))
    rates = settings.speed * random.uniform(size=(anywhere, 1)) * random.normal(size=(anywhere, 2))
    free = np.concatenate([random.uniform(-np.pi, np.pi, (anywhere, 2)), rates], axis=1)
    after = thrown_states(random, load_plant(plant).driven(robot), thrown) if thrown else np.zeros((0, 4))
    x0 = np.concatenate([hanging, free, after]).astype(np.float32)
    # Shuffled: each core takes a slice of the batch, and every slice needs episodes of all kinds.
    order = random.permutation(len(x0))
    # The nominal episodes came first before the shuffle.
    return EpisodeBatch(x0[order], order < nominal)
