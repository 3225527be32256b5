"""Environments of other packages as tasks: they are compiled with the learner, and no package is imported.

- :class:`GymnaxTask`: gymnax 1.0, where a step tells the end of the task from the time limit. An environment that
  merges both into ``done``, as before gymnax 1.0, is refused.
- :class:`EnvelopeTask`: jax-envelope 0.6.1, whose adapters give environments of brax, MuJoCo Playground 0.2,
  jumanji and others the methods ``init(key)`` and ``step(state, action)``.
"""

import sys
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..common.errors import SwingupError, attribute, errors_named_after, one_line, quoted
from ..common.types import Action, Key, Observation
from ..policy.spaces import Space
from .task import AbstractTask, Step, space_actions, strongly_typed

FINAL_OBSERVATION = "final_observation"  # The entry of step's info that a reset does not replace
LEAVE_OUT = {
    "final_valid": "resets itself: leave AutoResetWrapper out, the learner resets",
    "unnormalized_obs": "normalises by statistics that a reset would lose: leave ObservationNormalizationWrapper "
    "out, the learner normalises",
}
"""Entries of the information that only these wrappers add, and what to do about them."""


def as_task(env: Any) -> Any:
    """A task for an environment with the methods of gymnax or envelope; anything else as it is.

    An environment of gymnax's may come with its parameters in a pair, as ``gymnax.make`` returns them.

    Raises:
        SwingupError: the environment has brax's methods, or an adapter refuses it.
    """
    alone, params = env if isinstance(env, tuple) and len(env) == 2 else (env, None)
    # Gymnasium's own may have methods and attributes of any name. It is slow to import, and there if one is.
    gymnasium = sys.modules.get("gymnasium")
    if isinstance(alone, type | AbstractTask) or (
        gymnasium and isinstance(env, gymnasium.Env | gymnasium.vector.VectorEnv)
    ):
        return env
    # In Gymnasium and envelope the spaces are attributes, in gymnax they are methods.
    if _has_methods(alone, "reset", "action_space", "observation_space"):
        return GymnaxTask(alone, params)
    if _has_methods(env, "init", "step") and attribute(env, "action_space") is not None:
        return EnvelopeTask(env)
    # A policy's number of actions is an attribute of brax's environments alone.
    if _has_methods(env, "reset", "step") and attribute(env, "action_size") is not None:
        raise SwingupError(
            f"{type(env).__name__} has brax's methods: make it with jax-envelope, as envelope.create('brax::ant') "
            "or envelope.create('mujoco_playground::CartpoleBalance')"
        )
    return env


def _has_methods(env: Any, *names: str) -> bool:
    return all(callable(attribute(env, name)) for name in names)


class AdaptedState(eqx.Module):
    """State of an adapted task."""

    inner: Any  # State of the environment, whose leaves are arrays of a fixed type, the one that loops carry
    observation: Observation  # Its observation, flattened: environments return it with the state

    def __init__(self, inner: Any, observation: Any) -> None:
        self.inner, self.observation = jax.tree.map(strongly_typed, inner), _flat(observation)


class AbstractAdaptedTask(AbstractTask[AdaptedState]):
    """A task around an environment with methods of its own."""

    env: eqx.AbstractVar[Any]  # The environment
    actions: Space  # Its actions, made from the policy's
    observation_shape: tuple[int, ...] = eqx.field(static=True)  # Shape of its observation, which is flattened

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
    """Refuse a static value without a hash."""
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


