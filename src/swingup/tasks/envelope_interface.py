"""What an environment with envelope's interface offers, read before anything is traced."""

from typing import Any

import jax

from ..errors import SwingupError
from ..foreign import attribute, blaming
from ..text import one_line
from .adapted import shape_of_observation

LEAVE_OUT = {
    "final_valid": "resets itself: leave AutoResetWrapper out, the learner resets",
    "unnormalized_obs": "normalises by statistics that a reset would lose: leave ObservationNormalizationWrapper "
    "out, the learner normalises",
}
"""Entries of the information that only these wrappers add, and what to do about them."""


def has_interface(env: Any) -> bool:
    """Whether an object has the methods ``init`` and ``step``, and spaces as attributes.

    Gymnasium's environments have no ``init``, and gymnax's spaces are methods.
    """
    if isinstance(env, type) or not all(callable(attribute(env, name)) for name in ("init", "step")):
        return False
    return all(_is_space(attribute(env, name)) for name in ("action_space", "observation_space"))


def check_spaces(env: Any, name: str) -> None:
    """Refuse several environments in one, and spaces of several arrays.

    Raises:
        SwingupError: with the wrapper that helps.
    """
    if attribute(env.action_space, "batch_size") is not None:
        raise SwingupError(f"{name} is several environments in one: pass one alone, and num_envs to the learner")
    for what, space, wrappers in (
        ("actions", env.action_space, "FlattenActionWrapper"),
        ("observations", env.observation_space, "ContinuousObservationWrapper and FlattenObservationWrapper"),
    ):
        if attribute(space, "tree") is not None:
            shown = one_line(space, 100)
            raise SwingupError(f"{what} {shown} of {name} are several arrays: wrap it in envelope.{wrappers}")


def observation_shape(env: Any, name: str) -> tuple[int, ...]:
    """The shape of the observation, from a trace of ``init``.

    Raises:
        SwingupError: ``init`` fails or returns something else than state and information; a wrapper does what the
            learner does; or the observation is none that networks here can see.
    """
    with blaming(f"{name}.init(key)"):
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
    return shape_of_observation(info.obs, name, "init", "envelope.ContinuousObservationWrapper")


def _is_space(space: Any) -> bool:
    """Whether it has attributes of envelope's spaces: Discrete, Continuous, PyTreeSpace or BatchedSpace."""
    return any(attribute(space, name) is not None for name in ("n", "low", "tree", "batch_size"))
