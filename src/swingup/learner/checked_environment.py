"""Environments of users, checked: they return what Gymnasium's interface says, and answer in time."""

import copy
import multiprocessing
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv, VectorEnv

from ..common.errors import SwingupError, attribute, one_line, quoted

RESET = ("observations", "infos")
STEP = ("observations", "rewards", "terminated", "truncated", "infos")
"""What Gymnasium's methods return."""
PATIENCE = 60.0
"""How long the workers of an ``AsyncVectorEnv`` may take for a step or a reset (s)."""


def checked_vector(env: VectorEnv[Any, Any, Any]) -> VectorEnv[Any, Any, Any]:
    """The vector environment, with checks of what it is made of and a limit on how long it is waited for."""
    _refuse_normalisers(env)
    inner = env.unwrapped
    if isinstance(inner, AsyncVectorEnv):
        _limit_waiting(inner)
    if type(env) is not SyncVectorEnv:
        return env
    checked: Any = copy.copy(env)  # its owner's keeps its environments as they are
    checked.envs = list(map(CheckedEnvironment, checked.envs))
    return checked


def _limit_waiting(env: AsyncVectorEnv) -> None:
    """Stop workers that do not answer: Gymnasium would wait for them without end, and once more on closing."""

    def limited(wait: Callable[..., Any]) -> Callable[..., Any]:
        def waiting(timeout: float | None = None) -> Any:
            try:
                return wait(PATIENCE if timeout is None else timeout)
            except multiprocessing.TimeoutError:
                env.close(terminate=True)
                raise SwingupError(
                    f"a worker of {type(env).__name__} did not answer for {PATIENCE:g} s, and all were stopped: "
                    "correct the environment that hangs"
                ) from None

        return waiting

    for name in ("step_wait", "reset_wait"):
        setattr(env, name, limited(getattr(type(env), name).__get__(env)))


def _refuse_normalisers(env: Any) -> None:
    """Refuse wrappers that normalise by statistics that evaluations and policy files would lack."""
    while env is not None:
        fields = attribute(env, "__dict__", {})
        what = "observations" if "obs_rms" in fields else "rewards" if "return_rms" in fields else None
        if what is not None and attribute(env, "update_running_mean", True):
            itself = "the learner does that" if what == "observations" else "see the learner's normalise_rewards"
            raise SwingupError(
                f"{type(env).__name__} normalises {what} by statistics of its own, which an evaluation on other "
                f"environments lacks: leave it out ({itself}), or set its update_running_mean to False"
            )
        env = fields.get("env")


class CheckedEnvironment(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment that returns what Gymnasium's interface says.

    Its infos are empty: nobody reads them, and to merge those of several costs a tenth of a step.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        """Check an environment from now on."""
        _refuse_normalisers(env)
        super().__init__(env)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """The environment's first observation, without its infos."""
        try:
            returned = self.env.reset(seed=seed, options=options)
        except TypeError as error:
            if "unexpected keyword argument" not in str(error):
                raise
            raise SwingupError(
                f"reset() of {one_line(self.env, 100)} lacks an argument ({one_line(error, 100)}): Gymnasium's is "
                "reset(*, seed=None, options=None)"
            ) from error
        if not isinstance(returned, tuple) or len(returned) != len(RESET):
            raise self._fault("reset()", "", returned, "(observation, info)")
        self._check_observation("reset()", returned[0])
        return returned[0], {}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """The environment's step, without its infos."""
        returned, form = self.env.step(action), "(observation, reward, terminated, truncated, info)"
        if not isinstance(returned, tuple) or len(returned) != len(STEP):
            raise self._fault("step()", "", returned, form)
        observation, reward, terminated, truncated, _ = returned
        self._check_observation("step()", observation)
        if not _is_scalar(reward, "fiub"):
            raise self._fault("step()", "the reward ", reward, f"{form}, where the reward is a number")
        for name, end in (("terminated", terminated), ("truncated", truncated)):
            if not _is_scalar(end, "b"):
                raise self._fault("step()", f"{name} = ", end, f"{form}, where {name} is True or False")
        return observation, reward, bool(terminated), bool(truncated), {}

    def _check_observation(self, method: str, given: Any) -> None:
        shape = self.observation_space.shape
        # Without a shape the space is not a Box, which is refused elsewhere.
        if shape is not None and np.shape(given) != shape:
            raise self._fault(method, "the observation ", given, f"one of shape {shape}, as its observation_space")

    def _fault(self, method: str, what: str, given: Any, wanted: str) -> SwingupError:
        shape = getattr(given, "shape", None)
        shown = f"{what}{quoted(given)}" + (f" of shape {shape}" if shape else "")
        return SwingupError(f"{method} of {one_line(self.env, 100)} gave {shown}: Gymnasium's returns {wanted}")


def _is_scalar(given: Any, kinds: str) -> bool:
    """Whether a value is one number of NumPy's kinds; Python's and NumPy's own are told without a conversion."""
    kind = getattr(given, "dtype", None)
    if kind is None:
        return isinstance(given, bool) if kinds == "b" else isinstance(given, int | float)
    return getattr(given, "shape", None) == () and np.dtype(kind).kind in kinds
