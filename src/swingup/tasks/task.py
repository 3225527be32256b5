"""The interface of a task: a pure, unbatched Markov decision process that never resets itself.

:class:`SpaceActions` makes the actions of a Gymnasium, gymnax or envelope space from the policy's. The stages of an
observation are pytrees here: the same code serves training, judging, control and files.
"""

import abc
from dataclasses import dataclass, fields
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Shaped

from ..common.errors import SwingupError, attribute, one_line
from ..common.types import Action, Flag, Key, Observation, Scalar
from ..policy.network import STAGES
from ..policy.network import NormaliseStage as NormaliseStage
from ..policy.network import PendulumStage as PendulumStage
from ..policy.network import PlantStage as PlantStage
from ..policy.network import Stage as Stage

StateT = TypeVar("StateT")


@dataclass(frozen=True)
class Spaces:
    """Sizes of a task's observations and actions, which fix the networks' shapes."""

    observation_size: int  # Length of an observation
    action_size: int  # Number of actions at a time
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


class SpaceActions(eqx.Module):
    """Scales numbers in [-1, 1] to the bounds of a box, or counts choices from the first; in NumPy and in JAX."""

    shape: tuple[int, ...] = eqx.field(static=True)  # Shape of the environment's action
    dtype: str = eqx.field(static=True)
    choices: tuple[int, ...] = eqx.field(static=True)  # Number of alternatives; empty for a box
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


for _kind in STAGES.values():
    _names = [each.name for each in fields(_kind)]
    # The encoding of the angles decides the shape, and so the program.
    _static = [name for name in _names if name == "angles"]
    jax.tree_util.register_dataclass(_kind, [name for name in _names if name not in _static], _static)
