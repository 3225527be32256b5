"""Checks of what foreign vector environments return, before the learner receives it.

NumPy broadcasts a reward of the wrong length, and turns a text into a number and None into NaN: training would
continue with values that no environment meant.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32

from ..common.errors import SwingupError
from ..common.text import quoted

RESET = ("observations", "infos")
STEP = ("observations", "rewards", "terminated", "truncated", "infos")


@dataclass(frozen=True)
class Answers:
    """Reads the answers of one vector environment.

    All methods raise a ``SwingupError`` that names the environment and the value, if the value has another length,
    shape or kind, or is not finite in single precision.
    """

    name: str
    num_envs: int
    shape: tuple[int, ...]
    """Shape of one observation."""

    def reset(self, answer: Any) -> Float32[np.ndarray, "envs n"]:
        """The observations of a reset, flat."""
        observations, _ = self._parts("reset()", answer, RESET)
        return self.observations("reset()", observations)

    def step(
        self, answer: Any
    ) -> tuple[
        Float32[np.ndarray, "envs n"],
        Float32[np.ndarray, "envs"],
        Bool[np.ndarray, "envs"],
        Bool[np.ndarray, "envs"],
        Mapping[str, Any],
    ]:
        """Flat observations, rewards, where episodes terminated and were truncated, and the infos of a step."""
        observations, rewards, terminated, truncated, infos = self._parts("step()", answer, STEP)
        if not isinstance(infos, Mapping):
            raise SwingupError(f"{self.name} gave infos {quoted(infos)} in a step(): return a dict")
        each = (self.num_envs,)
        return (
            self.observations("step()", observations),
            self._single("step()", "rewards", rewards, each),
            self._array("step()", "terminated", terminated, each, "b"),
            self._array("step()", "truncated", truncated, each, "b"),
            infos,
        )

    def observations(self, where: str, given: Any) -> Float32[np.ndarray, "envs n"]:
        """Observations of all environments, flat."""
        return self._single(where, "observations", given, (self.num_envs, *self.shape)).reshape(self.num_envs, -1)

    def final(self, infos: Mapping[str, Any], index: int) -> Float32[np.ndarray, "n"]:
        """The last observation of an environment that was reset in the same step."""
        try:
            given = infos["final_obs"][index]
        except (LookupError, TypeError) as error:
            raise SwingupError(
                f"{self.name} resets in the same step and gives no final_obs[{index}] in its infos: add it"
            ) from error
        return self._single("step()", "final_obs", given, self.shape).reshape(-1)

    def _parts(self, where: str, answer: Any, names: tuple[str, ...]) -> tuple[Any, ...]:
        if not isinstance(answer, tuple) or len(answer) != len(names):
            raise SwingupError(f"{self.name} gave {quoted(answer)} in a {where}: return ({', '.join(names)})")
        return answer

    def _single(self, where: str, what: str, given: Any, shape: tuple[int, ...]) -> Any:
        """Finite numbers in single precision."""
        array = self._array(where, what, given, shape, "fiub")
        with np.errstate(over="ignore"):  # an overflow is an infinity, which is refused below
            # Also a copy: environments may use their buffers again.
            single = array.astype(np.float32)
        if not np.isfinite(single).all():
            bad = array[~np.isfinite(single)][0]
            raise SwingupError(f"{self.name} gave {what} that are not finite in a {where}, {bad}: correct it there")
        return single

    def _array(self, where: str, what: str, given: Any, shape: tuple[int, ...], kinds: str) -> np.ndarray:
        try:
            array = np.asarray(given)
        except Exception as error:  # ragged lists, and what a foreign __array__ raises
            raise SwingupError(f"{self.name} gave {what} {quoted(given)} in a {where}: return an array") from error
        if array.dtype.kind not in kinds:
            # Numbers are refused as flags: any value that is not 0 would count as an end.
            wanted = "booleans" if kinds == "b" else "numbers"
            raise SwingupError(
                f"{self.name} gave {what} {quoted(given)} of kind {array.dtype} in a {where}: return {wanted}"
            )
        if array.shape != shape:
            raise SwingupError(f"{self.name} gave {what} of shape {array.shape} in a {where}: return shape {shape}")
        return array
