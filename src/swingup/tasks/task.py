"""The interface of a task: a pure, unbatched Markov decision process that never resets itself.

The stages of an observation and the spaces of actions are pytrees here: the same code serves training, judging,
control and files.
"""

import abc
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..common.checks import whole_number
from ..common.errors import SwingupError, attribute, errors_named_after, naming, one_line
from ..common.types import Action, Flag, Key, Observation, Scalar
from ..policy.network import STAGES
from ..policy.network import MagnifyStage as MagnifyStage
from ..policy.network import NormaliseStage as NormaliseStage
from ..policy.network import PendulumStage as PendulumStage
from ..policy.network import PlantStage as PlantStage
from ..policy.network import Stage as Stage
from ..policy.spaces import Space, box, discrete

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
    def own_actions(self) -> Space:
        """The space of its actions."""
        return discrete(self.choices, 0, "int32") if self.choices else box((self.action_size,), -1.0, 1.0)

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


def check_task(task: AbstractTask[Any]) -> None:
    """Trace a reset and a step of a task without running them.

    Raises:
        SwingupError: JAX cannot trace them, or what they give has other shapes or types than the task says.
    """
    name = type(task).__name__
    with naming(name):
        whole_number("observation_size", task.observation_size, 1)
        actions = whole_number("action_size", task.action_size, 1)
        for count in task.choices:
            whole_number("choices", count, 1)
        if task.choices and len(task.choices) != actions:
            raise SwingupError(
                f"choices = {task.choices} for action_size = {actions}: give a number for each action"
            )
    remedy = (
        "write them for jax.jit; a field that is a shape, a branch or a word is x: int = eqx.field(static=True)"
    )
    with errors_named_after(f"tracing reset, observe and step of {name}", remedy):
        key, action = jax.random.key(0), jnp.zeros(task.action_size, int if task.choices else float)

        def trace(call: str, *arguments: Any) -> Any:
            # As the learner does, with the task as an argument: its numbers are traced.
            return jax.eval_shape(lambda task, *rest: getattr(task, call)(*rest), task, *arguments)

        state = trace("reset", key)
        seen, step = trace("observe", state), trace("step", state, action, key)
        size = (task.observation_size,)
        given = (
            ("observe()", seen, size), ("observation of step()", step.observation, size),
            ("reward of step()", step.reward, ()), ("terminated of step()", step.terminated, ()),
            ("truncated of step()", step.truncated, ()),
        )  # fmt: skip
        before, after = map(structure_of, (state, step.state))
    for what, value, wanted in given:
        if (shape := getattr(value, "shape", type(value).__name__)) != wanted:
            raise SwingupError(f"{what} of {name} has shape {shape}: the task needs {wanted}")
        if what.startswith("t") and value.dtype != bool:
            raise SwingupError(f"{what} of {name} is {value.dtype}: give a truth value")
        if what.startswith("reward") and value.dtype == bool:
            raise SwingupError(f"{what} of {name} is bool: give a number")
    if before != after:
        raise SwingupError(f"step() of {name} changes shapes or types of the state: keep those of reset()")


def structure_of(state: Any) -> tuple[Any, list[tuple[tuple[int, ...], Any]]]:
    """The structure of a pytree with its leaves' shapes and types."""
    leaves, structure = jax.tree.flatten(state)
    return structure, [(jnp.shape(leaf), jnp.result_type(leaf)) for leaf in leaves]


def strongly_typed(leaf: Any) -> jax.Array:
    """An array of a type that stays: Python's numbers are weakly typed, a loop's and a checkpoint's are not."""
    array = jnp.asarray(leaf)
    return array if jnp.issubdtype(array.dtype, jax.dtypes.prng_key) else array.astype(array.dtype)


def check_energy(
    task: AbstractTask[StateT],
    energy: Callable[[StateT], Scalar],
    states: StateT,
    action: Any,
    steps: int = 1000,
    tolerance: float = 0.01,
) -> float:
    """Find an integrator that gains energy: on such a task a policy learns to exploit it.

    Args:
        task: of motion that no step adds energy to under this action.
        energy: kinetic and potential energy of a state (J).
        states: at least two states to start from, stacked along the first axis of each leaf.
        action: does no work, as a torque of 0.
        steps: of each run; ends do not reset it.
        tolerance: largest gain, as a share of the range of the energies of ``states``.

    Returns:
        The largest rise above the initial energy, as such a share; below 0 with friction.

    Raises:
        SwingupError: energy rises by more, or is not finite.
    """
    key, act = jax.random.key(0), jnp.asarray(action)

    def advance(state: StateT, _: None) -> tuple[StateT, Scalar]:
        state = task.step(state, act, key).state
        return state, energy(state)

    @jax.jit
    @jax.vmap
    def run(state: StateT) -> tuple[Scalar, Scalar]:
        return energy(state), jax.lax.scan(advance, state, length=steps)[1]

    initial, after = map(np.asarray, run(states))
    gain = float(np.max(after - initial[:, None]) / np.ptp(initial))
    # Negated, so that NaN fails as well.
    if not gain <= tolerance:
        raise SwingupError(
            f"the task gains {gain:.3g} of its range of energies in {steps:,} steps: integrate with shorter "
            f"steps or with RK4"
        )
    return gain


def space_actions(space: Any) -> Space:
    """The actions of a space that has ``n`` or ``nvec``, or ``low`` and ``high``."""
    shown = f"actions {one_line(space, 200)}"
    counts = attribute(space, "n", attribute(space, "nvec"))
    if counts is not None:
        counts, kind = np.asarray(counts), np.dtype(attribute(space, "dtype", np.int32))
        if counts.size == 0 or counts.min() < 1:
            raise SwingupError(f"{shown} are empty: give them a choice")
        # Gymnasium's discrete spaces may count from another number than 0.
        return discrete(counts, attribute(space, "start", 0), kind.name)
    if any(attribute(space, name) is None for name in ("low", "high", "shape")):
        raise SwingupError(f"{shown} are not supported: use a bounded Box, Discrete or MultiDiscrete")
    shape, kind = tuple(map(int, space.shape)), np.dtype(attribute(space, "dtype", np.float32))
    if 0 in shape:
        raise SwingupError(f"{shown} are empty: give them an entry")
    if not np.issubdtype(kind, np.floating):
        raise SwingupError(f"{shown} are whole numbers in a Box: make them discrete")
    # Differences of float16 may overflow.
    wide = np.promote_types(kind, np.float32)
    low, high = (np.broadcast_to(np.asarray(bound, wide), shape) for bound in (space.low, space.high))
    with np.errstate(over="ignore"):  # bounds whose difference overflows are not bounds either
        unbounded = ~np.isfinite(np.float32(high) - np.float32(low))
    if unbounded.any():
        first = tuple(np.argwhere(unbounded)[0].tolist())
        entry = f"low{list(first)} = {low[first]} and high{list(first)} = {high[first]}"
        raise SwingupError(f"{shown} have no bounds to scale to, {entry}: give the space finite low and high")
    return box(shape, low, high, kind.name)


# Shape, type and choices decide the program.
jax.tree_util.register_dataclass(Space, ["low", "high"], ["shape", "dtype", "choices"])
for _kind in STAGES.values():
    _names = [each.name for each in fields(_kind)]
    # The encoding of the angles decides the shape, and so the program.
    _static = [name for name in _names if name == "angles"]
    jax.tree_util.register_dataclass(_kind, [name for name in _names if name not in _static], _static)
