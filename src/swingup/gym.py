"""Gymnasium environments of the double pendulum: a thin adapter over this package's own task.

Importing this module registers ``swingup/Acrobot-v0`` and ``swingup/Pendubot-v0``, and dm_control's acrobot as
``swingup/AcrobotSwingup-v0`` and ``swingup/AcrobotSwingupSparse-v0``. An id may also name the module:
``gymnasium.make("swingup.gym:swingup/Acrobot-v0")``. ``gymnasium.make_vec`` gives one compiled batch of them.
The task is continuing: it truncates itself at random and by its limit, never terminates, and needs no TimeLimit.
"""

from typing import Any

import equinox as eqx
import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from jaxtyping import Bool, Float, Float32, UInt8

from . import continuing  # noqa: F401 (registers its ids)
from .common.checks import whole_number
from .common.errors import SwingupError, quoted
from .common.types import Action, Key, Observation, State, fetch
from .drawing import draw_frame
from .plant.plant import ROBOTS, PlantLike
from .tasks.acrobot_swingup import IDS, AcrobotSwingup
from .tasks.pendulum import DIVERGED_VELOCITY, AbstractPendulumTask, PendulumState
from .tasks.presets import AnyPendulumTask, find_task
from .tasks.task import Step

RENDER_MODES = ["rgb_array"]


class Episode(eqx.Module):
    """The state of one environment between steps."""

    state: PendulumState  # State of the task
    action: Action  # The last action, 0 after a reset
    key: Key  # The key of all later draws


class Pendulums:
    """What one environment and a batch have in common; one is a batch of 1 to JAX."""

    metadata: dict[str, Any] = {"render_modes": RENDER_MODES, "render_fps": 100}  # noqa: RUF012 (as gymnasium has it)
    task: AnyPendulumTask
    np_random: Any  # Gymnasium's generator, from which the first key comes without a seed
    _count = 1
    _episodes: Episode | None = None

    @property
    def dt(self) -> float:
        """Time of a step (s)."""
        return float(self.task.dt)

    def _prepare(
        self, robot: str, task: str | AnyPendulumTask, render_mode: str | None, plant: PlantLike | None
    ) -> tuple[Box, Box]:
        """Set all but the spaces; return those of one environment's observations and actions."""
        # With its numbers as arrays, which compiled functions take faster.
        self.task = jax.tree.map(jnp.asarray, find_task(task, robot, plant))
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise SwingupError(f"unknown render_mode {quoted(render_mode)}: use {', '.join(RENDER_MODES)} or None")
        self.render_mode = render_mode
        # A dict of its own: the class's is shared, and the rate follows the task.
        self.metadata = {**self.metadata, "render_fps": round(1 / self.dt)}
        # Only the robots' own tasks bound the velocities.
        bound = 1.0 if isinstance(self.task, AbstractPendulumTask) else np.inf
        return Box(-bound, bound, (self.task.observation_size,)), Box(-1.0, 1.0, (self.task.action_size,))

    def _start(
        self, seed: int | None, options: dict[str, Any] | None
    ) -> tuple[Float32[np.ndarray, "envs n"], Float32[np.ndarray, "envs 4"]]:
        start = _checked_start(options)
        if seed is not None:  # the last one's must fit the 32 bits that JAX has: it would cut larger ones
            seed = whole_number("seed", seed, 0, 2**32 - self._count)
        super().reset(seed=seed)  # type: ignore[misc]  # that of gymnasium's class beside this one
        if seed is None and self._episodes is not None:
            keys = self._episodes.key
        else:
            first = int(self.np_random.integers(2**32 - self._count, endpoint=True)) if seed is None else seed
            keys = _keys(np.arange(first, first + self._count, dtype=np.uint32))
        self._episodes, observations = _begin(self.task, keys, start)
        # np.array copies: JAX's memory is read-only, and callers may write to what they receive.
        return np.array(observations, np.float32), np.array(self._episodes.state.x)

    def _running(self) -> Episode:
        if self._episodes is None:
            raise SwingupError("the environment was never reset: call reset() before step() or render()")
        return self._episodes

    def _pictures(self) -> tuple[UInt8[np.ndarray, "400 400 3"], ...] | None:
        if self.render_mode is None:
            return None
        episodes, parameters = self._running(), self.task.parameters
        lengths = float(parameters.l1), float(parameters.l2)
        limit, joint = float(max(parameters.tl1, parameters.tl2)), self.task.robot.joint
        pairs = zip(np.asarray(episodes.state.x), np.asarray(episodes.action), strict=True)
        return tuple(
            draw_frame(x, *lengths, torque=np.asarray(self.task.torque(action)), driven=joint, limit=limit)
            for x, action in pairs
        )


