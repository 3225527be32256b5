"""Angles and velocities between rows: a local polynomial over ±20 ms, the reference of fits and scores.

Around a time t the cubic c0 + c1 s + c2 s² + c3 s³, s = row time - t, is fitted by least squares to the rows within
20 ms; then q(t) = c0 and dq(t) = c1. A log at 33 Hz has fewer than six rows there: the six nearest are taken.
Rows that repeat a measurement are left out. The smoother knows no dynamics, and no model can change it.
"""

import numpy as np
from jaxtyping import Float

from .log_checks import LEAST_ROWS
from .recording import Recording

REACH = 0.02
"""Half width of the polynomial's support (s)."""
DEGREE = 3
"""A parabola's slope would be wrong by q''' (20 ms)² / 10, which is 2 rad/s on links of 5 cm."""
BLOCK = 4096
"""Times that are smoothed at once, which bounds the memory."""


def smooth(recording: Recording, times: Float[np.ndarray, "times"]) -> Float[np.ndarray, "times 4"]:
    """The state [q1, q2, dq1, dq2] (rad, rad/s) at any times (s) within the recording."""
    time, q = recording.time[recording.fresh], recording.q[recording.fresh]
    blocks = [times[start : start + BLOCK] for start in range(0, len(times), BLOCK)]
    return np.concatenate([_smooth_block(time, q, block) for block in blocks]) if blocks else np.zeros((0, 4))


def _smooth_block(time: np.ndarray, q: np.ndarray, times: np.ndarray) -> np.ndarray:
    low, high = _supports(time, times)
    rows = low[:, None] + np.arange(int((high - low).max()))
    inside = rows < high[:, None]
    rows = np.minimum(rows, len(time) - 1)
    distance = time[rows] - times[:, None]
    # In units of the support, so that the normal equations are well conditioned.
    unit = np.abs(np.where(inside, distance, 0.0)).max(axis=1, keepdims=True)
    powers = (distance / unit)[..., None] ** np.arange(DEGREE + 1) * inside[..., None]
    # Angles about their first row: those of many turns would lose digits.
    origin = q[low]
    values = (q[rows] - origin[:, None]) * inside[..., None]
    normal = np.einsum("tra,trb->tab", powers, powers)
    found = np.linalg.solve(normal, np.einsum("tra,trj->taj", powers, values))
    return np.concatenate([origin + found[:, 0], found[:, 1] / unit], axis=1)


def _supports(time: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first row of each time's support and the one after its last."""
    # A millionth of a second more, so that rounding does not decide on the rows at the ends.
    low = np.searchsorted(time, times - REACH - 1e-6, "left")
    high = np.searchsorted(time, times + REACH + 1e-6, "right")
    least = min(LEAST_ROWS, len(time))
    nearest = np.clip(np.searchsorted(time, times) - least // 2, 0, len(time) - least)
    few = high - low < least
    return np.where(few, nearest, low), np.where(few, nearest + least, high)
