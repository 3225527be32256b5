"""The five criteria of a swing-up and the RealAI score, from rows of time, state and torque.

Sums run over the rows k = 0 .. N-2 with Δt_k = t_{k+1} - t_k, standard deviations over the population.
"""

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from .rules import Normalisers, PerformanceRules

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


def judge(
    time: np.ndarray, x: np.ndarray, u: np.ndarray, l1: float, l2: float, rules: PerformanceRules
) -> Criteria:
    """Score a trajectory.

    Args:
        time: time of each row (s), shape (N,).
        x: state before each step [q1, q2, dq1, dq2] (rad, rad/s), shape (N, 4).
        u: torque applied at each step [u1, u2] (N m), shape (N, 2).
        l1: length of link 1 (m).
        l2: length of link 2 (m).
        rules: duration, line and normalisers.
    """
    dt = np.diff(time)
    swingup_time = _swingup_time(time, x, l1, l2, rules)
    long_enough = bool(time[-1] >= SHARE * rules.duration)
    costs = {
        "energy": float(np.sum(np.abs(np.diff(x[:, :2], axis=0) * u[:-1]))),
        "torque_cost": float(np.sum(np.sum(u[:-1] ** 2, axis=1) * dt)),
        "torque_smoothness": float(np.sum(np.std(np.diff(u, axis=0), axis=0))),
        "velocity_cost": float(np.sum(np.sum(x[:-1, 2:] ** 2, axis=1) * dt)),
    }
    if swingup_time is None or not long_enough:
        return Criteria(success=False, swingup_time=None, **costs, score=0.0)
    score = realai_score({"swingup_time": swingup_time, **costs}, rules.normalisers)
    return Criteria(success=True, swingup_time=swingup_time, **costs, score=score)


def failed(criteria: Criteria) -> Criteria:
    """The same costs without a success."""
    return replace(criteria, success=False, swingup_time=None, score=0.0)


def realai_score(costs: dict[str, float], normalisers: Normalisers) -> float:
    """1 - (1/5) Σ_i tanh(π c_i / n_i) of a successful run; names are those of :class:`Normalisers`."""
    names = [field.name for field in fields(normalisers)]
    penalties = [math.tanh(math.pi * costs[name] / getattr(normalisers, name)) for name in names]
    return 1.0 - sum(penalties) / len(penalties)


def tip_is_up(x: np.ndarray, l1: float, l2: float, fraction: float) -> np.ndarray:
    """Whether the tip is strictly above a fraction of l1 + l2, for states of shape (..., 4); lengths in m."""
    height = -l1 * np.cos(x[..., 0]) - l2 * np.cos(x[..., 0] + x[..., 1])
    return height > fraction * (l1 + l2)


def _swingup_time(time: np.ndarray, x: np.ndarray, l1: float, l2: float, rules: PerformanceRules) -> float | None:
    looked_at = tip_is_up(x, l1, l2, rules.height)[
        1:-1
    ]  # as the benchmark does: neither the first nor the last row
    if looked_at.size == 0 or not looked_at[-1]:
        return None
    below = np.flatnonzero(~looked_at)
    start = 0 if below.size == 0 else int(below[-1]) + 1
    return float(time[1 + start])
