"""The contract of all back ends: what a loop may expect of a policy, whatever runs it.

A controller is called with the measured state x = [q1, q2, dq1, dq2] (rad, rad/s) at the time t (s) and gives the
torques u = [u1, u2] (N m) of shoulder and elbow.

- Angles are those that the encoders show: the zeros of the policy's plant are subtracted first, before guard and
  estimator.
- Back ends differ by at most 5e-5 N m, and by 1e-11 where both compute in double precision throughout. Behind an
  estimator, rounding feeds back: 1e-9 over a whole run.
- A policy that sees its plant runs as the ordinary policy that it is for the plant of its file. Behind an
  identifier it sees the plant identified so far, which depends on its own torques: 1e-9 holds where it reacts
  little to the plant. A replay does not close the loop: there a strong reaction lets rounding grow. The
  shipped ``adaptive`` keeps to 1e-6 in double precision where the motors are given the same torques.
- No torque is beyond its motor's limit, with and without a safety guard: the plant's of the driven joint; of the
  passive joint the friction compensation's of an identifier, or 0.
- The torque of the driven joint is NaN where the state is not finite, so that no clipping hides a broken sensor.
  Behind an estimator the model stands in for short gaps, and it is NaN after them. The passive joint's torque is
  never NaN: it is 0 there.
- Behind a safety guard no torque is ever NaN: the guard holds the last ones in a short gap, and then stops the
  controller (``policy/guard.py``).
- Behind an estimator a call that comes sooner than 0.6 of its period after the last one keeps the torques, in C and
  NumPy, unless they are NaN: a loop of 1 kHz runs as one of 500 Hz, and so does one that calls twice at one time.
- ``reset()`` forgets the run: what follows repeats the first run bit for bit.

``tests/policy/test_conformance.py`` holds every back end to it, ``tests/policy/test_guard.py`` the guards in NumPy
and in C. ONNX graphs and the page's JavaScript run the network alone, folded for the file's plant, with nothing
around it. JAX has the same contract without hidden state, ``init() -> memory`` and ``(memory, t, x) ->
(memory, u)``; a C header has it as ``swingup_reset`` and ``swingup_control``. JAX has no guard: it judges.
"""

import math
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from ..common.errors import SwingupError, quoted
from ..plant.plant import Plant, Robot
from .guard import MAX_STANDSTILLS, Fault, Guard, GuardChoice, GuardSettings, choose_guard
from .wiring import WiringWatch


def four_numbers(x: Any) -> np.ndarray:
    """The state as an array (4,), which may be the caller's own."""
    try:
        state = np.asarray(x, np.float64)
    except (TypeError, ValueError):
        state = np.empty(0)
    if state.shape != (4,):
        raise SwingupError(f"x = {quoted(x)}: pass four numbers, [q1, q2, dq1, dq2] (rad, rad/s)")
    return state


class TorqueSource(Protocol):
    """What computes torques for a loop, and knows nothing of limits and guards."""

    min_pause: float  # A call that comes sooner after the last one (s) keeps the torques
    period: float | None  # Time between calls that it expects (s); None for any

    def reset(self) -> None:
        """Forget the run so far."""

    def act(self, x: np.ndarray, t: float) -> np.ndarray:
        """The torques (2,) (N m) for the state x (4,) at time t (s)."""

    def remember(self, u: np.ndarray) -> None:
        """Note the torques (2,) (N m) that the motors were given."""


SourceT = TypeVar("SourceT", bound=TorqueSource)


class LoopController(Generic[SourceT]):
    """A controller as a loop calls it: torques within the motors' limits, perhaps behind a safety guard.

    One object serves one pendulum.
    """

    def __init__(
        self,
        inner: SourceT,
        robot: Robot,
        limits: tuple[float, float],
        guard: GuardSettings | None = None,
        watch: WiringWatch | None = None,
        zeros: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Take what computes the torques, both joints' limits (N m), what a guard watches, and the zeros (rad)."""
        self.inner, self.robot, self.torque_limits = inner, robot, limits
        self.guard = None if guard is None else Guard(guard, robot.joint, limits, watch)
        self._limits, self._zeros = np.array(limits), np.array([*zeros, 0.0, 0.0])
        self._passive = 1 - robot.joint
        self._own, self._acted, self._called, self._standstills = np.zeros(2), -math.inf, -math.inf, 0

    @property
    def fault(self) -> Fault | None:
        """Why the safety guard stopped the controller; None while it acts, or without a guard."""
        return None if self.guard is None else self.guard.fault

    @property
    def passive_limit(self) -> float:
        """Largest torque on the passive joint (N m), which compensates friction."""
        return self.torque_limits[1 - self.robot.joint]

    def reset(self) -> None:
        """Forget the run so far, and let a stopped controller act again."""
        self.inner.reset()
        self._acted = self._called = -math.inf
        if self.guard is not None:
            self.guard.reset()

    def __call__(
        self, x: np.ndarray, t: float, measured: np.ndarray | None = None, added: np.ndarray | None = None
    ) -> np.ndarray:
        """The torques [u1, u2] (N m), float64, for the state x (4,) (rad, rad/s) at time t (s).

        The guard looks at what was ``measured`` (4,), if a filter made x of it. Torques (2,) of the caller's (N m),
        such as a friction compensation of its own, are ``added`` before the sum is limited.

        Raises:
            SwingupError: x is not four numbers.
        """
        x, t = four_numbers(x) - self._zeros, float(t)
        seen = x if measured is None else measured - self._zeros
        if self.guard is not None and not self.guard.accepts_measurement(t, seen):
            return self.guard.stop_torques()
        # A clock that never moves must not hold a torque, nor an early call what a spoilt sample gave.
        self._called, self._standstills = t, self._standstills + 1 if t == self._called else 0
        early = self._acted <= t < self._acted + self.inner.min_pause and self._standstills <= MAX_STANDSTILLS
        keeps_torques = early and bool(np.isfinite(self._own).all())
        if not keeps_torques:
            self._own, self._acted = self.inner.act(x, t), t
        asked = self._own if added is None else self._own + added
        u = self._clip_torques(asked) if self.guard is None else self.guard.limit_torques(asked)
        # An estimator needs what the motors were given. The caller's torques belong to the plant, which then seems
        # to have less friction; else an identifier would compensate it once more.
        if not keeps_torques:
            self.inner.remember(u if added is None else self._clip_torques(u - added))
        return u

    def _clip_torques(self, u: np.ndarray) -> np.ndarray:
        """Torques within the limits; the driven joint's NaN stays, the passive one's becomes 0."""
        limited: np.ndarray = np.minimum(np.maximum(u, -self._limits), self._limits)
        if math.isnan(limited[self._passive]):
            limited[self._passive] = 0.0
        return limited


class LoopPolicy(Protocol):
    """What a loop must know of a policy besides its torques."""

    @property
    def robot(self) -> Robot: ...  # noqa: D102
    @property
    def plant(self) -> Plant: ...  # noqa: D102
    @property
    def guard(self) -> GuardSettings | None: ...  # noqa: D102
    @property
    def torque_limits(self) -> tuple[float, float]: ...  # noqa: D102


def guarded(source: SourceT, policy: LoopPolicy, guard: GuardChoice) -> LoopController[SourceT]:
    """A policy's controller from what computes its torques, behind the guard that the caller chose."""
    settings, joint = choose_guard(guard, policy.guard, source.period, policy.plant), policy.robot.joint
    watch = WiringWatch(policy.plant, joint, policy.torque_limits[joint], source.period) if settings else None
    return LoopController(source, policy.robot, policy.torque_limits, settings, watch, policy.plant.zeros)
