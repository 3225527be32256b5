"""What a domain may say about the loop between a controller and the plant, and the loop that it has otherwise."""

from typing import Any

from ..checks import LARGEST, one_of

LOOP_DT = 0.002
"""Time of a step of loop and plant (s)."""

LOOP = {
    "torque_limit": 6.0, "passive_limit": 0.0, "delay": 0.0, "velocity_noise": 0.0, "torque_noise": 0.0,
    "response": 1.0, "rate_limit": 1e6, "ripple": 0.0, "ripple_periods": 36.0, "push": 0.0,
}  # fmt: skip
"""Values of the loop that a domain may set, and their defaults: a perfect loop."""

LARGEST_LOOP_VALUES = {"delay": 0.2, "response": 2.0, "velocity_noise": 10.0, "torque_noise": 10.0}
"""Beyond these, nothing can be controlled."""

BOUNDS = {name: (0.0, LARGEST_LOOP_VALUES.get(name, LARGEST)) for name in LOOP}
"""Least and largest values."""

VELOCITIES = ("differences", "driver")
"""Sources of measured velocities: backward differences of measured positions over recorded times, or the motors'
own drivers."""


def check_velocities(source: Any) -> None:
    """Refuse another source of velocities than :data:`VELOCITIES`, or None.

    Raises:
        SwingupError: there is no such source.
    """
    if source is not None:
        one_of("velocities", source, VELOCITIES)
