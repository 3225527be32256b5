"""Gymnasium environments of all spaces and autoreset modes, in the one form that the learner steps.

Every step yields the observation to act on next (after a reset, where there was one), the true next observation
(before it), and whether the row counts. The resets of a vector environment follow its own mode:

- ``SAME_STEP``: it returns the first observation of the new episode; the true next one is in ``final_obs``.
- ``NEXT_STEP``: it returns the true next observation, and spends its next step on the reset: that row does not
  count. The new start is not known yet at the end of an episode. The previous start stands for it, another draw of
  the same distribution.
- ``DISABLED``: it resets those that ended when its ``reset`` is called with a mask.
"""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from jaxtyping import Bool, Float32, Shaped

from ..common.checks import whole_number
from ..common.errors import SwingupError
from ..common.foreign import attribute
from ..common.text import one_line, quoted
from ..tasks.task import Spaces
from .answers import Answers
from .made_environment import copies_of
from .step_time import step_time

MAKES_SENSE = (
    "a Gymnasium id, a function that makes a gymnasium.Env, a gymnasium.vector.VectorEnv, "
    "a gymnax or envelope environment, or a task in JAX"
)


@dataclass(frozen=True)
class HostStep:
    """The result of a step of all environments."""

    following: Float32[np.ndarray, "envs n"]
    """Observations to act on next."""
    true_next: Float32[np.ndarray, "envs n"]
    """Observations after the step and before any reset."""
    rewards: Float32[np.ndarray, "envs"]
    terminated: Bool[np.ndarray, "envs"]
    truncated: Bool[np.ndarray, "envs"]
    counted: Bool[np.ndarray, "envs"]
    """False where the environment did nothing but reset itself."""

    @property
    def ended(self) -> Bool[np.ndarray, "envs"]:
        """Where an episode ended."""
        return self.terminated | self.truncated


class Actions:
    """Converts the policy's actions to those of an action space, and knows their sizes.

    Box: entries in [-1, 1] are scaled to its bounds. Discrete, MultiDiscrete: integers count from its start.
    """

    def __init__(self, space: Any) -> None:
        """Read a space.

        Raises:
            SwingupError: it is none of the three, or a Box of integers or without bounds.
        """
        self._shape, self._dtype = attribute(space, "shape") or (), attribute(space, "dtype")
        self.size = int(np.prod(self._shape))
        if self.size == 0:
            raise SwingupError(f"actions {space} are empty: give them an entry")
        self.choices: tuple[int, ...] = ()
        if isinstance(space, Box) and not np.issubdtype(space.dtype, np.floating):
            raise SwingupError(f"actions {space} are whole numbers in a Box: make them a MultiDiscrete")
        if isinstance(space, Box):
            with np.errstate(over="ignore"):  # bounds whose difference overflows are no bounds either
                span = np.float32(space.high) - np.float32(space.low)
            if not np.isfinite(span).all():
                raise SwingupError(
                    f"actions {space} have no bounds to scale to: give them some in a "
                    f"gymnasium.wrappers.TransformAction"
                )
            self._low, self._high = space.low, space.high
        elif isinstance(space, Discrete | MultiDiscrete):
            self.choices = tuple(int(n) for n in np.ravel(space.n if isinstance(space, Discrete) else space.nvec))
            self._start = space.start
        else:
            raise SwingupError(f"actions {space} are not supported: use a bounded Box, Discrete or MultiDiscrete")

    def __call__(self, actions: Shaped[np.ndarray, "*b m"]) -> Shaped[np.ndarray, "..."]:
        """Actions of the space, with the same leading axes."""
        shaped = actions.reshape(*actions.shape[:-1], *self._shape)
        if self.choices:
            return shaped.astype(self._dtype) + self._start
        return (self._low + 0.5 * (shaped + 1.0) * (self._high - self._low)).astype(self._dtype)

    def describe(self) -> dict[str, Any]:
        """The entries of a policy file about the actions, as JSON values."""
        if self.choices:
            return {"action_start": np.asarray(self._start).tolist()}
        return {"action_low": self._low.tolist(), "action_high": self._high.tolist()}


