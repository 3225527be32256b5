"""Environments of other packages as tasks: which adapter takes what."""

from typing import Any

from ..common.foreign import attribute
from .envelope_task import EnvelopeTask
from .gymnax_task import GymnaxTask
from .task import AbstractTask


def as_task(env: Any) -> Any:
    """A task for an environment of gymnax's or of envelope's interface; anything else as it is.

    An environment of gymnax's may come with its parameters in a pair, as ``gymnax.make`` returns them.
    """
    alone, params = env if isinstance(env, tuple) and len(env) == 2 else (env, None)
    if isinstance(alone, type | AbstractTask):
        return env
    # In Gymnasium and envelope the spaces are attributes, in gymnax they are methods.
    steps = _has_method(alone, "step") or _has_method(alone, "step_env")
    if steps and all(_has_method(alone, name) for name in ("reset", "action_space", "observation_space")):
        return GymnaxTask(alone, params)
    # Gymnasium's environments have no init.
    spaces = (attribute(env, name) for name in ("action_space", "observation_space"))
    if _has_method(env, "init") and _has_method(env, "step") and all(map(_is_space, spaces)):
        return EnvelopeTask(env)
    return env


def _has_method(env: Any, name: str) -> bool:
    return callable(attribute(env, name))


def _is_space(space: Any) -> bool:
    """Whether it has attributes of envelope's spaces: Discrete, Continuous, PyTreeSpace or BatchedSpace."""
    return any(attribute(space, name) is not None for name in ("n", "low", "tree", "batch_size"))
