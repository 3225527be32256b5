"""A first estimate by linear least squares: the change of momentum over 50 ms is the impulse of all torques.

The rows of ``plant.momentum``, summed over a short time, are linear in the base parameters. No acceleration is
needed, and no start is guessed, so the same equations tell joints that are swapped or reversed, before any fit.
Noise in the regressors makes the estimate a start for the fit, no more than that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.optimize import lsq_linear

from ...common.errors import SwingupError
from ...plant.base_parameters import BASE, BASE_NAMES
from ...plant.maths import NUMPY
from ...plant.momentum import momentum_rows
from ..log.recording import Recording
from ..log.segments import Segments, cut
from ..log.smoothing import REACH
from .prediction import INDEX, Integration

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
class Solution:
    """A solution of the regression."""

    values: Mapping[str, float]
    unexplained: float
    """Share of the sum of squares of all impulses that is left."""


def cut_spans(recording: Recording) -> Segments:
    """Segments of 50 ms in which a joint moves, with the impulse at both ends."""
    starts = np.arange(2 * REACH, recording.duration - SPAN - REACH, SPAN)
    age = COMMAND_AGE if recording.commanded else 0.0
    return cut(recording, starts, OFFSETS, (np.array([0.0, SPAN]), age), OFFSETS, SPAN)


def regress(setting: Integration, spans: Segments, start: Float[np.ndarray, "15"], driven: bool) -> Solution:
    """Base parameters within a factor of 5 of the start's, and friction.

    Torques set the scale; without any, m1 r1 + m2 l1 is the start's.
    """
    matrix, right = regression_matrix(setting, spans.states), np.diff(spans.impulse, axis=1).ravel()
    low, high = _bounds(setting, start, driven)
    size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-30)
    found = np.clip(lsq_linear(matrix / size, right, (low * size, high * size)).x / size, low, high)
    left, parts = right - matrix @ found, matrix * found
    values = {name: float(value) for name, value in zip(BASE_NAMES, found, strict=True)}
    return Solution(values, float(left @ left) / max(float(right @ right + np.sum(parts**2)), 1e-30))


def check_joints(recordings: Sequence[Recording], setting: Integration, start: Float[np.ndarray, "15"]) -> None:
    """Refuse logs whose columns explain the motion much better in another order, sign or unit."""
    for recording in recordings:
        spans, driven = cut_spans(recording), any(recording.driven)
        if len(spans) < LEAST_SPANS:
            continue
        plain = regress(setting, spans, start, driven).unexplained
        if plain < SUSPICIOUS:
            continue
        # Without torques, angles that are too small by a factor of 57 fit any plant at rest.
        texts = [text for text in _HYPOTHESES if driven or text != _DEGREES]
        others = {text: regress(setting, _read_as(spans, text), start, driven).unexplained for text in texts}
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


def _read_as(spans: Segments, hypothesis: str) -> Segments:
    joints, shift, torques = _HYPOTHESES[hypothesis]
    states = spans.states @ np.kron(np.eye(2), joints) + np.array([shift, 0.0, 0.0, 0.0])
    return replace(spans, states=states, impulse=spans.impulse @ torques)


def _bounds(setting: Integration, start: np.ndarray, driven: bool) -> tuple[np.ndarray, np.ndarray]:
    masses, k = start[:4], start[INDEX["k"]]
    torque = setting.geometry.g * k
    rotor = max(10.0 * start[INDEX["Ir"]], start[INDEX["B"]] / setting.geometry.gr**2)
    low = np.array([*(masses / LARGEST_FACTOR), *np.zeros(5)])
    high = np.array([*(masses * LARGEST_FACTOR), 0.1 * torque, 0.1 * torque, 0.3 * torque, 0.3 * torque, rotor])
    if not driven:
        low[INDEX["k"]], high[INDEX["k"]] = 0.999 * k, 1.001 * k
    return low, high


def regression_matrix(setting: Integration, states: Float[np.ndarray, "spans points 4"]) -> np.ndarray:
    """The matrix Y: both joints of each span in rows, and in columns the impulses for a unit of each parameter."""
    q1, q2 = states[..., 0], states[..., 1]
    before, middle, after = ((q1[:, k : k + POINTS], q2[:, k : k + POINTS]) for k in (0, 1, 2))
    rows = momentum_rows(before, middle, after, (STEP, STEP), setting.geometry, 0.0, ARRAYS)
    columns = [[np.sum(entry, axis=1) * STEP for entry in row[:BASE]] for row in rows]
    return np.transpose(columns, (2, 0, 1)).reshape(-1, BASE)


_SAME, _SWAP, _TURN1, _TURN2 = np.eye(2), np.eye(2)[::-1], np.diag([-1.0, 1.0]), np.diag([1.0, -1.0])
_DEGREES = "the angles look like degrees"
_HYPOTHESES: dict[str, tuple[np.ndarray, float, np.ndarray]] = {
    "joints 1 and 2 look swapped": (_SWAP, 0.0, _SWAP),
    "the angle of joint 2 looks absolute, not relative to link 1": (np.array([[1, -1], [0, 1]]), 0.0, _SAME),
    "the angle of joint 1 looks measured from upright, not from hanging": (_SAME, np.pi, _SAME),
    _DEGREES: (np.radians(_SAME), 0.0, _SAME),
    "the angle of joint 1 looks reversed": (_TURN1, 0.0, _SAME),
    "the angle of joint 2 looks reversed": (_TURN2, 0.0, _SAME),
    "the torque of joint 1 looks reversed": (_SAME, 0.0, _TURN1),
    "the torque of joint 2 looks reversed": (_SAME, 0.0, _TURN2),
    "both torques look reversed": (_SAME, 0.0, -_SAME),
    "joint 2, with its torque, looks reversed": (_TURN2, 0.0, _TURN2),
}
"""Other ways to read a log's columns: a matrix on the joints' angles and rates, an angle that is added to the
shoulder's (rad), and a matrix on their torques."""
