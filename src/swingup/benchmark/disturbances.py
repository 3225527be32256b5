"""Disturbances of a single run: those that the robustness grid tries one at a time."""

import dataclasses

import numpy as np

from ..common.checks import finite_number
from ..common.errors import SwingupError
from ..loop.disturbance import Disturbance, undisturbed
from .grid import draw_pushes, floored_delay_steps
from .rules import DEFAULT_RULES, PerformanceRules, PushRules, get_performance_rules
from .seeds import check_seeds

LARGEST_DISTURBANCE = 999.0
"""No disturbance of a pendulum comes near this, in SI units."""


def make_disturbance(
    velocity_noise: float = 0.0,
    torque_noise: float = 0.0,
    torque_response: float = 1.0,
    delay: float = 0.0,
    pushes: PushRules | None = None,
    seed: int = 0,
    rules: PerformanceRules | str = DEFAULT_RULES,
) -> Disturbance:
    """A disturbance of a run of :func:`swingup.evaluate`.

    Args:
        velocity_noise: standard deviation of the noise on measured velocities (rad/s).
        torque_noise: standard deviation of the noise on the driven joint's torque (N m).
        torque_response: motor response; 1 is a perfect motor.
        delay: age of what the controller measures (s).
        pushes: random pushes, as ``PushRules()`` of the robustness board or others; None for none.
        seed: of the noise and the pushes.
        rules: those of the run, or their name: a delay is rounded down to their steps, and pushes come within
            their duration.

    Raises:
        SwingupError: a value is out of range, or there are no such rules.
    """
    if isinstance(pushes, bool):
        raise SwingupError(f"pushes = {pushes} are no rules: use PushRules() for those of the robustness board")
    noises = {"velocity_noise": velocity_noise, "torque_noise": torque_noise, "delay": delay}
    numbers = {name: finite_number(name, value, 0.0, LARGEST_DISTURBANCE) for name, value in noises.items()}
    response = finite_number("torque_response", torque_response, -LARGEST_DISTURBANCE, LARGEST_DISTURBANCE)
    first = check_seeds(seed, 1)[0]
    rules = get_performance_rules(rules)
    calm = undisturbed() if pushes is None else undisturbed(pushes.pushes)
    return dataclasses.replace(
        calm,
        velocity_noise=numbers["velocity_noise"],
        torque_noise=numbers["torque_noise"],
        response=response,
        delay_steps=floored_delay_steps(numbers["delay"], rules.dt),
        pushes=calm.pushes if pushes is None else draw_pushes(np.random.default_rng(first), pushes, rules.duration),
        # The second word counts the simulations of a grid; a single run is its first.
        noise=np.array([first, 0], np.uint32),
    )
