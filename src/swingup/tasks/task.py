"""What a learner needs of a task: a pure, unbatched Markov decision process that never resets itself."""

import abc
from typing import Generic, TypeVar

import equinox as eqx

from ..types import Action, Flag, Key, Observation, Scalar

StateT = TypeVar("StateT")


class Step(eqx.Module, Generic[StateT]):
    """Everything that one step of a task yields."""

    state: StateT
    """The state after the step, before any reset."""
    observation: Observation
    """Its observation."""
    reward: Scalar
    """Reward of the step."""
    terminated: Flag
    """The process itself ended here: there is no value beyond. A continuing task never sets it."""
    truncated: Flag
    """The caller should reset, but the process would go on: bootstrap from ``observation``."""


class AbstractTask(eqx.Module, Generic[StateT]):
    """A Markov decision process with actions in [-1, 1]; the caller batches it with ``vmap`` and resets it."""

    @property
    @abc.abstractmethod
    def observation_size(self) -> int:
        """Length of an observation."""

    @property
    @abc.abstractmethod
    def action_size(self) -> int:
        """Length of an action."""

    @abc.abstractmethod
    def reset(self, key: Key) -> StateT:
        """Draw an initial state."""

    @abc.abstractmethod
    def observe(self, state: StateT) -> Observation:
        """What the agent sees of a state."""

    @abc.abstractmethod
    def step(self, state: StateT, action: Action, key: Key) -> Step[StateT]:
        """Advance by one action, each entry in [-1, 1]."""
