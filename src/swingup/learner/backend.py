"""Where a run trains: what steps its environments, and how its policies are judged."""

import abc
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float, Shaped

from ..areapo.config import Config
from ..areapo.state import LearnerState, Metrics
from ..errors import SwingupError
from ..policy.jax_backend.observation import AbstractStage
from ..policy.jax_backend.policy import Policy


class AbstractBackend(abc.ABC):
    """A task to train on, compiled or stepped by the host."""

    measure: str
    """Name under which policy files keep their scores."""

    @abc.abstractmethod
    def init(self) -> LearnerState:
        """The state before the first iteration; of several seeds, with a leading axis."""

    @abc.abstractmethod
    def begin(self, state: LearnerState, iterations: int) -> LearnerState:
        """Make ready to go on from a checkpoint after so many iterations.

        What a checkpoint does not hold starts anew, in a way that follows from the seed and the iterations alone.
        """

    @abc.abstractmethod
    def train(self, state: LearnerState, iterations: int) -> tuple[LearnerState, Metrics, dict[str, Any]]:
        """Run some iterations: the metrics' means (several seeds: with a leading axis), and what else to report."""

    @abc.abstractmethod
    def policy(self, member: LearnerState) -> Policy[Any]:
        """The policy of one seed."""

    @abc.abstractmethod
    def evaluate(self, policy: Policy[Any], episodes: int | None = None) -> dict[str, Any]:
        """Judge the deterministic policy; among the results is ``score``, the higher the better."""

    @abc.abstractmethod
    def save(self, path: Path, policy: Policy[Any], provenance: Mapping[str, Any]) -> None:
        """Write a policy file."""

    @abc.abstractmethod
    def flatten(self, observation: Any) -> tuple[Float[np.ndarray, "b n"], bool]:
        """What the policy takes, a batch, of one observation or several; and whether it was one.

        Raises:
            SwingupError: the observation has another shape.
        """

    @abc.abstractmethod
    def to_actions(self, actions: Shaped[np.ndarray, "b m"]) -> Shaped[np.ndarray, "b ..."]:
        """What the environment takes, of the policy's actions."""

    @abc.abstractmethod
    def close(self) -> None:
        """Free what the world holds."""


def portable_policy(stages: tuple[AbstractStage, ...], state: LearnerState, config: Config) -> Policy[Any]:
    """A policy of NumPy arrays: the stages, the normalisation as it stands, the actor.

    Policies observe in double precision where that is on, whatever they were trained in.
    """
    everything = (*stages, state.statistics.stage(config.observation_clip))
    everything = jax.tree.map(lambda leaf: np.asarray(leaf, np.float64), everything)
    return Policy(everything, jax.tree.map(np.asarray, state.actor))


def batched(observation: Any, shape: tuple[int, ...]) -> tuple[Float[np.ndarray, "b n"], bool]:
    """One observation of a shape, or several along a leading axis, as a batch of vectors; and whether it was one.

    Raises:
        SwingupError: the observation has another shape.
    """
    values = np.asarray(observation, np.float32)
    if values.shape != shape and values.shape[1:] != shape:
        raise SwingupError(
            f"observation has shape {values.shape}: pass {shape}, or one axis more in front for several"
        )
    single = values.shape == shape
    return values.reshape(1 if single else len(values), -1), single
