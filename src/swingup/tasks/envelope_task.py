"""Environments with envelope's interface as tasks: they are compiled with the learner, which imports no envelope.

Source: jax-envelope 0.6.1, whose adapters give environments of brax, MuJoCo Playground, jumanji and others the
methods ``init(key)`` and ``step(state, action)``. Both return the state and information: ``obs``, ``reward``,
``terminated`` and ``truncated``. Nothing resets itself. A step draws its random numbers from the state, so the
task's key is not used. The package's time limit sets ``truncated``; every end inside a suite's environment sets
``terminated``.
"""

from typing import Any

import jax

from ..common.errors import SwingupError, attribute, errors_named_after, one_line
from ..common.types import Action, Key
from .adapted import AbstractAdaptedTask, AdaptedState, arrays_of, check_hash, shape_of_observation
from .space_actions import space_actions
from .task import Step

LEAVE_OUT = {
    "final_valid": "resets itself: leave AutoResetWrapper out, the learner resets",
    "unnormalized_obs": "normalises by statistics that a reset would lose: leave ObservationNormalizationWrapper "
    "out, the learner normalises",
}
"""Entries of the information that only these wrappers add, and what to do about them."""


class EnvelopeTask(AbstractAdaptedTask):
    """An environment with envelope's interface: a pytree, whose numbers are arguments of the compiled program."""

    env: Any

    def __init__(self, env: Any) -> None:
        """Wrap an environment.

        Args:
            env: has ``init(key)``, ``step(state, action)``, ``action_space`` and ``observation_space``.

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
