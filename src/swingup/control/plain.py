"""Controllers in plain Python: functions of (x, t), and objects with RealAIGym's ``get_control_output(x, t)``."""

import copy
import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from ..errors import SwingupError

Answer = Callable[[np.ndarray, float], Any]


class PlainController:
    """A controller that is run as it is, one call after another.

    Its memory, if any, is cleared by its own ``reset()`` and ``init()``, in this order, where it has them.
    """

    def __init__(self, source: Any) -> None:
        """Wrap a function or an object.

        Raises:
            SwingupError: it is neither callable nor has it ``get_control_output``.
        """
        if not callable(getattr(source, "get_control_output", source)) or inspect.isclass(source):
            raise SwingupError(
                f"{source!r} is no controller: pass a function of (x, t), an object with get_control_output(x, t), "
                "or a swingup controller"
            )
        self.source = source

    def start(self) -> Answer:
        """Clear the memory and return what to call with x (4,) (rad, rad/s) and t (s)."""
        for name in ("reset", "init"):
            method = getattr(self.source, name, None)
            if callable(method):
                method()
        return getattr(self.source, "get_control_output", self.source)

    def copies(self, number: int) -> "list[PlainController]":
        """Independent controllers for simulations side by side; just this one where it cannot be copied."""
        try:
            return [self, *(PlainController(copy.deepcopy(self.source)) for _ in range(number - 1))]
        except Exception:  # whatever a foreign object's copying raises
            return [self]


def answer(call: Answer, x: np.ndarray, t: float) -> np.ndarray:
    """One call, checked: the torques [u1, u2] (N m) as float64.

    Raises:
        SwingupError: the controller raised an error, or its answer is not two finite numbers.
    """
    try:
        given = call(x.copy(), t)
    except Exception as error:
        reason = " ".join(str(error).split())
        raise SwingupError(f"it raised {type(error).__name__} ({reason}) at t = {t:g} s: mend it there") from error
    try:
        u = np.asarray(given, np.float64)
    except (TypeError, ValueError):
        u = np.empty(0)
    if u.shape != (2,):
        shape = f"of shape {u.shape}" if u.size else f"{given!r:.60}"
        raise SwingupError(f"its torque at t = {t:g} s is {shape}: return two numbers [u1, u2] in N m")
    if not np.isfinite(u).all():
        raise SwingupError(f"it gave a torque that is not finite at t = {t:g} s: mend it there")
    return u
