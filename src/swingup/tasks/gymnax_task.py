"""Environments with gymnax's methods as tasks: they are compiled with the learner, and gymnax is not imported.

The interface is that of gymnax 1.0, where a step tells the end of the task from the time limit. The task calls
``step``, which resets an environment that ended and shows in ``info["final_observation"]`` what the reset replaced.
An environment without ``step`` has ``step_env``, which resets nothing, and ``is_truncated``. An environment that
merges both ends into ``done``, as before gymnax 1.0, is refused.
"""

from typing import Any

import equinox as eqx
import jax

from ..common.errors import SwingupError, attribute, errors_named_after, one_line
from ..common.types import Action, Key
from .adapted import AbstractAdaptedTask, AdaptedState, arrays_of, check_hash, shape_of_observation
from .space_actions import space_actions
from .task import Step

FINAL_OBSERVATION = "final_observation"
"""The entry of ``step``'s info that a reset does not replace."""


class GymnaxTask(AbstractAdaptedTask):
    """An environment with gymnax's methods, with parameters that are arguments of the compiled program.

    The state that ``step`` returns after the end of an episode is already the next episode's.
    """

    env: Any = eqx.field(static=True)
    params: Any
    """Parameters of the environment, a pytree of arrays."""
    method: str = eqx.field(static=True)
    """``step``, or ``step_env`` where the environment has no ``step``."""

    def __init__(self, env: Any, params: Any = None) -> None:
        """Wrap an environment.

        Args:
            env: has ``reset(key, params)``, ``action_space(params)``, ``observation_space(params)``, and either
                gymnax 1.0's ``step`` or ``step_env`` and ``is_truncated``.
            params: its parameters; None for its ``default_params``.

        Raises:
            SwingupError: a method is missing or fails, or a space or a result is not supported.
        """
        name = type(env).__name__
        check_hash(name, env)
        given = attribute(env, "default_params") if params is None else params
        with errors_named_after(f"{name}.action_space(params)"):
            self.actions = space_actions(env.action_space(given))
        with errors_named_after(f"{name}.observation_space(params)"):
            space = env.observation_space(given)
        if attribute(space, "low") is None:
            raise SwingupError(
                f"observations {one_line(space, 100)} of {name} are not a Box: wrap it so that it shows one array"
            )
        self.env, self.params = env, arrays_of(name, given)
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
