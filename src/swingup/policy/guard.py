"""The safety guard in plain floats.

L_i is a joint's torque limit: the plant's on the driven joint; on the passive one ``passive_limit``, or 0
without an identifier. Each call has a time t and a measurement z = [q, v]; p is the time since the last call,
and h = p, or dt at the first call and where p = 0. The first of these that holds is the fault:

1. CLOCK: t is not finite, p < 0, or p = 0 for the 11th time in a row.
2. LATE: p > ``longest_gap``.
3. NOT_FINITE: a joint's q_i or v_i is not finite, and its gap s_i > ``longest_gap`` or there was a fault. s_i grows
   by h in such a call, and where both repeat the digits of the last finite ones and v_i is not 0; else it is 0.
4. ANGLE, VELOCITY: |q_i| > ``angle_limit``, |v_i| > ``velocity_limit`` of a finite joint; the shoulder first.
5. STALE: s_i > ``longest_gap``, or w > ``stuck_time``. w grows by h where the driven joint's q and v repeat or are
   not finite and the last torque was above L/2; else it is 0.
   A pendulum may thus hang or stand still for ever.
   JUMP: a joint's angle lies farther from its last sample than ``MAX_JUMP`` and twice the velocity's limit allow;
   whole turns do not count. DEAD: its q and v repeat until the other joint's angle is ``DEAD_TRAVEL`` farther on.
6. PERIOD, ENCODER, MOTOR, SWAPPED, UNDRIVEN: in the first second of a run the clock, or the motion under the
   torques, is not that of the policy's loop and plant (``wiring.py``).

Without a fault, now or before, the controller computes its torques u from z. In a shorter gap an estimator predicts
the state. A controller that has none gives NaN for a state that is not finite, and the last torques are held.

7. TORQUE: a torque of u is not finite, though z is.
8. Otherwise u_i is limited to within r h of the last call's torque, 0 before the first, and then to L_i. A
   torque that changes too fast is limited and no fault: it moves the pendulum less than asked, while a stop
   would drop it.

Once latched, all torques are 0 at once, whatever r is. If ``braking`` is above 0 and the fault was ANGLE,
VELOCITY or TORQUE, they are -k_d v_i within L_i, and 0 in calls with |v_i| above twice its limit. Braking ends
for good at the first call with another fault (1 to 6): nothing brakes by a broken measurement.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Annotated, Any, ClassVar, NamedTuple, TypeAlias

import numpy as np

from ..common.errors import SwingupError
from ..common.settings import Range, Settings, read_values
from ..plant.plant import LEADERBOARD, Plant
from ..plant.units import DAMPING, TORQUE_RATE, VELOCITY, scaled, scales_of
from .wiring import WiringWatch, turned

MAX_STANDSTILLS = 10
"""Maximum number of calls in a row at the same time: a loop may call twice for one measurement."""
PUSHING_SHARE = 0.5  # A torque above this share of its joint's limit must move the joint
MAX_JUMP, JUMP_RATIO = 0.3, 2.0
"""An angle may differ from its last sample by this (rad), and by this multiple of what the velocity's limit allows:
samples may be older than their calls."""
DEAD_TRAVEL = 1.5
"""Before one joint is this much farther on (rad) the other one's sample changes, by its coupling to it. An encoder
that wavers between two counts goes nowhere."""
MAX_BRAKED_RATIO = 2.0
"""Above this multiple of the guard's velocity limit a measured velocity is not used for braking."""


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
    PERIOD = 8
    ENCODER = 9
    MOTOR = 10
    SWAPPED = 11
    UNDRIVEN = 12
    JUMP = 13
    DEAD = 14


REASON_TEXTS = (
    "the guard has not stopped the controller",
    "a measured angle or velocity is not a finite number",
    "a joint's angle is beyond the limit",
    "a joint's velocity is beyond the limit",
    "a joint's measurement repeats itself while the joint must be moving",
    "the time since the last call is beyond the limit",
    "the clock runs backward, stands still or is not a finite number",
    "the controller's torque is not a finite number",
    "the time between calls is not the policy's",
    "a joint's encoder counts against its torque: it is reversed",
    "the motors turn against their torques: they are reversed",
    "encoders or motors of shoulder and elbow are swapped",
    "the torque does not arrive, or the other joint's motor takes it: the joints do not move as it says",
    "a joint's angle jumps farther than the joint can move",
    "a joint's measurement stays the same while the other joint moves: its encoder is dead",
)
"""The reasons in words, by their number."""

