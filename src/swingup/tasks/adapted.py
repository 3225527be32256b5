"""What the tasks that adapt environments of other packages have in common."""

import abc
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..errors import SwingupError
from ..foreign import attribute
from ..text import one_line, quoted
from ..types import Observation
from .space_actions import SpaceActions
from .task import AbstractTask

InnerT = TypeVar("InnerT")


class AdaptedState(eqx.Module, Generic[InnerT]):
    """State of an adapted task."""

    inner: InnerT
    """State of the environment."""
    observation: Observation
    """Its observation, flattened: environments return it with the state."""


class AbstractAdaptedTask(AbstractTask[AdaptedState[Any]]):
    """A task around an environment with methods of its own."""

    env: eqx.AbstractVar[Any]
    """The environment."""
    actions: eqx.AbstractVar[SpaceActions]
    """Its actions, made from the policy's."""
    observation_shape: eqx.AbstractVar[tuple[int, ...]]
    """Shape of its observation, which is flattened."""

    @property
    @abc.abstractmethod
    def named_after(self) -> Any:
        """The object whose class names the task in messages and files."""

    @property
    @abc.abstractmethod
    def timed(self) -> tuple[Any, ...]:
        """What may have the time of a step (s) as its attribute ``dt``, the first that has it."""

    @property
    def observation_size(self) -> int:
        """Length of a flattened observation."""
        return int(np.prod(self.observation_shape))

    @property
    def action_size(self) -> int:
        """Number of entries of an action."""
        return self.actions.size

    @property
    def choices(self) -> tuple[int, ...]:
        """Number of alternatives of each discrete action; empty for a box."""
        return self.actions.choices

    def observe(self, state: AdaptedState[Any]) -> Observation:
        """The flattened observation."""
        return state.observation


def adapted_state(inner: Any, observation: Any) -> AdaptedState[Any]:
    """A state whose leaves are arrays of a fixed type, the one that loops carry."""
    return AdaptedState(jax.tree.map(_fixed, inner), flat(observation))


def flat(observation: Any) -> Observation:
    """An observation as a vector in single precision."""
    return jnp.asarray(observation, jnp.float32).reshape(-1)


def arrays_of(name: str, tree: Any) -> Any:
    """The parameters of an environment, with arrays as leaves.

    Raises:
        SwingupError: a leaf is no number.
    """
    leaves, structure = jax.tree.flatten(tree)
    try:
        return jax.tree.unflatten(structure, [jnp.asarray(leaf) for leaf in leaves])
    except (TypeError, ValueError):
        bad = next(leaf for leaf in leaves if not isinstance(leaf, bool | int | float | jax.Array | np.ndarray))
        raise SwingupError(
            f"parameters of {name} have a leaf {quoted(bad)}: give them numbers and arrays, in a pytree"
        ) from None


def shape_of_observation(observation: Any, name: str, method: str, images: str) -> tuple[int, ...]:
    """The shape of an observation, which must be one array and no image.

    Args:
        observation: an array, or its shape and type.
        name: the environment's, for messages.
        method: the one that showed it.
        images: what else than features an environment with images may show.

    Raises:
        SwingupError: it is something else.
    """
    shape = attribute(observation, "shape")
    if shape is None or 0 in shape:
        raise SwingupError(f"{name}.{method} shows {one_line(observation, 100)}: make it one array with an entry")
    if observation.dtype == np.uint8 and len(shape) > 1:
        raise SwingupError(
            f"observations {one_line(observation, 100)} of {name} are images, which these networks cannot see: "
            f"show features of them, or say {images}"
        )
    return tuple(shape)


def some_action(task: AbstractAdaptedTask) -> jax.Array:
    """An action of the task, to trace a step with."""
    return jnp.zeros(task.action_size, jnp.int32 if task.choices else jnp.float32)


def check_steps(task: AbstractAdaptedTask, method: str) -> None:
    """Refuse a step that changes the observation's shape, or the structure or the types of the state.

    Raises:
        SwingupError: it does; or it returns what no step can be made of.
    """
    start = jax.eval_shape(task.reset, jax.random.key(0))
    step = jax.eval_shape(task.step, start, some_action(task), jax.random.key(0))
    if step.observation.shape != start.observation.shape:
        raise SwingupError(f"{method} shows {step.observation.shape}, its reset {start.observation.shape}")
    flattened = [jax.tree.flatten(state.inner) for state in (start, step.state)]
    kinds = [[(leaf.shape, leaf.dtype.name) for leaf in leaves] for leaves, _ in flattened]
    if flattened[0][1:] != flattened[1][1:]:
        raise SwingupError(f"{method} changes the state's structure: return what reset returns")
    for one, other in zip(*kinds, strict=True):
        if one != other:
            raise SwingupError(
                f"{method} changes an entry of the state from {one} to {other}: return what reset returns"
            )


def _fixed(leaf: Any) -> jax.Array:
    # Python's numbers are weakly typed: a loop would see another type after its first step.
    array = jnp.asarray(leaf)
    return array if jnp.issubdtype(array.dtype, jax.dtypes.prng_key) else array.astype(array.dtype)
