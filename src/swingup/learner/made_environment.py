"""An environment that the caller has made already: more of the same, and its name.

Gymnasium keeps a record of how an environment was made: id, arguments and wrappers. Training needs several
environments and evaluation others again, so they are made from the record, and the object itself is not stepped.
What was changed on the object afterwards is not in the record; a line in the log names it where it shows.
"""

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium
from gymnasium.vector import VectorEnv

from ..common.errors import SwingupError
from ..common.foreign import attribute, blaming
from ..common.text import one_line, quoted

_LOGGER = logging.getLogger(__name__)

PASS_THE_FUNCTION = "pass the function that makes it, as in AREAPO(lambda: MyEnv(...))"


def copies_of(env: gymnasium.Env[Any, Any]) -> Callable[[], gymnasium.Env[Any, Any]]:
    """A function that makes environments by the record of this one, without its window.

    Raises:
        SwingupError: the environment has no record, as one that its class made.
    """
    record, name = attribute(env, "spec"), one_line(env, 200)
    if record is None:
        raise SwingupError(f"{name} was not made by gymnasium.make, so there is no second one: {PASS_THE_FUNCTION}")
    # One window is for people; eight of them and five for the evaluation are not.
    changed: dict[str, Any] = {"render_mode": None} if record.kwargs.get("render_mode") == "human" else {}

    def make() -> gymnasium.Env[Any, Any]:
        try:
            made = gymnasium.make(record, **changed)
        except Exception as error:
            reason = one_line(error, 200).rstrip(".")
            raise SwingupError(f"cannot make another {name} ({reason}): {PASS_THE_FUNCTION}") from error
        for space in ("observation_space", "action_space"):
            if getattr(made, space) != attribute(env, space):
                made.close()
                raise SwingupError(f"another {name} has another {space}: {PASS_THE_FUNCTION}")
        return made

    return make


def tell_changes(env: gymnasium.Env[Any, Any]) -> None:
    """Log a number or a word that was changed on the object: environments made by its record do not have it."""
    other = copies_of(env)()
    made = _plain_attributes(other)
    with blaming(f"the reset of {one_line(env, 200)}"):
        other.reset(seed=0)
    # What a reset sets is the state of an episode.
    begun = _plain_attributes(other)
    other.close()
    for name, value in _plain_attributes(env).items():
        if name in made and value not in (made[name], begun.get(name)):
            _LOGGER.warning(
                "%s = %s of %s was changed after it was made, and is %s in the environments to train on: %s",
                name, quoted(value), one_line(env, 200), quoted(made[name]), PASS_THE_FUNCTION,
            )  # fmt: skip
            return


def _plain_attributes(env: gymnasium.Env[Any, Any]) -> dict[str, Any]:
    mine = vars(attribute(env, "unwrapped"))
    return {
        name: value
        for name, value in mine.items()
        if isinstance(value, int | float | str) and not name.startswith("_")
    }


def id_of(env: Any) -> str | None:
    """The id that makes such an environment; None where it was made with arguments, wrapped or not by an id."""
    record = attribute(env, "spec") if isinstance(env, gymnasium.Env) else None
    if record is None or record.id not in gymnasium.registry:
        return None
    arguments = {name: value for name, value in record.kwargs.items() if name != "render_mode"}
    # By their texts: an array among the arguments has no single answer to ==.
    plain = repr(replace(record, kwargs=arguments)) == repr(gymnasium.spec(record.id))
    return record.id if plain else None


def num_envs_of(env: Any) -> int | None:
    """How many environments a vector environment has; None for anything else."""
    return env.num_envs if isinstance(env, VectorEnv) else None
