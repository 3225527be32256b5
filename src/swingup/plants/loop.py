"""What a domain may say about the loop between a controller and the plant, and the loop that it has otherwise."""

from typing import Any

from ..checks import LARGEST, one_of

LOOP_DT = 0.002
"""Time of a step of loop and plant (s)."""

LONGEST = 3.0
"""Nominal periods in the longest one. Chosen: longer ones come in some recordings, about once in 1,000 periods."""

LOOP = {
    "torque_limit": 6.0, "passive_limit": 0.0, "delay": 0.0, "velocity_noise": 0.0, "torque_noise": 0.0,
    "response": 1.0, "rate_limit": 1e6, "ripple": 0.0, "ripple_periods": 36.0, "push": 0.0,
}  # fmt: skip
"""Values of the loop that a domain may set, and their defaults: a perfect loop."""

SENSOR = {"quantum1": 0.0, "quantum2": 0.0, "offset1": 0.0, "offset2": 0.0}
"""The same for the sensors; a domain that has a quantum has velocities from differences, if it does not say."""

CLOCK = {"late": 0.0, "lateness": 0.0}
"""The same for periods that vary."""

DRIVE = {"lag": 0.0, "gain1": 1.0, "gain2": 1.0, "passive_push": 0.0}
"""The same for motors that lag or deliver another torque; pushes are asked of the motors then."""

EVERY_LOOP = LOOP | SENSOR | CLOCK | DRIVE
"""All values of the loop, and their defaults."""

LARGEST_LOOP_VALUES = {
    "delay": 0.2, "response": 2.0, "velocity_noise": 10.0, "torque_noise": 10.0, "quantum1": 0.1, "quantum2": 0.1,
    "late": 1.0, "lateness": 0.1, "lag": 0.1, "gain1": 10.0, "gain2": 10.0,
}  # fmt: skip
"""Beyond these, nothing can be controlled."""

LARGEST_OFFSET = 1.0
"""Of either sign (rad)."""

BOUNDS = {name: (0.0, LARGEST_LOOP_VALUES.get(name, LARGEST)) for name in EVERY_LOOP}
BOUNDS |= dict.fromkeys(("offset1", "offset2"), (-LARGEST_OFFSET, LARGEST_OFFSET))
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
