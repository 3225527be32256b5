"""A first estimate by linear least squares: the change of momentum over 50 ms is the impulse of all torques.

The rows of ``plant.momentum``, summed over a short time, are linear in the base parameters. No acceleration is
needed, and no start is guessed, so the same equations tell joints that are swapped or reversed, before any fit.
Noise in the regressors makes the estimate a start for the fit, no more than that.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import lsq_linear

from ...common.errors import SwingupError
from ...plant.base_parameters import BASE, BASE_NAMES
from ...plant.maths import NUMPY
from ...plant.momentum import momentum_rows
from ..log.recording import Recording
from ..log.smoothing import REACH, smooth
from ..log.windows import LEAST_SPEED, cumulative_torque
from .prediction import INDEX, Setting

SPAN = 0.05
"""Time over which momenta change (s)."""
POINTS = 10
"""Rows that are summed for it."""
STEP = SPAN / POINTS
"""Time between the states of a span (s): momenta are those of the middles between two of them."""
OFFSETS = STEP * (np.arange(POINTS + 2) - 0.5)
"""Times of its states (s): the first and the last middle are its ends."""
ARRAYS = NUMPY._replace(
    sine_cosine=lambda angle: (np.sin(angle), np.cos(angle)), arctan=np.arctan, log1p=np.log1p, where=np.where
)
COMMAND_AGE = 0.004
"""Typical age of a command when it acts (s)."""

LARGEST_FACTOR = 5.0
"""Largest factor between masses and inertias and the starting plant's."""
SUSPICIOUS = 0.02
"""Unexplained share of the impulses below which the columns count as right."""
BETTER, GOOD = 0.4, 0.15
"""The columns count as wrong if a hypothesis leaves at most this part of their unexplained share, and at most this
share."""
FOREIGN, FOREIGN_UNDRIVEN = 0.4, 0.05
"""Unexplained shares, with and without torques, above which the log is of something else than such a pendulum."""
LEAST_SPANS = 15
"""Spans of a log from which its columns are judged."""


@dataclass(frozen=True)
class Spans:
    """Short stretches of motion: states within each, and the impulses of the torques."""

    states: Float[np.ndarray, "spans points 4"]
    impulse: Float[np.ndarray, "spans 2"]
    """N m s"""


@dataclass(frozen=True)
class Solution:
    """A solution of the regression."""

    values: Mapping[str, float]
    unexplained: float
    """Share of the sum of squares of all impulses that is left."""


def cut_spans(recording: Recording) -> Spans:
    """Stretches of 50 ms in which a joint moves."""
    starts = np.arange(2 * REACH, recording.duration - SPAN - REACH, SPAN)
    grid = starts[:, None] + OFFSETS
    states = smooth(recording, grid.ravel()).reshape(*grid.shape, 4)
    age = COMMAND_AGE if recording.commanded else 0.0
    total = cumulative_torque(recording, np.stack([starts, starts + SPAN], axis=1) - age)
    moving = np.abs(states[..., 2:]).max(axis=(1, 2)) > LEAST_SPEED
    rows = np.flatnonzero(recording.gaps)
    for begins, ends in zip(recording.time[rows], recording.time[rows + 1], strict=True):
        moving &= (starts + SPAN + REACH < begins) | (starts - REACH > ends)
    return Spans(states[moving], (total[:, 1] - total[:, 0])[moving])


def regress(setting: Setting, spans: Spans, start: Float[np.ndarray, "15"], driven: bool) -> Solution:
    """Base parameters within a factor of 5 of the start's, and friction.

    Args:
        setting: the lengths, gravity and gear ratio.
        spans: of one or several recordings.
        start: the starting plant's vector.
        driven: whether torques set the scale; otherwise m1 r1 + m2 l1 is the start's.
    """
    matrix, right = regression_matrix(setting, spans), spans.impulse.ravel()
    low, high = _bounds(setting, start, driven)
    size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-30)
    found = np.clip(lsq_linear(matrix / size, right, (low * size, high * size)).x / size, low, high)
    left, parts = right - matrix @ found, matrix * found
    values = {name: float(value) for name, value in zip(BASE_NAMES, found, strict=True)}
    return Solution(values, float(left @ left) / max(float(right @ right + np.sum(parts**2)), 1e-30))


