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

from ..errors import SwingupError
from ..foreign import attribute, blaming
from ..types import Action, Key
from .adapted import AbstractAdaptedTask, AdaptedState, adapted_state, arrays_of, check_steps, flat, some_action
from .gymnax_interface import observation_shape, resets_itself
from .space_actions import SpaceActions, space_actions
from .task import AbstractTask, Step

FINAL = "final_observation"
"""The entry of ``step``'s info that a reset does not replace."""


class GymnaxTask(AbstractAdaptedTask):
    """An environment with gymnax's methods, with parameters that are arguments of the compiled program.

    Where ``step`` is called, the state after the end of an episode is already the next episode's.
    """

    env: Any = eqx.field(static=True)
    params: Any
    """Parameters of the environment, a pytree of arrays."""
    actions: SpaceActions
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
            self.actions = space_actions(env.action_space(given))
        self.env, self.params = env, arrays_of(name, given)
        self.resets_itself = resets_itself(env)
        self.observation_shape = observation_shape(env, name, given, self.params)
        _check_step(self, name)

    @property
    def named_after(self) -> Any:
        """The environment, or the outermost of its wrappers."""
        return self.env

    @property
    def timed(self) -> tuple[Any, ...]:
        """The environment, then its parameters."""
        return self.env, self.params

    def reset(self, key: Key) -> AdaptedState[Any]:
        """The first state of an episode."""
        observation, state = self.env.reset(key, self.params)
        return adapted_state(state, observation)

    def step(self, state: AdaptedState[Any], action: Action, key: Key) -> Step[AdaptedState[Any]]:
        """One step of the environment."""
        chosen, last = self.actions(action), None
        if self.resets_itself:
            seen, inner, reward, terminated, truncated, info = self.env.step(key, state.inner, chosen, self.params)
            last = info[FINAL]
        else:
            seen, inner, reward, terminated, _ = self.env.step_env(key, state.inner, chosen, self.params)
            truncated = self.env.is_truncated(inner, self.params)
        return Step(
            state=adapted_state(inner, seen),
            observation=flat(seen if last is None else last),
            reward=jnp.asarray(reward, jnp.float32).reshape(()),
            terminated=jnp.asarray(terminated, bool).reshape(()),
            truncated=jnp.asarray(truncated, bool).reshape(()),
        )


def gymnax_task(env: Any) -> GymnaxTask | None:
    """A task for an environment with gymnax's methods, or for a pair of one and its parameters, or None.

    ``gymnax.make`` returns such a pair.

    Raises:
        SwingupError: the environment has gymnax's methods and cannot be trained on.
    """
    alone, params = env if isinstance(env, tuple) and len(env) == 2 else (env, None)
    if isinstance(alone, type | AbstractTask):
        return None
    # In Gymnasium the spaces are attributes, in gymnax they are methods.
    methods = ("reset", "action_space", "observation_space")
    steps = any(callable(attribute(alone, name)) for name in ("step", "step_env"))
    complete = steps and all(callable(attribute(alone, name)) for name in methods)
    return GymnaxTask(alone, params) if complete else None


def _check_step(task: GymnaxTask, name: str) -> None:
    """Refuse a step that returns something else than gymnax 1.0's, or changes the types of state or observation."""
    method, length = ("step", 6) if task.resets_itself else ("step_env", 5)
    key, params = jax.random.key(0), task.params
    action = task.actions(some_action(task))
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
        check_steps(task, f"{name}.{method}")