class Environments:
    """Environments side by side, with flat observations in single precision."""

    def __init__(self, env: VectorEnv[Any, Any, Any], name: str | None = None) -> None:
        """Wrap a vector environment.

        Args:
            env: the vector environment.
            name: its name in messages; that of its class by default.

        Raises:
            SwingupError: its spaces or its autoreset mode are not supported.
        """
        name = type(env).__name__ if name is None else name
        space = attribute(env, "single_observation_space")
        if not isinstance(space, Box) or 0 in space.shape:
            what = "empty" if isinstance(space, Box) else "not a Box"
            raise SwingupError(
                f"observations {one_line(space, 200)} of {name} are {what}: wrap it in "
                "gymnasium.wrappers.FlattenObservation"
            )
        if np.issubdtype(space.dtype, np.uint8) and len(space.shape) > 1:
            raise SwingupError(
                f"observations {one_line(space, 200)} of {name} are images, which these networks cannot see: make "
                "features of them in a gymnasium.wrappers.TransformObservation, or say FlattenObservation"
            )
        metadata = attribute(env, "metadata")
        mode = metadata.get("autoreset_mode") if isinstance(metadata, dict) else metadata
        if not isinstance(mode, AutoresetMode):
            raise SwingupError(
                f"{name} says autoreset_mode = {quoted(mode)} in its metadata: it must be an AutoresetMode"
            )
        self.observation_space, self.actions = space, Actions(attribute(env, "single_action_space"))
        self.num_envs = whole_number(f"num_envs of {name}", attribute(env, "num_envs"), 1)
        self._answers = Answers(f"environment {name}", self.num_envs, space.shape)
        # Only environments of this process are asked: a worker process would not survive an attribute it lacks.
        self.step_time = step_time(env.envs[0] if isinstance(env, SyncVectorEnv) else env)
        self._env, self._mode = env, mode
        self._resetting = np.zeros(self.num_envs, np.bool_)
        self._starts = np.zeros((self.num_envs, self.spaces.observation_size), np.float32)

    @property
    def spaces(self) -> Spaces:
        """Sizes of the observations and the actions."""
        return Spaces(int(np.prod(self.observation_space.shape)), self.actions.size, self.actions.choices)

    @property
    def all_count(self) -> bool:
        """Whether no row is spent on a reset."""
        return self._mode is not AutoresetMode.NEXT_STEP

    def reset(self, seed: int) -> Float32[np.ndarray, "envs n"]:
        """Start new episodes in all environments, from a seed that fixes all later draws.

        Raises:
            SwingupError: an environment failed, or an observation is not finite or of another shape.
        """
        with _blaming("the environment failed in its reset"):
            answer = self._env.reset(seed=seed)
        self._resetting = np.zeros(self.num_envs, np.bool_)
        self._starts = self._answers.reset(answer)
        return self._starts.copy()

    def step(self, actions: Shaped[np.ndarray, "envs m"]) -> HostStep:
        """Take the policy's actions in all environments.

        Raises:
            SwingupError: an environment failed, or returned a value that is not finite or of another length, shape
                or kind.
        """
        counted = ~self._resetting
        chosen = self.actions(actions)
        with _blaming("the environment failed in a step"):
            answer = self._env.step(chosen)
        observations, rewards, terminated, truncated, infos = self._answers.step(answer)
        # A row that was spent on a reset belongs to no episode: it neither ends one nor earns a reward.
        terminated, truncated = terminated & counted, truncated & counted
        following, true_next = self._around_resets(observations, terminated | truncated, infos)
        rewards = np.where(counted, rewards, np.float32(0.0))
        return HostStep(following, true_next, rewards, terminated, truncated, counted)

    def _around_resets(
        self, seen: Float32[np.ndarray, "envs n"], ended: Bool[np.ndarray, "envs"], infos: Mapping[str, Any]
    ) -> tuple[Float32[np.ndarray, "envs n"], Float32[np.ndarray, "envs n"]]:
        """The observations to act on next and the true next ones, from those that a step returned."""
        if self._mode is AutoresetMode.NEXT_STEP:
            self._starts[self._resetting] = seen[self._resetting]
            self._resetting = ended
        if not ended.any():
            return seen, seen
        # Each mode returns one of the two observations; the other differs only where an episode ended.
        other = seen.copy()
        if self._mode is AutoresetMode.NEXT_STEP:
            other[ended] = self._starts[ended]
            return other, seen
        if self._mode is AutoresetMode.DISABLED:
            with _blaming("the environment failed in its reset"):
                # Gymnasium's option for vector environments that do not reset themselves.
                answer = self._env.reset(options={"reset_mask": ended})
            other[ended] = self._answers.reset(answer)[ended]
            return other, seen
        for index in np.flatnonzero(ended):
            other[index] = self._answers.final(infos, int(index))
        return seen, other

    def close(self) -> None:
        """Close the environments."""
        self._env.close()


