"""Environments of other packages as tasks: which adapter takes what."""

from typing import Any

from .envelope_task import envelope_task
from .gymnax_task import gymnax_task


def as_task(env: Any) -> Any:
    """A task for an environment of gymnax's or of envelope's interface; anything else as it is.

    Raises:
        SwingupError: the environment has one of these interfaces and cannot be trained on.
    """
    for adapt in (gymnax_task, envelope_task):
        task = adapt(env)
        if task is not None:
            return task
    return env
