"""What the tasks that adapt environments of other packages have in common."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..common.errors import SwingupError, attribute, errors_named_after, one_line, quoted
from ..common.types import Observation
from .space_actions import SpaceActions
from .task import AbstractTask, Step, strongly_typed


class AdaptedState(eqx.Module):
    """State of an adapted task."""

    inner: Any
    """State of the environment, whose leaves are arrays of a fixed type, the one that loops carry."""
    observation: Observation
    """Its observation, flattened: environments return it with the state."""

    def __init__(self, inner: Any, observation: Any) -> None:
        """A state of what an environment returns."""
        self.inner, self.observation = jax.tree.map(strongly_typed, inner), _flat(observation)


class AbstractAdaptedTask(AbstractTask[AdaptedState]):
    """A task around an environment with methods of its own."""

    env: eqx.AbstractVar[Any]
    """The environment."""
    actions: SpaceActions
    """Its actions, made from the policy's."""
    observation_shape: tuple[int, ...] = eqx.field(static=True)
    """Shape of its observation, which is flattened."""

    @property
    def named_after(self) -> Any:
        """The object whose class names the task in messages and files: the environment inside all wrappers."""
        return attribute(self.env, "unwrapped", self.env)

    @property
    def timed(self) -> tuple[Any, ...]:
        """What may have the time of a step (s) as its attribute ``dt``, the first that has it."""
        return self.env, self.named_after

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

    def observe(self, state: AdaptedState) -> Observation:
        """The flattened observation."""
        return state.observation

    def made_step(self, state: AdaptedState, last: Any, reward: Any, ends: tuple[Any, Any]) -> Step[AdaptedState]:
        """A step of the observation before any reset, ``last``, and whether it is terminated and truncated."""
        # Some packages return numbers, or arrays of one entry.
        terminated, truncated = (jnp.asarray(end, bool).reshape(()) for end in ends)
        return Step(state, _flat(last), jnp.asarray(reward, jnp.float32).reshape(()), terminated, truncated)

    def check_steps(self, method: str, arguments: str) -> None:
        """Refuse a step that changes the observation's shape, or the structure or the types of the state."""
        start = jax.eval_shape(self.reset, jax.random.key(0))
        action = jnp.zeros(self.action_size, jnp.int32 if self.choices else jnp.float32)
        with errors_named_after(f"{method}({arguments})"):
            step = jax.eval_shape(self.step, start, action, jax.random.key(0))
        if step.observation.shape != start.observation.shape:
            raise SwingupError(f"{method} shows {step.observation.shape}, its reset {start.observation.shape}")
        # A compiled loop carries the state, whose structure and types must not change.
        structures = [jax.tree.structure(state.inner) for state in (start, step.state)]
        if structures[:1] != structures[1:]:
            raise SwingupError(f"{method} changes the state's structure: return what reset returns")
        for one, other in zip(jax.tree.leaves(start.inner), jax.tree.leaves(step.state.inner), strict=True):
            if (one.shape, one.dtype) != (other.shape, other.dtype):
                changed = f"from {one.dtype} {one.shape} to {other.dtype} {other.shape}"
                raise SwingupError(f"{method} changes an entry of the state {changed}: return what reset returns")


def arrays_of(name: str, tree: Any) -> Any:
    """The parameters of an environment, with arrays as leaves."""

    def array(leaf: Any) -> jax.Array:
        try:
            return jnp.asarray(leaf)
        except (TypeError, ValueError):
            raise SwingupError(
                f"parameters of {name} have a leaf {quoted(leaf)}: give them numbers and arrays, in a pytree"
            ) from None

    return jax.tree.map(array, tree)


def check_hash(name: str, static: Any) -> None:
    """Refuse what JAX cannot compile by."""
    try:
        hash(static)
    except TypeError as error:
        raise SwingupError(
            f"{name} has no hash, by which JAX compiles ({error}): "
            "make it a class without __eq__, and its static fields tuples"
        ) from None


def shape_of_observation(observation: Any, name: str) -> tuple[int, ...]:
    """The shape of a named environment's observation, of which the shape and type, or the space, are given."""
    shape, shown = attribute(observation, "shape"), f"observations {one_line(observation, 100)} of {name}"
    if shape is None or 0 in shape:
        what = "several arrays" if shape is None else "empty"
        raise SwingupError(f"{shown} are {what}: make them one array with an entry")
    # One row of bytes may well be a state: a game's memory.
    if observation.dtype == np.uint8 and len(shape) > 1:
        raise SwingupError(
            f"{shown} are images, which these networks cannot see: show features of them, or flatten them"
        )
    return tuple(shape)


def _flat(observation: Any) -> Observation:
    return jnp.asarray(observation, jnp.float32).reshape(-1)
