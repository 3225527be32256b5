"""What an environment with gymnax's methods offers, read before anything is traced."""

from typing import Any

import jax

from ..errors import SwingupError
from ..foreign import attribute, blaming
from ..text import one_line
from .adapted import shape_of_observation


def resets_itself(env: Any) -> bool:
    """Whether ``step`` is more than ``step_env`` followed by a reset.

    It is not where a base class defines ``step`` and a class further down the methods that it calls. A wrapper
    defines its own ``step`` and has ``step_env`` only from what it wraps, whose states are others than its own.
    """
    kinds = type(env).__mro__
    homes = [next((i for i, kind in enumerate(kinds) if name in vars(kind)), None) for name in ("step_env", "step")]
    special, general = homes
    has_limit = any("is_truncated" in vars(kind) for kind in kinds)
    return special is None or not has_limit or (general is not None and general <= special)


def observation_shape(env: Any, name: str, given: Any, params: Any) -> tuple[int, ...]:
    """The shape of the observation, which must be one array in a box.

    Args:
        env: the environment.
        name: its name in messages.
        given: its parameters, for its spaces.
        params: the same as arrays, for its ``reset``.

    Raises:
        SwingupError: it is something else, or a method fails.
    """
    with blaming(f"{name}.observation_space(params)"):
        space = env.observation_space(given)
    if any(attribute(space, bound) is None for bound in ("low", "high")):
        raise SwingupError(
            f"observations {one_line(space, 100)} of {name} are no Box: wrap it so that it shows one array"
        )
    with blaming(f"{name}.reset(key, params)"):
        observation, _ = jax.eval_shape(env.reset, jax.random.key(0), params)
    return shape_of_observation(observation, name, "reset", "gymnax.wrappers.purerl.FlattenObservationWrapper")
