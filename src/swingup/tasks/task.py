"""The interface of a task: a pure, unbatched Markov decision process that never resets itself."""

import abc
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from ..common.types import Action, Flag, Key, Observation, Scalar

StateT = TypeVar("StateT")


@dataclass(frozen=True)
class Spaces:
    """Sizes of a task's observations and actions, which fix the networks' shapes."""

    observation_size: int
    """Length of an observation."""
    action_size: int
    """Number of actions at a time."""
    choices: tuple[int, ...] = ()
    """Number of alternatives of each action if actions are discrete; empty if each is a number in [-1, 1]."""


class Step(eqx.Module, Generic[StateT]):
    """The result of one step of a task."""

    state: StateT
    """The state after the step, before any reset."""
    observation: Observation
    """Its observation."""
    reward: Scalar
    """Reward of the step."""
    terminated: Flag
    """The process itself ended here: there is no value beyond. A continuing task never sets it."""
    truncated: Flag
    """The caller should reset, but the process would continue: bootstrap from ``observation``."""


class AbstractTask(eqx.Module, Generic[StateT]):
    """A Markov decision process; the caller batches it with ``vmap`` and resets it.

    Actions are numbers in [-1, 1], or, in a task with ``choices``, integers that count from 0.
    """

    @property
    def choices(self) -> tuple[int, ...]:
        """Number of alternatives of each discrete action; empty where actions are continuous."""
        return ()

    @property
    def spaces(self) -> Spaces:
        """Sizes of the observations and the actions."""
        return Spaces(self.observation_size, self.action_size, self.choices)

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
        """Advance by one action, each entry in [-1, 1] or one of its choices."""


def strongly_typed(leaf: Any) -> jax.Array:
    """An array of a type that stays: Python's numbers are weakly typed, a loop's and a checkpoint's are not."""
    array = jnp.asarray(leaf)
    return array if jnp.issubdtype(array.dtype, jax.dtypes.prng_key) else array.astype(array.dtype)
