"""Environments of other packages as tasks: which adapter takes what."""

from typing import Any

from ..common.errors import attribute
from .brax_task import BraxTask
from .envelope_task import EnvelopeTask
from .gymnax_task import GymnaxTask
from .task import AbstractTask


def as_task(env: Any) -> Any:
    """A task for an environment with the methods of gymnax, envelope or brax; anything else as it is.

    An environment of gymnax's may come with its parameters in a pair, as ``gymnax.make`` returns them.
    """
    alone, params = env if isinstance(env, tuple) and len(env) == 2 else (env, None)
    if isinstance(alone, type | AbstractTask):
        return env
    # In Gymnasium and envelope the spaces are attributes, in gymnax they are methods.
    if _has_methods(alone, "reset", "action_space", "observation_space"):
        return GymnaxTask(alone, params)
    # Gymnasium's environments have no init.
    if _has_methods(env, "init", "step") and attribute(env, "action_space") is not None:
        return EnvelopeTask(env)
    # A policy's number of actions is an attribute of brax's environments alone.
    if _has_methods(env, "reset", "step") and attribute(env, "action_size") is not None:
        return BraxTask(env)
    return env


def _has_methods(env: Any, *names: str) -> bool:
    return all(callable(attribute(env, name)) for name in names)