_UNITS = {
    Reason.ANGLE: " rad",
    Reason.VELOCITY: " rad/s",
    Reason.STALE: " s",
    Reason.LATE: " s",
    Reason.PERIOD: " s",
    Reason.JUMP: " rad",
    Reason.DEAD: " rad",
}

WIRING_REASONS = (
    (Reason.NONE, -1),
    (Reason.ENCODER, 0),
    (Reason.ENCODER, 1),
    (Reason.MOTOR, -1),
    (Reason.SWAPPED, -1),
    (Reason.SWAPPED, -1),
    (Reason.SWAPPED, -1),
    (Reason.UNDRIVEN, -1),
)
"""The reason and the joint for each of ``wiring.WIRINGS``."""

MOTION_REASONS = (Reason.ANGLE, Reason.VELOCITY, Reason.TORQUE)
"""Reasons that leave the measurement sound: only after these may a guard brake."""


class Fault(NamedTuple):
    """What made a guard stop its controller."""

    reason: Reason
    time: float  # Time of the call (s)
    joint: int  # 0 is the shoulder, 1 the elbow; -1 where no joint is meant
    value: float
    """The angle (rad), the velocity (rad/s) or the time (s) that was beyond its limit, or what was not finite."""

    def __str__(self) -> str:
        joint = f"{('shoulder', 'elbow')[self.joint]}, " if self.joint >= 0 else ""
        unit = _UNITS.get(self.reason, "")
        return f"{REASON_TEXTS[self.reason]} ({joint}{self.value:.6g}{unit}, at t = {self.time:.6g} s)"


@dataclass(frozen=True)
class GuardSettings(Settings):
    """What a robot may do under a controller; its limits are those of RealAIGym's loop on the robot, design C.1."""

    PART: ClassVar[str] = "guard"
    dt: Annotated[float, Range(1e-6, 0.1)] = 0.002  # Time between calls (s)
    angle_limit: Annotated[float, Range(1e-6, 1e6)] = 4 * math.pi  # Maximum angle of either joint (rad)
    velocity_limit: Annotated[float, Range(1e-6, 1e6), VELOCITY] = 20.0  # Maximum velocity of either joint (rad/s)
    longest_gap: Annotated[float, Range(1e-6, 1e6)] = 0.05
    """Maximum time without a fresh measurement (s): between two calls, of numbers that are not finite, or of angle
    and velocity of a joint that repeat, digit by digit, with a velocity other than 0."""
    stuck_time: Annotated[float, Range(1e-6, 1e6)] = 0.2
    """Maximum time (s) for which the driven joint's measurement may repeat under more than half its torque."""
    torque_rate: Annotated[float | None, Range(1e-6, 1e6), TORQUE_RATE] = None
    """Maximum rate of change of the torques (N m/s), which limits them; None: the motor's limit within ``dt``."""
    watched: Annotated[float, Range(0.0, 1e6)] = 1.0
    """Time from the first call in which the guard looks at the wiring (s); with 0 it never does, nor at the period:
    for a controller that is shown a motion which is not its own."""
    braking: Annotated[float, Range(0.0, 1e3), DAMPING] = 0.0
    """Damping kd of a stopped joint (N m s/rad): its torque is -kd q̇ within its limit. At 0 all torques are 0."""

    def __post_init__(self) -> None:
        super().__post_init__()
        # Every call would be late.
        if self.longest_gap < self.dt:
            raise SwingupError(
                f"guard setting longest_gap = {self.longest_gap:g} is below dt = {self.dt:g}: raise it"
            )

    def rate(self, limit: float) -> float:
        """Maximum rate of change of the torque (N m/s) of a motor with a torque limit (N m)."""
        return limit / self.dt if self.torque_rate is None else self.torque_rate


GuardChoice: TypeAlias = bool | GuardSettings | Mapping[str, Any] | None
"""A guard as callers choose it: where the policy file has one (None), never (False), always (True: with the file's
settings, or the defaults), or always with settings of the caller: all of them, or those that a mapping changes."""