class PendulumEnv(Pendulums, gymnasium.Env[np.ndarray, np.ndarray]):
    """One double pendulum; its observations, rewards and truncations are those of an :class:`AbstractPendulumTask`.

    Actions in [-1, 1] scale the torque limit of the driven joint and are clipped. ``info["state"]`` is
    [q1, q2, dq1, dq2] (rad, rad/s). The seed of a reset is that of the JAX key from which all randomness follows.
    """

    def __init__(
        self,
        robot: str,
        task: str | AnyPendulumTask = "paper",
        render_mode: str | None = None,
        plant: PlantLike | None = None,
    ) -> None:
        """Prepare an environment, to be reset before its first step.

        Args:
            robot: ``acrobot`` or ``pendubot``.
            task: name of a variant of the task, see :data:`swingup.tasks.presets.TASKS`, or a task.
            render_mode: ``rgb_array`` for pictures from ``render``; ``None`` for none.
            plant: the pendulum, in whose units a named task is: a plant, its name or its file; None for the
                leaderboards'.

        Raises:
            SwingupError: there is no such robot, task, plant or render mode, or the task is another robot's, or a
                task that was passed in comes with a plant.
        """
        self.observation_space, self.action_space = self._prepare(robot, task, render_mode, plant)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32[np.ndarray, "n"], dict[str, Any]]:
        """Start an episode, hanging down with the task's noise, or in the state that ``options`` gives.

        Args:
            seed: makes this and all later draws repeatable; without it they continue from the last.
            options: ``{"state": [q1, q2, dq1, dq2]}`` (rad, rad/s) sets the state to start from.

        Raises:
            SwingupError: the seed or an option is invalid.
        """
        observations, states = self._start(seed, options)
        return observations[0], {"state": states[0]}

    def step(self, action: np.ndarray) -> tuple[Float32[np.ndarray, "n"], float, bool, bool, dict[str, Any]]:
        """Hold an action (shape (1,), in [-1, 1]) for the task's dt.

        Raises:
            SwingupError: the action is not finite or of another shape, or ``reset`` was never called.
        """
        action = _checked_actions(action, (1,))
        self._episodes, step = _advance(self.task, self._running(), action[None])
        step = fetch(step)
        observation, info = np.array(step.observation[0], np.float32), {"state": np.array(step.state.x[0])}
        return observation, float(step.reward[0]), bool(step.terminated[0]), bool(step.truncated[0]), info

    def render(self) -> UInt8[np.ndarray, "400 400 3"] | None:
        """Draw the current state and the last torque; ``None`` without a render mode.

        Raises:
            SwingupError: ``reset`` was never called, or Pillow is not installed.
        """
        pictures = self._pictures()
        return None if pictures is None else pictures[0]


