"""Gymnax environments of the double pendulum: a thin adapter over this package's own tasks.

They have gymnax 1.0's methods and do not import gymnax. ``gymnax.register("Acrobot-swingup", factory)`` takes
``lambda: PendulumEnvironment("acrobot")`` as its factory.
"""

import dataclasses
import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .common.errors import SwingupError
from .common.types import Action, Count, Flag, Key, Observation, Scalar
from .plant.plant import PlantLike
from .tasks.pendulum import AbstractPendulumTask
from .tasks.presets import find_task

NO_LIMIT = 2**31 - 1
"""Steps of the tasks here: the limit is a parameter of the environment, where programs for gymnax look for it."""


class PendulumParams(eqx.Module):
    """Parameters of an environment: the numbers of its task, and its time limit."""

    task: AbstractPendulumTask  # The task: plant, reward, time step, noise
    max_steps_in_episode: int | Count  # Steps after which an episode is truncated

    def replace(self, **changes: Any) -> "PendulumParams":
        """Parameters with other values: ``params.replace(max_steps_in_episode=300)``."""
        return dataclasses.replace(self, **changes)


class PendulumEnvState(eqx.Module):
    """State of an environment."""

    inner: Any  # State of the task
    truncated: Flag
    """Whether the task truncated itself in the last step: at random, or because the integrator diverged."""
    time: Count  # Steps since the last reset


class Box(eqx.Module):
    """Arrays within [-1, 1]: gymnax's interface of a space."""

    shape: tuple[int, ...] = eqx.field(static=True)
    low: float = -1.0
    high: float = 1.0
    dtype: Any = eqx.field(static=True, default=jnp.float32)

    def sample(self, key: Key) -> Float[Array, "..."]:
        """A random element."""
        return jax.random.uniform(key, self.shape, self.dtype, self.low, self.high)

    def contains(self, x: Float[Array, "..."]) -> Flag:
        """Whether all entries are within the bounds."""
        return jnp.all((x >= self.low) & (x <= self.high))


class PendulumEnvironment:
    """One double pendulum with gymnax's methods; ``vmap`` makes many of it.

    Actions in [-1, 1] scale the torque limit of the driven joint and are clipped. The task is continuing: episodes
    are truncated and never terminate.

    Example:
        >>> import jax
        >>> from swingup.gymnax import PendulumEnvironment
        >>> env = PendulumEnvironment("acrobot")
        >>> params = env.default_params
        >>> observation, state = env.reset(jax.random.key(0), params)
        >>> env.action_space(params).shape
        (1,)
    """

    default_params: PendulumParams
    """The parameters of the task that was named."""
    name: str
    """Name of the environment."""
    dt: float
    """Time of a step of the task that was named (s)."""
    num_actions: int
    """Length of an action."""

    def __init__(
        self, robot: str, task: str | AbstractPendulumTask = "paper", plant: PlantLike | None = None
    ) -> None:
        """Prepare an environment; the arguments are those of :class:`swingup.gym.PendulumEnv`.

        Raises:
            SwingupError: there is no such robot, task or plant, or the task is another robot's, or a task that was
                passed in comes with a plant.
        """
        chosen = find_task(task, robot, plant)
        if not isinstance(chosen, AbstractPendulumTask):
            raise SwingupError(f"{type(chosen).__name__} is not in gymnax's form: pass it to swingup.AREAPO")
        self.default_params = PendulumParams(dataclasses.replace(chosen, max_steps=NO_LIMIT), chosen.max_steps)
        self.name = f"swingup/{chosen.robot.name.capitalize()}"
        self.dt = float(chosen.dt)
        self.num_actions = chosen.action_size

    def action_space(self, params: PendulumParams | None = None) -> Box:
        """Numbers in [-1, 1]."""
        return Box((self.num_actions,))

    def observation_space(self, params: PendulumParams | None = None) -> Box:
        """Scaled angles and rates, within [-1, 1] as long as the rates stay within their scale."""
        return Box((self.default_params.task.observation_size,))

    @functools.partial(jax.jit, static_argnames=("self",))
    def reset(self, key: Key, params: PendulumParams | None = None) -> tuple[Observation, PendulumEnvState]:
        """Start an episode."""
        return self.reset_env(key, self.default_params if params is None else params)

    @functools.partial(jax.jit, static_argnames=("self",))
    def step(
        self, key: Key, state: PendulumEnvState, action: Action, params: PendulumParams | None = None
    ) -> tuple[Observation, PendulumEnvState, Scalar, Flag, Flag, dict[str, Any]]:
        """Hold an action for the task's dt; an episode that ends is reset in the same step.

        Returns:
            Observation and state after the reset, reward, terminated, truncated, and information, in which
            ``final_observation`` is from before the reset.
        """
        params = self.default_params if params is None else params
        step_key, reset_key = jax.random.split(key)
        last, after, reward, terminated, info = self.step_env(step_key, state, action, params)
        truncated = self.is_truncated(after, params)
        ended = terminated | truncated
        observation, following = jax.tree.map(
            lambda new, old: jnp.where(ended, new, old), self.reset_env(reset_key, params), (last, after)
        )
        info |= {"terminated": terminated, "truncated": truncated, "final_observation": last}
        return observation, following, reward, terminated, truncated, info

    def reset_env(self, key: Key, params: PendulumParams) -> tuple[Observation, PendulumEnvState]:
        """Start an episode."""
        inner = params.task.reset(key)
        return params.task.observe(inner), PendulumEnvState(inner, jnp.array(False), jnp.array(0))

    def step_env(
        self, key: Key, state: PendulumEnvState, action: Action, params: PendulumParams
    ) -> tuple[Observation, PendulumEnvState, Scalar, Flag, dict[str, Any]]:
        """Hold an action for the task's dt; nothing is reset."""
        step = params.task.step(state.inner, jnp.clip(jnp.reshape(action, (self.num_actions,)), -1.0, 1.0), key)
        after = PendulumEnvState(step.state, step.truncated, state.time + 1)
        return step.observation, after, step.reward, step.terminated, {"discount": 1.0 - step.terminated}

    def observe(
        self, key: Key, state: PendulumEnvState, action: Action | None, params: PendulumParams
    ) -> Observation:
        """What the agent sees of a state."""
        return params.task.observe(state.inner)

    def is_truncated(self, state: PendulumEnvState, params: PendulumParams) -> Flag:
        """Whether the last step was truncated by the task, or reached the limit."""
        return state.truncated | (state.time >= params.max_steps_in_episode)

    def is_terminated(self, state: PendulumEnvState, params: PendulumParams) -> Flag:
        """False: the task is continuing."""
        return jnp.array(False)