def make_environments(env: Any, num_envs: int) -> Environments:
    """Environments from an id, from one that was made or a function that makes it, or from a vector environment.

    Raises:
        SwingupError: it is none of these, cannot be made, or its spaces are not supported.
    """
    if isinstance(env, VectorEnv):
        if env.num_envs != num_envs:
            raise SwingupError(
                f"num_envs = {num_envs}, but the vector environment has {env.num_envs}: make them equal"
            )
        return Environments(env)
    make = _maker(env)
    with _blaming(f"cannot make {num_envs} of {_short(env)}"):
        # SAME_STEP spends no row on a reset.
        several = SyncVectorEnv([lambda: _WithoutInfos(make())] * num_envs, autoreset_mode=AutoresetMode.SAME_STEP)
    try:
        return Environments(several, _short(env))
    except SwingupError:
        # The caller never sees these environments and cannot close them.
        several.close()
        raise


class _WithoutInfos(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment with empty infos: nobody reads them, and to merge those of several costs a tenth of a step."""

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """The environment's answer, as it is where it is none."""
        answer = self.env.step(action)
        return (*answer[:4], {}) if isinstance(answer, tuple) and len(answer) == 5 else answer


def _maker(env: Any) -> Callable[[], gymnasium.Env[Any, Any]]:
    """A function that makes one environment, tried once."""
    if isinstance(env, str):
        make: Callable[[], gymnasium.Env[Any, Any]] = lambda: gymnasium.make(env)  # noqa: E731
    elif isinstance(env, gymnasium.Env):
        make = copies_of(env)
    elif callable(env):
        make = env
    else:
        kind = type(env).__name__
        raise SwingupError(f"{kind} {_short(env)} cannot be trained on: use {MAKES_SENSE}")
    try:
        first = make()
    except SwingupError:
        raise
    except gymnasium.error.DependencyNotInstalled as error:
        raise SwingupError(f"{env}: {_short(error)}; for MuJoCo: pip install 'swingup[mujoco]'") from error
    except (Exception, SystemExit) as error:
        kind = "" if isinstance(error, gymnasium.error.Error) else f"{type(error).__name__}: "
        raise SwingupError(f"cannot make {quoted(env, 200)}: {kind}{_short(error)}; use {MAKES_SENSE}") from error
    if not isinstance(first, gymnasium.Env):
        raise SwingupError(f"{_short(env)} made a {type(first).__name__}: it must make a gymnasium.Env")
    with _blaming(f"cannot close {_short(env)}"):
        first.close()

    def another() -> gymnasium.Env[Any, Any]:
        made = make()
        if isinstance(made, gymnasium.Env) and made.unwrapped is first.unwrapped:
            raise SwingupError(f"{_short(env)} returns the same environment again: make a new one in each call")
        return made

    return another


@contextlib.contextmanager
def _blaming(what: str) -> Iterator[None]:
    """Turn an error of foreign code into one line."""
    try:
        yield
    # SystemExit too: an environment that calls sys.exit would end training without a message.
    except (Exception, SystemExit) as error:
        raise SwingupError(f"{what}: {type(error).__name__}: {_short(error)}; correct it and go on") from error


def _short(value: object) -> str:
    return one_line(value, 200)
