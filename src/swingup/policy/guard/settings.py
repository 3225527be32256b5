"""The safety guard's settings, its reasons to stop, and who has one; ``core.py`` has its steps.

A guard stands between a loop and a controller. It lets the controller act until a measurement, the clock or the
controller's torque is unsound; from then on it commands safe torques, until ``reset()``, and says why.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, ClassVar, NamedTuple, TypeAlias

from ...common.errors import SwingupError
from ...common.settings import Range, Settings, read_settings

STANDSTILLS = 10
"""Most calls in a row that may have the same time: a loop may call twice for one measurement."""
PUSHING_SHARE = 0.5
"""A torque above this part of its joint's limit must move the joint."""
BRAKED_MULTIPLE = 2.0
"""A velocity beyond this many of the guard's limits cannot be braked by."""


class Reason(IntEnum):
    """Why a guard stopped its controller; the numbers are those of the C header."""

    NONE = 0
    NOT_FINITE = 1
    ANGLE = 2
    VELOCITY = 3
    STALE = 4
    LATE = 5
    CLOCK = 6
    TORQUE = 7


SENTENCES = (
    "the guard has not stopped the controller",
    "a measured angle or velocity is not a finite number",
    "a joint's angle is beyond the limit",
    "a joint's velocity is beyond the limit",
    "a joint's measurement repeats itself while the joint must be moving",
    "the time since the last call is beyond the limit",
    "the clock runs backward, stands still or is not a finite number",
    "the controller's torque is not a finite number",
)
"""The reasons in words, by their number."""

_UNITS = {Reason.ANGLE: " rad", Reason.VELOCITY: " rad/s", Reason.STALE: " s", Reason.LATE: " s"}

MOTION = (Reason.ANGLE, Reason.VELOCITY, Reason.TORQUE)
"""Reasons that leave the measurement sound: only after these may a guard brake."""


class Fault(NamedTuple):
    """What made a guard stop its controller."""

    reason: Reason
    time: float
    """Time of the call (s)."""
    joint: int
    """0 is the shoulder, 1 the elbow; -1 where no joint is meant."""
    value: float
    """The angle (rad), the velocity (rad/s) or the time (s) that was beyond its limit, or what was not finite."""

    def __str__(self) -> str:
        joint = f"{('shoulder', 'elbow')[self.joint]}, " if self.joint >= 0 else ""
        unit = _UNITS.get(self.reason, "")
        return f"{SENTENCES[self.reason]} ({joint}{self.value:.6g}{unit}, at t = {self.time:.6g} s)"


@dataclass(frozen=True)
class GuardSettings(Settings):
    """What a robot may do under a controller; its limits are those of RealAIGym's loop on the robot."""

    PART: ClassVar[str] = "guard"
    dt: Annotated[float, Range(1e-6, 0.1)] = 0.002
    """Time between calls (s)."""
    angle_limit: Annotated[float, Range(1e-6, 1e6)] = 4 * math.pi
    """Largest angle of either joint (rad)."""
    velocity_limit: Annotated[float, Range(1e-6, 1e6)] = 20.0
    """Largest velocity of either joint (rad/s)."""
    longest_gap: Annotated[float, Range(1e-6, 1e6)] = 0.05
    """Longest time without a fresh measurement (s): between two calls, of numbers that are not finite, or of angle
    and velocity of a joint that repeat, digit by digit, with a velocity other than 0."""
    stuck_time: Annotated[float, Range(1e-6, 1e6)] = 0.2
    """Longest time (s) for which the driven joint's measurement may repeat under more than half its torque."""
    torque_rate: Annotated[float | None, Range(1e-6, 1e6)] = None
    """Fastest change of a torque (N m/s), to which torques are limited; None: the motor's limit within ``dt``."""
    braking: Annotated[float, Range(0.0, 1e3)] = 0.0
    """Damping kd of a stopped joint (N m s/rad): its torque is -kd q̇ within its limit. At 0 all torques are 0."""

    def __post_init__(self) -> None:
        super().__post_init__()
        # Every call would be late.
        if self.longest_gap < self.dt:
            raise SwingupError(
                f"guard setting longest_gap = {self.longest_gap:g} is below dt = {self.dt:g}: raise it"
            )

    def rate(self, limit: float) -> float:
        """Fastest change of the torque (N m/s) of a motor with a torque limit (N m)."""
        return limit / self.dt if self.torque_rate is None else self.torque_rate


GuardChoice: TypeAlias = bool | GuardSettings | Mapping[str, Any] | None
"""A guard as callers choose it: where the policy file has one (None), never (False), always (True: with the file's
settings, or the defaults), or always with settings of the caller."""


def default_guard(dt: float | None = None) -> GuardSettings:
    """The guard of a loop with ``dt`` (s) between calls; None for any. It bears ten missed calls at least."""
    if dt is None:
        return GuardSettings()
    return GuardSettings(dt=dt, longest_gap=max(GuardSettings.longest_gap, 10 * dt), stuck_time=100 * dt)


def choose_guard(choice: GuardChoice, own: GuardSettings | None, dt: float | None) -> GuardSettings | None:
    """The guard that a caller chose for a policy; None for none.

    ``own`` is the policy file's. The policy expects calls dt (s) apart; None for any time.
    """
    if choice is None or choice is False:
        return own if choice is None else None
    if isinstance(choice, GuardSettings):
        return choice
    # A caller's mapping is read as a file's entry is, with the same errors.
    return (
        own or default_guard(dt) if choice is True else read_settings({GuardSettings.PART: choice}, GuardSettings)
    )