class PendulumVectorEnv(Pendulums, VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Many double pendulums in one compiled step; an episode that ends is reset in that same step.

    Its environment ``i``, reset with a seed, is :class:`PendulumEnv` reset with ``seed + i``, as in gymnasium's
    ``SyncVectorEnv``. As there, ``info["final_obs"]`` and ``info["final_info"]`` hold what a reset replaced:
    bootstrap from ``final_obs``.
    """

    metadata: dict[str, Any] = {**Pendulums.metadata, "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(
        self,
        robot: str,
        num_envs: int = 1,
        task: str | AnyPendulumTask = "paper",
        render_mode: str | None = None,
        plant: PlantLike | None = None,
    ) -> None:
        """Prepare ``num_envs`` environments; the other arguments are those of :class:`PendulumEnv`.

        Raises:
            SwingupError: ``num_envs`` is not positive, or as :class:`PendulumEnv`.
        """
        self.num_envs = self._count = whole_number("num_envs", num_envs, 1)
        self.single_observation_space, self.single_action_space = self._prepare(robot, task, render_mode, plant)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32[np.ndarray, "envs n"], dict[str, Any]]:
        """Start all episodes; the arguments and errors are those of :meth:`PendulumEnv.reset`."""
        observations, states = self._start(seed, options)
        return observations, self._infos(states)

    def step(
        self, actions: np.ndarray
    ) -> tuple[
        Float32[np.ndarray, "envs n"],
        Float[np.ndarray, "envs"],
        Bool[np.ndarray, "envs"],
        Bool[np.ndarray, "envs"],
        dict[str, Any],
    ]:
        """Hold one action each (shape (num_envs, 1), in [-1, 1]) for the task's dt; reset those that end.

        Raises:
            SwingupError: an action is not finite, their shape is another, or ``reset`` was never called.
        """
        actions = _checked_actions(actions, (self.num_envs, 1))
        self._episodes, observations, step = _advance_and_reset(self.task, self._running(), actions)
        step = fetch(step)
        infos: dict[str, Any] = {}
        for index in np.flatnonzero(step.terminated | step.truncated).tolist():
            final_info = {"state": np.array(step.state.x[index])}
            final = {"final_obs": np.array(step.observation[index], np.float32), "final_info": final_info}
            # Gymnasium's own way to merge infos, so that the masks are those of its vector environments.
            infos = self._add_info(infos, final, index)
        return (
            np.array(observations, np.float32),
            np.array(step.reward, np.float64),
            np.array(step.terminated),
            np.array(step.truncated),
            infos | self._infos(np.array(self._episodes.state.x)),
        )

    def render(self) -> tuple[UInt8[np.ndarray, "400 400 3"], ...] | None:
        """One picture of each environment; otherwise as :meth:`PendulumEnv.render`."""
        return self._pictures()

    def _infos(self, states: Float32[np.ndarray, "envs 4"]) -> dict[str, Any]:
        return {"state": states, "_state": np.ones(self.num_envs, np.bool_)}


def begin(task: AnyPendulumTask, key: Key, start: State | None) -> tuple[Episode, Observation]:
    """Reset an environment, to the state ``start`` if there is one."""
    reset_key, next_key = jax.random.split(key)
    state = task.reset(reset_key) if start is None else PendulumState(x=start, steps=jnp.array(0))
    return Episode(state=state, action=jnp.zeros(task.action_size), key=next_key), task.observe(state)


def advance(task: AnyPendulumTask, episode: Episode, action: Action) -> tuple[Episode, Step[PendulumState]]:
    """Step an environment; an episode that ends is not reset."""
    step_key, next_key = jax.random.split(episode.key)
    step = task.step(episode.state, action, step_key)
    return Episode(state=step.state, action=action, key=next_key), step


def advance_and_reset(
    task: AnyPendulumTask, episode: Episode, action: Action
) -> tuple[Episode, Observation, Step[PendulumState]]:
    """Step an environment and reset it if it ends; the step is from before the reset, the rest from after it."""
    after, step = advance(task, episode, action)
    # Drawn at every step: under vmap a condition would compute both branches anyway.
    fresh, observation = begin(task, after.key, None)
    ended = step.terminated | step.truncated
    episode, observation = jax.tree.map(
        lambda new, old: jnp.where(ended, new, old), (fresh, observation), (after, step.observation)
    )
    return episode, observation, step


# Compiled once for all environments of a kind: the task's numbers are arguments.
_begin = jax.jit(jax.vmap(begin, in_axes=(None, 0, None)))
_advance = jax.jit(jax.vmap(advance, in_axes=(None, 0, 0)))
_advance_and_reset = jax.jit(jax.vmap(advance_and_reset, in_axes=(None, 0, 0)))
_keys = jax.jit(jax.vmap(jax.random.key))


def _checked_start(options: dict[str, Any] | None) -> Float[np.ndarray, "4"] | None:
    if not options:
        return None
    unknown = [name for name in options if name != "state"]
    if unknown:
        raise SwingupError(f"unknown reset option {quoted(unknown[0])}: use 'state' alone")
    try:
        start = np.asarray(options["state"], np.float64)
        valid = start.shape == (4,) and bool(np.all(np.abs(start) < DIVERGED_VELOCITY))
    except (TypeError, ValueError):
        valid = False
    if not valid:
        shown = quoted(options["state"])
        raise SwingupError(
            f"state {shown} must be [q1, q2, dq1, dq2], 4 numbers within ±{DIVERGED_VELOCITY:g} (rad, rad/s)"
        )
    return start


def _checked_actions(actions: Any, shape: tuple[int, ...]) -> Float32[np.ndarray, "..."]:
    try:
        values = np.asarray(actions, np.float64)
    except (TypeError, ValueError):
        raise SwingupError(f"action {quoted(actions)} is not numeric: pass shape {shape} in [-1, 1]") from None
    if values.shape != shape:
        raise SwingupError(f"action has shape {values.shape}: pass shape {shape}, entries in [-1, 1]")
    if not np.isfinite(values).all():
        bad = values[~np.isfinite(values)][0]
        raise SwingupError(f"action {bad} is not finite: pass numbers in [-1, 1]")
    return np.clip(values, -1.0, 1.0).astype(np.float32)


for _robot in ROBOTS:
    gymnasium.register(
        id=f"swingup/{_robot.capitalize()}-v0",
        entry_point=f"{__name__}:PendulumEnv",
        vector_entry_point=f"{__name__}:PendulumVectorEnv",
        kwargs={"robot": _robot},
    )


def acrobot_swingup(sparse: bool = False, **arguments: Any) -> PendulumEnv:
    """dm_control's acrobot as an environment; if ``sparse``, steps earn nothing outside the target."""
    return PendulumEnv("acrobot", AcrobotSwingup(sparse=sparse), **arguments)


for _id, _sparse in IDS.items():
    gymnasium.register(id=_id, entry_point=f"{__name__}:acrobot_swingup", kwargs={"sparse": _sparse})