def check_joints(recordings: Sequence[Recording], setting: Setting, start: Float[np.ndarray, "15"]) -> None:
    """Refuse logs whose columns explain the motion much better in another order, sign or unit."""
    for recording in recordings:
        spans, driven = cut_spans(recording), any(recording.driven)
        if len(spans.states) < LEAST_SPANS:
            continue
        plain = regress(setting, spans, start, driven).unexplained
        if plain < SUSPICIOUS:
            continue
        # Without torques, angles that are too small by a factor of 57 fit any plant at rest.
        hypotheses = {text: read for text, read in _HYPOTHESES.items() if driven or read is not _radians}
        others = {
            text: regress(setting, read(spans), start, driven).unexplained for text, read in hypotheses.items()
        }
        best = min(others, key=lambda text: others[text])
        if others[best] < min(BETTER * plain, GOOD):
            raise SwingupError(
                f"{recording.name}: {best}: as it is, {min(plain, 1.0):.1%} of the impulses stay unexplained, and "
                f"{others[best]:.1%} otherwise; correct the columns"
            )
        if plain > (FOREIGN if driven else FOREIGN_UNDRIVEN):
            reason = "" if driven else "torques that are not in the log act, or "
            raise SwingupError(
                f"{recording.name}: {reason}the pendulum is not near the starting plant: {min(plain, 1.0):.1%} of "
                "the impulses stay unexplained; check units and columns, or give another --start"
            )


def _bounds(setting: Setting, start: np.ndarray, driven: bool) -> tuple[np.ndarray, np.ndarray]:
    masses, k = start[:4], start[INDEX["k"]]
    torque = setting.geometry.g * k
    rotor = max(10.0 * start[INDEX["Ir"]], start[INDEX["B"]] / setting.geometry.gr**2)
    low = np.array([*(masses / LARGEST_FACTOR), *np.zeros(5)])
    high = np.array([*(masses * LARGEST_FACTOR), 0.1 * torque, 0.1 * torque, 0.3 * torque, 0.3 * torque, rotor])
    if not driven:
        low[INDEX["k"]], high[INDEX["k"]] = 0.999 * k, 1.001 * k
    return low, high


def regression_matrix(setting: Setting, spans: Spans) -> Float[np.ndarray, "rows 9"]:
    """Rows: both joints of each span; columns: the impulses for a unit of each base parameter."""
    q1, q2 = spans.states[..., 0], spans.states[..., 1]
    before, middle, after = ((q1[:, k : k + POINTS], q2[:, k : k + POINTS]) for k in (0, 1, 2))
    rows = momentum_rows(before, middle, after, (STEP, STEP), setting.geometry, 0.0, ARRAYS)
    columns = [[np.sum(entry, axis=1) * STEP for entry in row[:BASE]] for row in rows]
    return np.transpose(columns, (2, 0, 1)).reshape(-1, BASE)


def _signs(q1: float, q2: float, u1: float, u2: float) -> Callable[[Spans], Spans]:
    return lambda spans: Spans(spans.states * np.array([q1, q2, q1, q2]), spans.impulse * np.array([u1, u2]))


def _swapped(spans: Spans) -> Spans:
    return Spans(spans.states[..., [1, 0, 3, 2]], spans.impulse[:, ::-1])


def _shifted(spans: Spans) -> Spans:
    return Spans(spans.states + np.array([np.pi, 0.0, 0.0, 0.0]), spans.impulse)


def _relative(spans: Spans) -> Spans:
    q1, q2, dq1, dq2 = np.moveaxis(spans.states, -1, 0)
    return Spans(np.stack([q1, q2 - q1, dq1, dq2 - dq1], axis=-1), spans.impulse)


def _radians(spans: Spans) -> Spans:
    return Spans(np.radians(spans.states), spans.impulse)


_HYPOTHESES: dict[str, Callable[[Spans], Spans]] = {
    "joints 1 and 2 look swapped": _swapped,
    "the angle of joint 2 looks absolute, not relative to link 1": _relative,
    "the angle of joint 1 looks measured from upright, not from hanging": _shifted,
    "the angles look like degrees": _radians,
    "the angle of joint 1 looks reversed": _signs(-1, 1, 1, 1),
    "the angle of joint 2 looks reversed": _signs(1, -1, 1, 1),
    "the torque of joint 1 looks reversed": _signs(1, 1, -1, 1),
    "the torque of joint 2 looks reversed": _signs(1, 1, 1, -1),
    "both torques look reversed": _signs(1, 1, -1, -1),
    "joint 2, with its torque, looks reversed": _signs(1, -1, 1, -1),
}
"""Ways to read the columns that a log may have been written in."""
