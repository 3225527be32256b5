"""Environments with gymnax's methods as tasks: they are compiled with the learner, and gymnax is not imported.

The interface is that of gymnax 1.0, where a step tells the end of the task from the time limit. ``step`` resets an
environment that ended. The task needs the observation before that: it calls ``step_env`` and ``is_truncated``.
Where ``step`` is more than these two, as in gymnax's wrappers, the task calls ``step`` and needs
``info["final_observation"]``. An environment that merges both ends into ``done``, as before gymnax 1.0, is refused.
"""

from typing import Any

import equinox as eqx
import jax

from ..common.errors import SwingupError
from ..common.foreign import attribute, blaming
from ..common.text import one_line
from ..common.types import Action, Key
from .adapted import AbstractAdaptedTask, AdaptedState, arrays_of, check_hash, shape_of_observation
from .space_actions import SpaceActions, space_actions
from .task import Step

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
        check_hash(name, env)
        given = attribute(env, "default_params") if params is None else params
        with blaming(f"{name}.action_space(params)"):
            self.actions = space_actions(env.action_space(given))
        with blaming(f"{name}.observation_space(params)"):
            space = env.observation_space(given)
        if any(attribute(space, bound) is None for bound in ("low", "high")):
            raise SwingupError(
                f"observations {one_line(space, 100)} of {name} are no Box: wrap it so that it shows one array"
            )
        self.env, self.params, self.resets_itself = env, arrays_of(name, given), _resets_itself(type(env))
        with blaming(f"{name}.reset(key, params)"):
            observation, _ = jax.eval_shape(env.reset, jax.random.key(0), self.params)
        self.observation_shape = shape_of_observation(observation, name)
        self.check_steps(f"{name}.{self._method}", "key, state, action, params")

    @property
    def timed(self) -> tuple[Any, ...]:
        """The environment, then its parameters."""
        return self.env, self.params

    def reset(self, key: Key) -> AdaptedState:
        """The first state of an episode."""
        observation, state = self.env.reset(key, self.params)
        return AdaptedState(state, observation)

    def step(self, state: AdaptedState, action: Action, key: Key) -> Step[AdaptedState]:
        """One step of the environment.

        Raises:
            SwingupError: its results are not gymnax 1.0's.
        """
        name, length = f"{type(self.env).__name__}.{self._method}", 6 if self.resets_itself else 5
        answer = getattr(self.env, self._method)(key, state.inner, self.actions(action), self.params)
        if not isinstance(answer, tuple) or len(answer) != length:
            got = f"{len(answer)} values" if isinstance(answer, tuple) else f"a {type(answer).__name__}"
            raise SwingupError(
                f"{name} returns {got}, not gymnax 1.0's {length} that tell terminated from truncated: "
                "update it, or define step_env and is_truncated"
            )
        seen, inner, reward, terminated, *_, info = answer
        if not self.resets_itself:
            last, truncated = seen, self.env.is_truncated(inner, self.params)
        elif isinstance(info, dict) and FINAL in info:
            last, truncated = info[FINAL], answer[4]
        else:
            raise SwingupError(f"{name} resets and hides the last observation: put it in info[{FINAL!r}]")
        return self.made_step(AdaptedState(inner, seen), last, reward, (terminated, truncated))

    @property
    def _method(self) -> str:
        return "step" if self.resets_itself else "step_env"


def _resets_itself(kind: type) -> bool:
    """Whether to call the ``step`` of a class of environments.

    A wrapper has ``step_env`` only from what it wraps, whose states are others than its own. A class that changes
    the ``step`` of a base class alone means it to be called.
    """
    if not all(hasattr(kind, name) for name in ("step_env", "is_truncated")):
        return True
    latest = next(each for each in kind.__mro__ if {"step", "step_env"} & vars(each).keys())
    return "step_env" not in vars(latest)
