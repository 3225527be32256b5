"""What an environment with gymnax's methods offers, read before anything is traced."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..errors import SwingupError
from ..foreign import attribute, blaming
from ..text import one_line, quoted


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


def arrays_of(name: str, params: Any) -> Any:
    """Parameters with arrays as leaves.

    Raises:
        SwingupError: a leaf is no number.
    """
    leaves, structure = jax.tree.flatten(params)
    try:
        return jax.tree.unflatten(structure, [jnp.asarray(leaf) for leaf in leaves])
    except (TypeError, ValueError):
        bad = next(leaf for leaf in leaves if not isinstance(leaf, bool | int | float | jax.Array | np.ndarray))
        raise SwingupError(
            f"parameters of {name} have a leaf {quoted(bad)}: give them numbers and arrays, in a pytree"
        ) from None


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
    shape = attribute(observation, "shape")
    if shape is None or 0 in shape:
        raise SwingupError(f"{name}.reset shows {one_line(observation, 100)}: make it one array with an entry")
    if observation.dtype == np.uint8 and len(shape) > 1:
        raise SwingupError(
            f"observations {one_line(space, 100)} of {name} are images, which these networks cannot see: "
            "show features of them, or say gymnax.wrappers.purerl.FlattenObservationWrapper"
        )
    return tuple(shape)
