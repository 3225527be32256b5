"""Where a run trains: what steps its environments; an evaluator scores the policies."""

import abc
from typing import Any

import jax
import numpy as np
from jaxtyping import Float, Shaped

from ..areapo.config import Config
from ..areapo.state import LearnerState, Metrics
from ..errors import SwingupError
from ..policy.jax_backend.observation import AbstractStage
from ..policy.jax_backend.policy import Policy
from .evaluators import AbstractEvaluator


class AbstractBackend(abc.ABC):
    """A task to train on, compiled or stepped by the host."""

    evaluator: AbstractEvaluator
    """What scores and saves the policies."""

    @abc.abstractmethod
    def init(self) -> LearnerState:
        """The state before the first iteration; of several seeds, with a leading axis."""

    @abc.abstractmethod
    def compile(self, state: LearnerState) -> None:
        """Compile what training calls, from the shapes of a state."""

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
    def find_fault(self) -> str:
        """After training diverged: what is wrong with the environment, and the remedy; empty if nothing is."""

    @abc.abstractmethod
    def to_actions(self, actions: Shaped[np.ndarray, "b m"]) -> Shaped[np.ndarray, "b ..."]:
        """Actions of the environment for actions of the policy."""

    @abc.abstractmethod
    def close(self) -> None:
        """Free the environments."""


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
    try:
        values = np.asarray(observation, np.float32)
    except (TypeError, ValueError) as error:
        raise SwingupError(f"observation is no array of numbers: pass one of shape {shape}") from error
    if values.shape != shape and values.shape[1:] != shape:
        raise SwingupError(
            f"observation has shape {values.shape}: pass {shape}, or one axis more in front for several"
        )
    single = values.shape == shape
    return values.reshape(1 if single else len(values), -1), single
