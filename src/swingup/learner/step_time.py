"""The time of a step, by which a reward of a step becomes one of a second."""

import contextlib
import math
from typing import Any


def step_time(*timed: Any) -> float | None:
    """Seconds of one step: the attribute ``dt`` of the first that has it; None if none has.

    Gymnasium's MuJoCo tasks have it, and so have its Pendulum and Acrobot. Wrappers are asked first: one that
    repeats actions can have a ``dt`` of its own.

    Args:
        timed: an environment, a task, or its parameters.
    """
    for env in timed:
        # A figure for reports must not end a training, whatever a foreign property raises.
        with contextlib.suppress(Exception):
            find = getattr(env, "get_wrapper_attr", None)
            seconds = float(find("dt") if callable(find) else env.dt)
            if math.isfinite(seconds) and seconds > 0.0:
                return seconds
    return None
