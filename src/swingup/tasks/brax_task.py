"""Environments with brax's methods, as those of MuJoCo Playground, as tasks: no package of theirs is imported.

The interface is that of brax 0.14 and MuJoCo Playground 0.2: ``reset(key)`` and ``step(state, action)`` return a
state with ``obs``, ``reward``, ``done`` and ``info``; actions are ``action_size`` numbers in [-1, 1]. A step draws
its random numbers from the state, so the task's key is not used. ``done`` merges both ends: one counts as a time
limit where ``info`` says so, by ``time_out`` or by ``truncation`` (that of ``EpisodeWrapper``). Without either,
every end terminates.
"""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..common.checks import whole_number
from ..common.errors import SwingupError, attribute, errors_named_after, one_line
from ..common.types import Action, Flag, Key
from .adapted import AbstractAdaptedTask, AdaptedState, check_hash, shape_of_observation
from .space_actions import SpaceActions
from .task import Step

TIME_LIMITS = ("time_out", "truncation")
"""Entries of ``info`` that tell a time limit from an end of the task."""
FIRST_OBSERVATION = "first_obs"
"""The entry of ``info`` that only ``AutoResetWrapper`` adds."""


class BraxTask(AbstractAdaptedTask):
    """An environment with brax's methods, which is compiled into the program."""

    env: Any = eqx.field(static=True)

    def __init__(self, env: Any) -> None:
        """Wrap an environment.

        Args:
            env: has ``reset(key)``, ``step(state, action)`` and ``action_size``. Of several observations the one
                named ``state`` is shown.
        """
        name = type(env).__name__
        # It is a static field, by which programs are told apart.
        check_hash(name, env)
        size = (whole_number(f"action_size of {name}", attribute(env, "action_size"), 1),)
        ones = np.ones(size, np.float32)
        self.env, self.actions = env, SpaceActions(size, "float32", (), -ones, ones)
        with errors_named_after(f"{name}.reset(key)"):
            start = jax.eval_shape(env.reset, jax.random.key(0))
        missing = [each for each in ("obs", "reward", "done", "info") if not hasattr(start, each)]
        if missing:
            raise SwingupError(f"the state of {name} has no {missing[0]}: return brax's State from reset(key)")
        # What resets itself hides the last observation, from which values are bootstrapped.
        if FIRST_OBSERVATION in start.info:
            raise SwingupError(f"{name} resets itself: leave AutoResetWrapper out, the learner resets")
        self.observation_shape = shape_of_observation(_seen(start), name)
        self.check_steps(f"{name}.step", "state, action")

    def reset(self, key: Key) -> AdaptedState:
        """The first state of an episode."""
        state = self.env.reset(key)
        return AdaptedState(state, _seen(state))

    def step(self, state: AdaptedState, action: Action, key: Key) -> Step[AdaptedState]:
        """One step of the environment."""
        after = self.env.step(state.inner, self.actions(action))
        seen, done = _seen(after), _flag(after.done)
        timed_out = jnp.any(
            jnp.array([_flag(after.info[name]) for name in TIME_LIMITS if name in after.info], bool)
        )
        # Both packages set ``done`` at a time limit, too.
        ends = done & ~timed_out, timed_out
        return self.made_step(AdaptedState(after, seen), seen, after.reward, ends)


def _seen(state: Any) -> Any:
    """The observation: MuJoCo Playground's critics see more than ``state``, in other entries."""
    seen = state.obs
    if not isinstance(seen, Mapping):
        return seen
    if "state" not in seen:
        raise SwingupError(f"observations {one_line(sorted(seen), 100)} have no entry 'state': name one so")
    return seen["state"]


def _flag(value: Any) -> Flag:
    """Both packages keep flags as numbers."""
    return jnp.asarray(value).reshape(()) > 0
