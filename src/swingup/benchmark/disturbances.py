"""Disturbances of a single run, as the robustness grid has them one at a time."""

import dataclasses
from numbers import Real
from typing import Any

import numpy as np

from ..errors import SwingupError
from ..tasks.disturbance import Disturbance, undisturbed
from .grid import draw_pushes, floored_delay_steps
from .rules import DEFAULT_RULES, PushRules, get_robustness_rules

LARGEST = 1000.0
"""Nothing that disturbs a pendulum comes near this, in SI units."""


def make_disturbance(
    velocity_noise: float = 0.0,
    torque_noise: float = 0.0,
    torque_response: float = 1.0,
    delay: float = 0.0,
    pushes: PushRules | None = None,
    seed: int = 0,
) -> Disturbance:
    """What disturbs a run of :func:`swingup.evaluate`.

    Args:
        velocity_noise: standard deviation of the noise on measured velocities (rad/s).
        torque_noise: standard deviation of the noise on the driven joint's torque (N m).
        torque_response: motor response; 1 is a perfect motor.
        delay: age of what the controller measures (s).
        pushes: random pushes, as ``PushRules()`` of the robustness board or others; None for none.
        seed: of the noise and the pushes.

    Raises:
        SwingupError: a value is out of range.
    """
    if isinstance(pushes, bool):
        raise SwingupError(f"pushes = {pushes} are no rules: use PushRules() for those of the robustness board")
    for name, value in {"velocity_noise": velocity_noise, "torque_noise": torque_noise, "delay": delay}.items():
        if not _is_number(value) or not 0 <= value < LARGEST:
            raise SwingupError(f"{name} = {value} is out of range: use a number of 0 or a little more, in SI units")
    if not _is_number(torque_response) or not abs(torque_response) < LARGEST:
        raise SwingupError(f"torque_response = {torque_response} is out of range: 1 is a perfect motor")
    if not _is_number(seed) or not 0 <= seed < 2**31 or seed != int(seed):
        raise SwingupError(f"seed = {seed} is out of range: use a whole number of 0 to 2³¹ - 1")
    rules = get_robustness_rules(DEFAULT_RULES)
    calm = undisturbed() if pushes is None else undisturbed(pushes.pushes)
    return dataclasses.replace(
        calm,
        velocity_noise=velocity_noise,
        torque_noise=torque_noise,
        response=torque_response,
        delay_steps=floored_delay_steps(delay, rules.dt),
        pushes=calm.pushes
        if pushes is None
        else draw_pushes(np.random.default_rng(int(seed)), pushes, rules.duration),
        noise=np.array([int(seed), 0], np.uint32),
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)
