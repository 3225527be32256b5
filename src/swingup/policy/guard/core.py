"""The safety guard in plain floats.

L_i is a joint's torque limit: the plant's on the driven joint; on the passive one ``passive_limit``, or 0
without an identifier. Each call has a time t and a measurement z = [q, v]; p is the time since the last call,
and h = p, or dt at the first call and where p = 0. The first of these that holds is the fault:

1. CLOCK: t is not finite, p < 0, or p = 0 for the 11th time in a row.
2. LATE: p > ``longest_pause``.
3. NOT_FINITE: a number of z is not finite.
4. ANGLE, VELOCITY: |q_i| > ``angle_limit``, |v_i| > ``velocity_limit``; the shoulder first.
5. STALE: s_i > ``stale_time`` or w > ``stuck_time``. s_i grows by h where q_i and v_i repeat the last call's
   digits and v_i is not 0; else it is 0. w grows by h where the driven joint's q and v repeat and the last
   torque was above L/2; else it is 0. A pendulum may thus hang or stand still for ever.

Without a fault, now or before, the controller computes its torques u from z.

6. TORQUE: a torque of u is not finite.
7. Otherwise u_i is limited to within r h of the last call's torque, 0 before the first, and then to L_i. A
   torque that changes too fast is limited and no fault: it moves the pendulum less than asked, while a stop
   would drop it.

Once latched, all torques are 0 at once, whatever r is. If ``braking`` is above 0 and the fault was ANGLE,
VELOCITY or TORQUE, they are -k_d v_i within L_i, and 0 in calls with |v_i| above twice its limit. Braking ends
for good at the first call with another fault (1 to 5): nothing brakes by a broken measurement.
"""

import math

import numpy as np

from .settings import BRAKED, MOTION, PUSHING, STANDSTILLS, Fault, GuardSettings, Reason


class Guard:
    """Watches one loop: at each call ``allows``, then ``limited`` for the torques, or ``stopped`` instead."""

    def __init__(self, settings: GuardSettings, joint: int, limits: tuple[float, float]) -> None:
        """Prepare for a loop.

        Args:
            settings: what is allowed.
            joint: index of the driven joint.
            limits: torque limits of shoulder and elbow (N m).
        """
        self.settings, self._joint, self._limits = settings, joint, limits
        self._rate = settings.rate(limits[joint])
        self.reset()

    def reset(self) -> None:
        """Let the controller act again; nothing seen yet."""
        self.fault: Fault | None = None
        """Why the controller was stopped; None while it acts."""
        self._time = -math.inf
        self._step = self.settings.dt
        self._sample = (0.0, 0.0, 0.0, 0.0)
        self._torques = (0.0, 0.0)
        self._repeated, self._stuck = [0.0, 0.0], 0.0
        self._standstills = 0
        self._brakes = False

    def allows(self, t: float, x: np.ndarray) -> bool:
        """Whether the controller may act on the state x (4,) (rad, rad/s) measured at time t (s)."""
        fault = self._fault(t, tuple(np.asarray(x, np.float64).tolist()))
        if fault is not None:
            self._stop(fault)
        return self.fault is None

    def limited(self, u: np.ndarray) -> np.ndarray:
        """The controller's torques (2,) (N m) within rate and limits; safe ones if one of them is not finite."""
        asked = u.tolist()
        for joint in (0, 1):
            if not math.isfinite(asked[joint]):
                self._stop(Fault(Reason.TORQUE, self._time, joint, asked[joint]))
                return self.stopped()
        change = self._rate * self._step
        first, second = (
            max(-limit, min(limit, max(before - change, min(before + change, torque))))
            for torque, before, limit in zip(asked, self._torques, self._limits, strict=True)
        )
        self._torques = first, second
        return np.array(self._torques)

    def stopped(self) -> np.ndarray:
        """The torques (2,) (N m) of a stopped controller: none, or damping while the measurement is sound."""
        self._torques = (0.0, 0.0)
        kd, most = self.settings.braking, BRAKED * self.settings.velocity_limit
        if self._brakes:
            first, second = (
                max(-limit, min(limit, -kd * rate)) if abs(rate) <= most else 0.0
                for rate, limit in zip(self._sample[2:], self._limits, strict=True)
            )
            self._torques = first, second
        return np.array(self._torques)

    def _stop(self, fault: Fault) -> None:
        """Latch the first fault; brake from it on, until a fault of sensor or clock."""
        motion = fault.reason in MOTION
        self._brakes = motion and self.settings.braking > 0 and (self.fault is None or self._brakes)
        self.fault = self.fault or fault

    def _fault(self, t: float, x: tuple[float, ...]) -> Fault | None:
        """What is wrong with this call, if anything; takes the call in."""
        pause, before = t - self._time, self._sample
        first = self._time == -math.inf
        self._time = t
        if not math.isfinite(t) or not (first or pause >= 0):
            return Fault(Reason.CLOCK, t, -1, t if first else pause)
        self._standstills = self._standstills + 1 if pause == 0 else 0
        if self._standstills > STANDSTILLS:
            return Fault(Reason.CLOCK, t, -1, pause)
        if not first and pause > self.settings.longest_pause:
            return Fault(Reason.LATE, t, -1, pause)
        self._step = self.settings.dt if first or pause == 0 else pause
        # NaN does not count as a sample: the next one must not be compared with it.
        self._sample = (x[0], x[1], x[2], x[3])
        return self._out_of_bounds(t) or (None if first else self._stale(t, before))

    def _out_of_bounds(self, t: float) -> Fault | None:
        x, settings = self._sample, self.settings
        for joint in (0, 1):
            for value in (x[joint], x[joint + 2]):
                if not math.isfinite(value):
                    return Fault(Reason.NOT_FINITE, t, joint, value)
        for joint in (0, 1):
            if abs(x[joint]) > settings.angle_limit:
                return Fault(Reason.ANGLE, t, joint, x[joint])
            if abs(x[joint + 2]) > settings.velocity_limit:
                return Fault(Reason.VELOCITY, t, joint, x[joint + 2])
        return None

    def _stale(self, t: float, before: tuple[float, float, float, float]) -> Fault | None:
        """Whether a joint that must be moving has had the same measurement for too long."""
        x, joint, settings = self._sample, self._joint, self.settings
        same = [x[i] == before[i] and x[i + 2] == before[i + 2] for i in (0, 1)]
        for i in (0, 1):
            self._repeated[i] = self._repeated[i] + self._step if same[i] and x[i + 2] != 0 else 0.0
        pushed = abs(self._torques[joint]) > PUSHING * self._limits[joint]
        self._stuck = self._stuck + self._step if same[joint] and pushed else 0.0
        for i in (0, 1):
            if self._repeated[i] > settings.stale_time:
                return Fault(Reason.STALE, t, i, self._repeated[i])
        return Fault(Reason.STALE, t, joint, self._stuck) if self._stuck > settings.stuck_time else None
