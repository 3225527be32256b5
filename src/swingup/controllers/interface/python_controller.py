"""Controllers in plain Python: functions of (x, t), and objects with RealAIGym's ``get_control_output(x, t)``."""

import copy
import inspect
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...common.errors import SwingupError, attribute, described, errors_named_after, quoted

Answer = Callable[[np.ndarray, float], Any]

DT = 0.002
"""Time between the calls of a trial (s)."""


class PythonController:
    """A controller in plain Python, called once a step.

    Its memory, if any, is cleared by its own ``reset()`` and ``init()``, in this order, where it has them.
    """

    def __init__(self, source: Any) -> None:
        # A class is callable, too, but a call of it makes an object.
        if inspect.isclass(source) or not callable(attribute(source, "get_control_output", source)):
            raise SwingupError(
                f"{quoted(source)} is not a controller: pass a function of (x, t), an object with "
                "get_control_output(x, t), or a swingup controller"
            )
        self.source = source
        self.robot = attribute(source, "robot")

    def start(self) -> Answer:
        """Clear the memory and return what to call with x (4,) (rad, rad/s) and t (s)."""
        for name in ("reset", "init"):
            method = attribute(self.source, name)
            if callable(method):
                with errors_named_after(f"its {name}()"):
                    method()
        return _by_keywords(attribute(self.source, "get_control_output", self.source))

    def copies(self, number: int) -> "list[PythonController]":
        """Independent controllers for simulations side by side; just this one where it has none."""
        try:
            with errors_named_after("its copying"):
                made = [self, *(PythonController(copy.deepcopy(self.source)) for _ in range(number - 1))]
        except SwingupError:
            return [self]
        # Two of them tell: all copies are made in the same way.
        return made if number == 1 or are_independent(made[:2]) else [self]


def answer(call: Answer, x: np.ndarray, t: float) -> np.ndarray:
    """One call, checked: the torques [u1, u2] (N m) as float64."""
    try:
        given = call(x.copy(), t)
        u = np.asarray(given)
    # A SwingupError already names its fault.
    except (KeyboardInterrupt, SwingupError):
        raise
    except BaseException as error:  # no context manager: this is called millions of times
        raise SwingupError(f"it raised {described(error)} at t = {t:g} s: correct it there") from error
    if u.shape != (2,) or u.dtype.kind not in "fiub":
        what = f"of shape {u.shape}" if u.dtype.kind in "fiub" else quoted(given)
        raise SwingupError(f"its torque at t = {t:g} s is {what}: return two real numbers [u1, u2] in N m")
    if not np.isfinite(u).all():
        raise SwingupError(f"it gave a torque that is not finite at t = {t:g} s: correct it there")
    return u.astype(np.float64)


def call_in_turn(controllers: Sequence[PythonController], states: np.ndarray) -> list[np.ndarray]:
    """Start controllers anew and call them in turn, state by state (n, 4); the answers (n, 2) of each."""
    calls = [controller.start() for controller in controllers]
    answers = [[answer(call, x, step * DT) for call in calls] for step, x in enumerate(states)]
    return [np.array([row[index] for row in answers]) for index in range(len(calls))]


def are_independent(controllers: Sequence[PythonController]) -> bool:
    """Whether copies of a controller that are called in turn answer as one that is called alone.

    Copies that share a memory (a closure, a global, a class attribute) answer differently. Copies that fail count
    as independent: they share nothing that matters.
    """
    states = trial_states()
    try:
        alone = call_in_turn(controllers[:1], states)[0]
        return all(np.array_equal(each, alone) for each in call_in_turn(controllers, states))
    except SwingupError:
        return True


def trial_states() -> np.ndarray:
    """States (n, 4) to try a controller on: hanging, upright, full turns away, fast, then random."""
    pi = np.pi
    chosen = [[0, 0, 0, 0], [pi, 0, 0, 0], [-pi, 2 * pi, 0, 0], [3, -7, 20, -20], [pi, 0, 30, 30]]
    random = np.random.default_rng(0).uniform(-1, 1, (27, 4)) * [2 * pi, 2 * pi, 20, 20]
    return np.concatenate([np.array(chosen, np.float64), random])


def _by_keywords(call: Callable[..., Any]) -> Answer:
    """The call by the names x and t where it has both, as RealAIGym calls; else in this order."""
    try:
        names = inspect.signature(call).parameters
    except Exception:  # built-in functions have none, and a foreign __signature__ may raise anything
        return call
    if {"x", "t"} <= set(names) and names["x"].kind is not inspect.Parameter.POSITIONAL_ONLY:
        return lambda x, t: call(x=x, t=t)
    return call
