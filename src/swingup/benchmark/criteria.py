"""The five criteria of a swing-up and the RealAI score, from rows of time, state and torque.

Sums run over the rows k = 0 .. N-2 with Δt_k = t_{k+1} - t_k, standard deviations over the population.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..loop.supervisors import Limits
from .rules import Normalisers

if TYPE_CHECKING:
    from .swing_up_board import SwingUpBoard

# The benchmark's own limit: a file whose last time is below it fails.
SHARE = 0.99
"""Part of the rules' duration that a run must span to score."""


@dataclass(frozen=True)
class Criteria:
    """Result of one swing-up."""

    success: bool
    """The tip was up from ``swingup_time`` to the end, and the run lasted long enough."""
    swingup_time: float | None
    """Start of the last unbroken stretch above the line that lasts to the end (s); None on failure."""
    energy: float
    """Σ over joints and rows |Δq_k u_k| (J)."""
    torque_cost: float
    """Σ u_kᵀ u_k Δt_k (N² m² s)."""
    torque_smoothness: float
    """Standard deviation of u_{k+1} - u_k, summed over the joints (N m)."""
    velocity_cost: float
    """Σ q̇_kᵀ q̇_k Δt_k (rad²/s)."""
    score: float
    """1 - (1/5) Σ tanh(π c_i / n_i) on success, else 0."""


CAUSES = ("never up", "beyond a limit", "fell", "up late", "stopped")
"""Kinds of failures: in the swing-up, at a limit of angle or speed in either phase, at the top, too slow, or ended
early, by a guard for instance."""


@dataclass(frozen=True)
class TipHistory:
    """The height of the tip during a run, and the reason of a failure."""

    highest: float
    """Largest height above the shoulder (m)."""
    reach: float
    """l1 + l2 (m)."""
    failure: str | None
    """Why the run failed; None if it succeeded."""
    cause: str | None = None
    """The kind of failure, one of ``CAUSES``."""

    @property
    def percent(self) -> float:
        """The largest height in percent of l1 + l2."""
        return 100.0 * self.highest / self.reach

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        heights = {"highest_tip": self.highest, "highest_tip_percent": self.percent}
        return heights | {"failure": self.failure, "cause": self.cause}


def compute_criteria(
    time: np.ndarray, x: np.ndarray, u: np.ndarray, l1: float, l2: float, rules: "SwingUpBoard"
) -> Criteria:
    """The criteria and the score of rows of time (s), states before each step and torques (N m) of links (m)."""
    dt = np.diff(time)
    # The benchmark looks neither at the first row nor at the last.
    up, times = tip_is_up(x, l1, l2, rules.height)[1:-1], time[1:-1]
    start = int(np.max(np.flatnonzero(~up), initial=-1)) + 1
    costs = {
        # Absolute values: the benchmark counts braking as work, too.
        "energy": float(np.sum(np.abs(np.diff(x[:, :2], axis=0) * u[:-1]))),
        "torque_cost": float(np.sum(np.sum(u[:-1] ** 2, axis=1) * dt)),
        "torque_smoothness": float(np.sum(np.std(np.diff(u, axis=0), axis=0))),
        "velocity_cost": float(np.sum(np.sum(x[:-1, 2:] ** 2, axis=1) * dt)),
    }
    # It compares the last time. The boards test the span as well.
    if start == up.size or time[-1] < SHARE * rules.duration:
        return Criteria(success=False, swingup_time=None, **costs, score=0.0)
    swingup_time = float(times[start])
    score = realai_score({"swingup_time": swingup_time, **costs}, rules.normalisers)
    return Criteria(success=True, swingup_time=swingup_time, **costs, score=score)


def follow_tip(time: np.ndarray, x: np.ndarray, l1: float, l2: float, rules: "SwingUpBoard") -> TipHistory:
    """How high the tip came, and why the run failed, if it did: also at limits, unless the robot stops there."""
    reach, hold, failure, cause = l1 + l2, rules.hold, None, None
    highest, every = float(tip_heights(x, l1, l2).max()), tip_is_up(x, l1, l2, rules.height)
    # The benchmark looks neither at the first row nor at the last.
    up, times = every[1:-1], time[1:-1]
    if rules.limits and not rules.stops and (passed := _limit_passed(time, x, every, rules.limits)):
        failure, cause = passed, "beyond a limit"
    elif not up.any():
        cause = "never up"
        failure = f"never up: the tip reached {highest:.3f} m and must pass {rules.height * reach:g} m"
    elif not up[-1]:
        last, cause = int(np.flatnonzero(up)[-1]), "fell"
        failure = f"up at t = {times[int(up.argmax())]:.3f} s, fell at t = {times[last + 1]:.3f} s"
    # Both the benchmark's limit on the last time and ours on the span.
    elif min(time[-1], time[-1] - time[0]) < SHARE * rules.duration:
        failure, cause = f"it spans {time[-1] - time[0]:g} s, below {SHARE:.0%} of {rules.duration:g} s", "stopped"
    elif hold is not None and not every[time >= rules.duration - hold].all():
        since = time[min(int(np.flatnonzero(~every)[-1]) + 1, len(time) - 1)]
        failure, cause = f"up for good at t = {since:.3f} s only, not for the last {hold:g} s", "up late"
    return TipHistory(highest, reach, failure, cause)


def _limit_passed(time: np.ndarray, x: np.ndarray, up: np.ndarray, limits: Limits) -> str | None:
    """Which joint first passed which limit, when and in which phase."""
    most = np.array([limits.angle, limits.angle, limits.speed, limits.speed])
    # Negated, so that a state that has diverged is beyond them.
    beyond = ~(np.abs(x) <= most)
    if not beyond.any():
        return None
    row = int(beyond.any(axis=1).argmax())
    place = int(beyond[row].argmax())
    phase = "at the top" if up[:row].any() else "swinging up"
    limit = f"{most[place]:.4g} {'rad' if place < 2 else 'rad/s'}"
    joint = ("shoulder", "elbow")[place % 2]
    return f"{phase}, the {joint} passes {limit} at t = {time[row]:.3f} s"


def realai_score(costs: Mapping[str, Any], normalisers: Normalisers, tanh: Callable[..., Any] = math.tanh) -> Any:
    """1 - (1/5) Σ_i tanh(π c_i / n_i) of a successful run; names are those of :class:`Normalisers`."""
    penalties = [tanh(math.pi * costs[name] / most) for name, most in vars(normalisers).items()]
    return 1.0 - sum(penalties) / len(penalties)


def tip_is_up(x: np.ndarray, l1: float, l2: float, fraction: float) -> np.ndarray:
    """Whether the tip is strictly above a fraction of l1 + l2, for states of shape (..., 4); lengths in m."""
    return tip_heights(x, l1, l2) > fraction * (l1 + l2)


def tip_heights(x: np.ndarray, l1: float, l2: float) -> np.ndarray:
    """Height of the tip above the shoulder (m), for states of shape (..., 4); lengths in m."""
    height: np.ndarray = -l1 * np.cos(x[..., 0]) - l2 * np.cos(x[..., 0] + x[..., 1])
    return height
