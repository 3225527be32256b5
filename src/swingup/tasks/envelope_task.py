"""Environments with envelope's interface as tasks: they are compiled with the learner, which imports no envelope.

Source: jax-envelope 0.6.1, whose adapters give environments of brax, MuJoCo Playground, jumanji and others the
methods ``init(key)`` and ``step(state, action)``. Both return the state and information: ``obs``, ``reward``,
``terminated`` and ``truncated``. Nothing resets itself. A step draws its random numbers from the state, so the
task's key is not used. The package's time limit sets ``truncated``; every end inside a suite's environment sets
``terminated``.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ..errors import SwingupError
from ..foreign import attribute, blaming
from ..types import Action, Key
from .adapted import AbstractAdaptedTask, AdaptedState, adapted_state, arrays_of, check_steps, flat
from .envelope_interface import check_spaces, has_interface, observation_shape
from .space_actions import SpaceActions, space_actions
from .task import AbstractTask, Step


class EnvelopeTask(AbstractAdaptedTask):
    """An environment with envelope's interface: a pytree, whose numbers are arguments of the compiled program."""

    env: Any
    actions: SpaceActions
    observation_shape: tuple[int, ...] = eqx.field(static=True)
    """Shape of the environment's observation, which is flattened."""

    def __init__(self, env: Any) -> None:
        """Wrap an environment.

        Args:
            env: has ``init(key)``, ``step(state, action)``, ``action_space`` and ``observation_space``.

        Raises:
            SwingupError: a method fails, or a space or a result is not supported.
        """
        name = type(env).__name__
        check_spaces(env, name)
        self.actions = space_actions(env.action_space)
        self.observation_shape = observation_shape(env, name)
        self.env = arrays_of(name, env)
        try:
            hash(jax.tree.structure(self.env))
        except TypeError as error:
            raise SwingupError(
                f"a static field of {name} has no hash, by which JAX compiles ({error}): make it a tuple"
            ) from None
        with blaming(f"{name}.step(state, action)"):
            check_steps(self, f"{name}.step")

    @property
    def named_after(self) -> Any:
        """The environment inside all wrappers."""
        return attribute(self.env, "unwrapped", self.env)

    @property
    def timed(self) -> tuple[Any, ...]:
        """The environment, then the one inside all wrappers."""
        return self.env, self.named_after

    def reset(self, key: Key) -> AdaptedState[Any]:
        """The first state of an episode."""
        state, info = self.env.init(key)
        return adapted_state(state, info.obs)

    def step(self, state: AdaptedState[Any], action: Action, key: Key) -> Step[AdaptedState[Any]]:
        """One step of the environment."""
        inner, info = self.env.step(state.inner, self.actions(action))
        return Step(
            state=adapted_state(inner, info.obs),
            observation=flat(info.obs),
            reward=jnp.asarray(info.reward, jnp.float32).reshape(()),
            terminated=jnp.asarray(info.terminated, bool).reshape(()),
            truncated=jnp.asarray(info.truncated, bool).reshape(()),
        )


def envelope_task(env: Any) -> EnvelopeTask | None:
    """A task for an environment with envelope's interface, or None.

    Raises:
        SwingupError: the environment has the interface and cannot be trained on.
    """
    if isinstance(env, AbstractTask) or not has_interface(env):
        return None
    return EnvelopeTask(env)