class GymnaxTask(AbstractAdaptedTask):
    """An environment with gymnax 1.0's methods, with parameters that are arguments of the compiled program.

    The task calls ``step``, which resets an environment that ended and shows in ``info["final_observation"]`` what
    the reset replaced: the returned state is already the next episode's. An environment without ``step`` has
    ``step_env``, which resets nothing, and ``is_truncated``. All have ``reset(key, params)`` and spaces.
    """

    env: Any = eqx.field(static=True)
    params: Any
    """Parameters of the environment, a pytree of arrays."""
    method: str = eqx.field(static=True)
    """``step``, or ``step_env`` where the environment has no ``step``."""

    def __init__(self, env: Any, params: Any = None) -> None:
        """Wrap an environment with its parameters; None for its ``default_params``.

        Raises:
            SwingupError: a method is missing or fails, or a space or a result is not supported.
        """
        name = type(env).__name__
        check_hash(name, env)
        parameters = attribute(env, "default_params") if params is None else params
        with errors_named_after(f"{name}.action_space(params)"):
            self.actions = space_actions(env.action_space(parameters))
        with errors_named_after(f"{name}.observation_space(params)"):
            space = env.observation_space(parameters)
        if attribute(space, "low") is None:
            raise SwingupError(
                f"observations {one_line(space, 100)} of {name} are not a Box: wrap it so that it shows one array"
            )
        self.env, self.params = env, arrays_of(name, parameters)
        # ``step_env`` is an environment's own; wrappers and gymnax's base class have ``step``.
        self.method = "step" if callable(attribute(env, "step")) else "step_env"
        with errors_named_after(f"{name}.reset(key, params)"):
            observation, _ = jax.eval_shape(env.reset, jax.random.key(0), self.params)
        self.observation_shape = shape_of_observation(observation, name)
        self.check_steps(f"{name}.{self.method}", "key, state, action, params")

    @property
    def timed(self) -> tuple[Any, ...]:
        """The environment, then its parameters."""
        return self.env, self.params

    def reset(self, key: Key) -> AdaptedState:
        """The first state of an episode."""
        observation, state = self.env.reset(key, self.params)
        return AdaptedState(state, observation)

    def step(self, state: AdaptedState, action: Action, key: Key) -> Step[AdaptedState]:
        """One step of the environment."""
        name, resets = f"{type(self.env).__name__}.{self.method}", self.method == "step"
        answer = getattr(self.env, self.method)(key, state.inner, self.actions(action), self.params)
        # Observation, state, reward, both ends and information; ``step_env`` leaves the truncation to
        # ``is_truncated``.
        length = 6 if resets else 5
        if not isinstance(answer, tuple) or len(answer) != length:
            got = f"{len(answer)} values" if isinstance(answer, tuple) else f"a {type(answer).__name__}"
            raise SwingupError(
                f"{name} returns {got}, not gymnax 1.0's {length} that tell terminated from truncated: update it"
            )
        seen, inner, reward, terminated, *_, info = answer
        if resets and not (isinstance(info, dict) and FINAL_OBSERVATION in info):
            raise SwingupError(
                f"{name} resets and hides the last observation: put it in info[{FINAL_OBSERVATION!r}]"
            )
        # The observation after a reset belongs to the next episode.
        last = info[FINAL_OBSERVATION] if resets else seen
        truncated = answer[4] if resets else self.env.is_truncated(inner, self.params)
        return self.made_step(AdaptedState(inner, seen), last, reward, (terminated, truncated))


class EnvelopeTask(AbstractAdaptedTask):
    """An environment with envelope's interface: a pytree, whose numbers are arguments of the compiled program.

    ``init(key)`` and ``step(state, action)`` return the state and information: ``obs``, ``reward``, ``terminated``
    and ``truncated``. Nothing resets itself. A step draws its random numbers from the state, so the task's key is
    not used. The package's time limit sets ``truncated``; every end inside a suite's environment sets
    ``terminated``.
    """

    env: Any

    def __init__(self, env: Any) -> None:
        """Wrap an environment with spaces and these two methods.

        Raises:
            SwingupError: a method fails, or a space or a result is not supported.
        """
        name = type(env).__name__
        _check_spaces(env, name)
        self.actions = space_actions(env.action_space)
        self.observation_shape = _observation_shape(env, name)
        # Arrays, so that other parameters need no new compilation.
        self.env = arrays_of(name, env)
        check_hash(name, jax.tree.structure(self.env))
        self.check_steps(f"{name}.step", "state, action")

    def reset(self, key: Key) -> AdaptedState:
        """The first state of an episode."""
        state, info = self.env.init(key)
        return AdaptedState(state, info.obs)

    def step(self, state: AdaptedState, action: Action, key: Key) -> Step[AdaptedState]:
        """One step of the environment."""
        inner, info = self.env.step(state.inner, self.actions(action))
        ends = info.terminated, info.truncated
        return self.made_step(AdaptedState(inner, info.obs), info.obs, info.reward, ends)


def _check_spaces(env: Any, name: str) -> None:
    """Refuse several environments in one, and spaces of several arrays."""
    if attribute(env.action_space, "batch_size") is not None:
        raise SwingupError(f"{name} is several environments in one: pass one alone, and num_envs to the learner")
    for what, space, wrappers in (
        ("actions", env.action_space, "FlattenActionWrapper"),
        ("observations", env.observation_space, "ContinuousObservationWrapper and FlattenObservationWrapper"),
    ):
        if attribute(space, "tree") is not None:
            shown = one_line(space, 100)
            raise SwingupError(f"{what} {shown} of {name} are several arrays: wrap it in envelope.{wrappers}")


def _observation_shape(env: Any, name: str) -> tuple[int, ...]:
    """The shape of the observation, from a trace of ``init``."""
    with errors_named_after(f"{name}.init(key)"):
        answer = jax.eval_shape(env.init, jax.random.key(0))
    if not isinstance(answer, tuple) or len(answer) != 2:
        raise SwingupError(f"{name}.init returns {one_line(answer, 100)}: it must return state and information")
    info = answer[1]
    missing = [each for each in ("obs", "reward", "terminated", "truncated") if not hasattr(info, each)]
    if missing:
        raise SwingupError(f"the information of {name} has no {missing[0]}: give it an envelope.InfoContainer")
    for entry, remedy in LEAVE_OUT.items():
        if hasattr(info, entry):
            raise SwingupError(f"{name} {remedy}")
    if info.reward.size != 1:
        raise SwingupError(f"{name} pays {info.reward.size} rewards at a time: wrap it so that it pays one")
    return shape_of_observation(info.obs, name)