def default_guard(dt: float | None = None) -> GuardSettings:
    """The guard of a loop with ``dt`` (s) between calls; None for any. It tolerates ten missed calls."""
    if dt is None:
        return GuardSettings()
    return GuardSettings(dt=dt, longest_gap=max(GuardSettings.longest_gap, 10 * dt), stuck_time=100 * dt)


def choose_guard(
    choice: GuardChoice, own: GuardSettings | None, dt: float | None, plant: Plant = LEADERBOARD
) -> GuardSettings | None:
    """The guard that a caller chose for a policy; None for none.

    ``own`` is the policy file's. The policy expects calls dt (s) apart; None for any time. The default's limits are
    in the units of the plant, as those of the boards.
    """
    if choice is None or choice is False:
        return own if choice is None else None
    if isinstance(choice, GuardSettings):
        return choice
    found = own or scaled(default_guard(dt), scales_of(plant))
    # A caller's mapping is read as a file's entry is, with the same errors.
    return found if choice is True else replace(found, **read_values(choice, GuardSettings.PART, GuardSettings))


class Guard:
    """Watches one loop. A call asks ``accepts_measurement``, then ``limit_torques``, or ``stop_torques`` if not."""

    def __init__(
        self, settings: GuardSettings, joint: int, limits: tuple[float, float], watch: WiringWatch | None = None
    ) -> None:
        """Prepare for a loop, whose motors have torque limits of shoulder and elbow (N m).

        Without a ``watch`` the first second is as any other.
        """
        self.settings, self._joint, self._limits, self._watch = settings, joint, limits, watch
        self._rate = settings.rate(limits[joint])
        self.reset()

    def reset(self) -> None:
        """Let the controller act again, and forget all measurements."""
        self.fault: Fault | None = None
        self._time = -math.inf
        self._step = self.settings.dt
        self._sample = (0.0, 0.0, 0.0, 0.0)
        self._torques = (0.0, 0.0)
        self._gaps, self._stuck = [0.0, 0.0], 0.0
        self._seen, self._travels = [False, False], [0.0, 0.0]
        self._measurement_broken = False
        self._standstills = 0
        self._brakes = False
        self._age = 0.0
        if self._watch is not None:
            self._watch.reset()

    def accepts_measurement(self, t: float, x: np.ndarray) -> bool:
        """Whether the controller may act on the state x (4,) (rad, rad/s) measured at time t (s)."""
        fault = self._call_fault(t, tuple(np.asarray(x, np.float64).tolist()))
        if fault is not None:
            self._stop(fault)
        return self.fault is None

    def limit_torques(self, u: np.ndarray) -> np.ndarray:
        """The controller's torques (2,) (N m) within rate and limits; safe ones if one of them is not finite."""
        asked = u.tolist()
        for joint in (0, 1):
            if not math.isfinite(asked[joint]):
                # Without an estimator a broken measurement gives no torques: the last ones are held.
                if self._measurement_broken:
                    return np.array(self._torques)
                self._stop(Fault(Reason.TORQUE, self._time, joint, asked[joint]))
                return self.stop_torques()
        change = self._rate * self._step
        shoulder, elbow = (
            max(-limit, min(limit, max(before - change, min(before + change, torque))))
            for torque, before, limit in zip(asked, self._torques, self._limits, strict=True)
        )
        self._torques = shoulder, elbow
        return np.array(self._torques)

    def stop_torques(self) -> np.ndarray:
        """The torques (2,) (N m) of a stopped controller: none, or damping while the measurement is sound."""
        self._torques = (0.0, 0.0)
        kd, max_rate = self.settings.braking, MAX_BRAKED_RATIO * self.settings.velocity_limit
        if self._brakes:
            shoulder, elbow = (
                max(-limit, min(limit, -kd * rate)) if abs(rate) <= max_rate else 0.0
                for rate, limit in zip(self._sample[2:], self._limits, strict=True)
            )
            self._torques = shoulder, elbow
        return np.array(self._torques)

    def _stop(self, fault: Fault) -> None:
        """Latch the first fault; brake from it on, until a fault of sensor or clock."""
        motion = fault.reason in MOTION_REASONS
        self._brakes = motion and self.settings.braking > 0 and (self.fault is None or self._brakes)
        self.fault = self.fault or fault

    def _call_fault(self, t: float, x: tuple[float, ...]) -> Fault | None:
        """The fault of this call, if any, after which the guard has noted the call."""
        pause = t - self._time
        first = self._time == -math.inf
        self._time = t
        if not math.isfinite(t) or not (first or pause >= 0):
            return Fault(Reason.CLOCK, t, -1, t if first else pause)
        self._standstills = self._standstills + 1 if pause == 0 else 0
        if self._standstills > MAX_STANDSTILLS:
            return Fault(Reason.CLOCK, t, -1, pause)
        if not first and pause > self.settings.longest_gap:
            return Fault(Reason.LATE, t, -1, pause)
        # A loop that calls twice at one time must not stop the gaps from growing.
        self._step = self.settings.dt if first or pause == 0 else pause
        fault = self._measurement_fault(t, x, first)
        return self._wiring_fault(t, 0.0 if first else pause) if fault is None else fault

    def _wiring_fault(self, t: float, pause: float) -> Fault | None:
        """What the first second shows."""
        if self._watch is None or self.fault is not None or self.settings.watched == 0:
            return None
        self._age += pause
        if (period := self._watch.wrong_period(t, pause)) is not None:
            return Fault(Reason.PERIOD, t, -1, period)
        if self._age > self.settings.watched:
            return None
        wrong = self._watch.wrong_wiring(t, self._sample[:2], self._torques, pause)
        reason, joint = WIRING_REASONS[wrong]
        return Fault(reason, t, joint, self._torques[self._joint]) if wrong else None

    def _measurement_fault(self, t: float, x: tuple[float, ...], first: bool) -> Fault | None:
        s, driven, before = self.settings, self._joint, self._sample
        finite = [math.isfinite(x[i]) and math.isfinite(x[i + 2]) for i in (0, 1)]
        same = [not first and x[i] == before[i] and x[i + 2] == before[i + 2] for i in (0, 1)]
        moves = [turned(x[i] - before[i]) if finite[i] and self._seen[i] else 0.0 for i in (0, 1)]
        reach = [MAX_JUMP + JUMP_RATIO * s.velocity_limit * (gap + self._step) for gap in self._gaps]
        self._measurement_broken = not all(finite)
        for i in (0, 1):
            shows = finite[i] and (not same[i] or x[i + 2] == 0)
            self._gaps[i] = 0.0 if shows else self._gaps[i] + self._step
            self._travels[i] = self._travels[i] + moves[1 - i] if same[i] else 0.0
            self._seen[i] = self._seen[i] or finite[i]
        pushed = abs(self._torques[driven]) > PUSHING_SHARE * self._limits[driven]
        still = same[driven] or not finite[driven]
        self._stuck = self._stuck + self._step if still and pushed else 0.0
        # What is not finite is not a sample: the next one must not be compared with it.
        q1, q2, v1, v2 = (x[i] if finite[i % 2] else before[i] for i in range(4))
        self._sample = q1, q2, v1, v2
        # Nothing may brake by a broken measurement.
        max_gap = s.longest_gap if self.fault is None else 0.0
        for i in (0, 1):
            if not finite[i] and self._gaps[i] > max_gap:
                return Fault(Reason.NOT_FINITE, t, i, x[i] if not math.isfinite(x[i]) else x[i + 2])
        for i in (0, 1):
            # Where a joint is not finite, this is its sample before, which was within the limits.
            if abs(angle := self._sample[i]) > s.angle_limit:
                return Fault(Reason.ANGLE, t, i, angle)
            if abs(rate := self._sample[i + 2]) > s.velocity_limit:
                return Fault(Reason.VELOCITY, t, i, rate)
        for i in (0, 1):
            if abs(moves[i]) > reach[i]:
                return Fault(Reason.JUMP, t, i, moves[i])
            if self._gaps[i] > s.longest_gap:
                return Fault(Reason.STALE, t, i, self._gaps[i])
            if abs(self._travels[i]) > DEAD_TRAVEL:
                return Fault(Reason.DEAD, t, i, self._travels[i])
        return Fault(Reason.STALE, t, driven, self._stuck) if self._stuck > s.stuck_time else None
