"""Environments with gymnax's methods as tasks: they are compiled with the learner, and gymnax is not imported.

The interface is that of gymnax 1.0, where a step tells the end of the task from the time limit. ``step`` resets an
environment that ended. The task needs the observation before that: it calls ``step_env`` and ``is_truncated``.
Where ``step`` is more than these two, as in gymnax's wrappers, the task calls ``step`` and reads
``info["final_observation"]``. An environment that merges both ends into ``done``, as before gymnax 1.0, is refused.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..errors import SwingupError
from ..foreign import attribute, blaming
from ..types import Action, Key, Observation
from .gymnax_actions import GymnaxActions, gymnax_actions
from .gymnax_interface import arrays_of, observation_shape, resets_itself
from .task import AbstractTask, Step

FINAL = "final_observation"
"""The entry of ``step``'s info that a reset does not replace."""


class GymnaxState(eqx.Module):
    """State of the task."""

    inner: Any
    """State of the environment."""
    observation: Observation
    """Its observation, flattened: gymnax returns it with the state, since it may depend on a key and an action."""


class GymnaxTask(AbstractTask[GymnaxState]):
    """An environment with gymnax's methods, with parameters that are arguments of the compiled program.

    Where ``step`` is called, the state after the end of an episode is already the next episode's.
    """

    env: Any = eqx.field(static=True)
    params: Any
    """Parameters of the environment, a pytree of arrays."""
    actions: GymnaxActions
    observation_shape: tuple[int, ...] = eqx.field(static=True)
    """Shape of the environment's observation, which is flattened."""
    resets_itself: bool = eqx.field(static=True)
    """Whether ``step`` is called, not ``step_env``."""

    def __init__(self, env: Any, params: Any = None) -> None:
        """Wrap an environment.

        Args:
            env: has ``reset(key, params)``, ``action_space(params)``, ``observation_space(params)``, and either
                ``step_env`` and ``is_truncated`` or gymnax 1.0's ``step``.
            params: its parameters; None for its ``default_params``.

        Raises:
            SwingupError: a method is missing or fails, or a space or a result is not supported.
        """
        name = type(env).__name__
        try:
            hash(env)
        except TypeError:
            raise SwingupError(
                f"{name} has no hash, by which JAX compiles: make it a class without __eq__"
            ) from None
        given = attribute(env, "default_params") if params is None else params
        with blaming(f"{name}.action_space(params)"):
            self.actions = gymnax_actions(env.action_space(given))
        self.env, self.params = env, arrays_of(name, given)
        self.resets_itself = resets_itself(env)
        self.observation_shape = observation_shape(env, name, given, self.params)
        _check_step(self, name)

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
        """Number of alternatives of a discrete action; empty for a box."""
        return self.actions.choices

    def reset(self, key: Key) -> GymnaxState:
        """The first state of an episode."""
        observation, state = self.env.reset(key, self.params)
        # Python's numbers in a state become arrays of a fixed type, the one that loops carry.
        return GymnaxState(jax.tree.map(_fixed, state), _flat(observation))

    def observe(self, state: GymnaxState) -> Observation:
        """The flattened observation."""
        return state.observation

    def step(self, state: GymnaxState, action: Action, key: Key) -> Step[GymnaxState]:
        """One step of the environment."""
        chosen, last = self.actions(action), None
        if self.resets_itself:
            seen, inner, reward, terminated, truncated, info = self.env.step(key, state.inner, chosen, self.params)
            last = info[FINAL]
        else:
            seen, inner, reward, terminated, _ = self.env.step_env(key, state.inner, chosen, self.params)
            truncated = self.env.is_truncated(inner, self.params)
        return Step(
            state=GymnaxState(jax.tree.map(_fixed, inner), _flat(seen)),
            observation=_flat(seen if last is None else last),
            reward=jnp.asarray(reward, jnp.float32).reshape(()),
            terminated=jnp.asarray(terminated, bool).reshape(()),
            truncated=jnp.asarray(truncated, bool).reshape(()),
        )


def as_task(env: Any) -> Any:
    """A task for an environment with gymnax's methods, or for a pair of one and its parameters.

    ``gymnax.make`` returns such a pair. Anything else is returned as it is.

    Raises:
        SwingupError: the environment has gymnax's methods and cannot be trained on.
    """
    alone, params = env if isinstance(env, tuple) and len(env) == 2 else (env, None)
    if isinstance(alone, type | AbstractTask):
        return env
    # In Gymnasium the spaces are attributes, in gymnax they are methods.
    methods = ("reset", "action_space", "observation_space")
    steps = any(callable(attribute(alone, name)) for name in ("step", "step_env"))
    return GymnaxTask(alone, params) if steps and all(callable(attribute(alone, name)) for name in methods) else env


def _check_step(task: GymnaxTask, name: str) -> None:
    """Refuse a step that returns something else than gymnax 1.0's, or changes the types of state or observation."""
    method, length = ("step", 6) if task.resets_itself else ("step_env", 5)
    key, params = jax.random.key(0), task.params
    action = task.actions(jnp.zeros(task.action_size, jnp.int32 if task.choices else jnp.float32))
    start = jax.eval_shape(task.reset, key)
    with blaming(f"{name}.{method}(key, state, action, params)"):
        answer = jax.eval_shape(getattr(task.env, method), key, start.inner, action, params)
    if not isinstance(answer, tuple) or len(answer) != length:
        got = f"{len(answer)} values" if isinstance(answer, tuple) else f"a {type(answer).__name__}"
        raise SwingupError(
            f"{name}.{method} returns {got}, not gymnax 1.0's {length} that tell terminated from truncated: "
            "update it, or define step_env and is_truncated"
        )
    if task.resets_itself and (not isinstance(answer[-1], dict) or FINAL not in answer[-1]):
        raise SwingupError(f"{name}.step resets and hides the last observation: put it in info[{FINAL!r}]")
    with blaming(f"{name}.{method}(key, state, action, params)"):
        step = jax.eval_shape(task.step, start, jnp.zeros(task.action_size, action.dtype), key)
    if step.observation.shape != start.observation.shape:
        raise SwingupError(f"{name}.{method} shows {step.observation.shape}, its reset {start.observation.shape}")
    _check_state(f"{name}.{method}", start.inner, step.state.inner)


def _check_state(what: str, before: Any, after: Any) -> None:
    """Refuse a step that changes the structure or the types of the state, which loops carry."""
    flat = [jax.tree.flatten(state) for state in (before, after)]
    kinds = [[(leaf.shape, leaf.dtype.name) for leaf in leaves] for leaves, _ in flat]
    if flat[0][1:] != flat[1][1:]:
        raise SwingupError(f"{what} changes the state's structure: return what reset returns")
    for one, other in zip(*kinds, strict=True):
        if one != other:
            raise SwingupError(
                f"{what} changes an entry of the state from {one} to {other}: return what reset returns"
            )


def _fixed(leaf: Any) -> jax.Array:
    array = jnp.asarray(leaf)
    return array if jnp.issubdtype(array.dtype, jax.dtypes.prng_key) else array.astype(array.dtype)


def _flat(observation: Any) -> Observation:
    return jnp.asarray(observation, jnp.float32).reshape(-1)
