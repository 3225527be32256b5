"""Segments of recordings: smoothed states at equal times after a start, and the impulse of the torques.

Windows of fits, spans of the regression and predictions that are drawn are segments of different lengths.

Around a time t the smoother fits the cubic c0 + c1 s + c2 s² + c3 s³, s = row time - t, by least squares to the
rows within 20 ms; then q(t) = c0 and dq(t) = c1. A log at 33 Hz has fewer than six rows there: the six nearest are
taken. Rows that repeat a measurement are left out. The smoother knows no dynamics, and no model can change it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .log_checks import MINIMUM_ROWS, longest_step
from .recording import Recording

REACH = 0.02  # half width of the polynomial's support (s)
DEGREE = 3  # a parabola's slope would be wrong by q''' (20 ms)² / 10, which is 2 rad/s on links of 5 cm
CHUNK = 4096  # times that are smoothed at once, which bounds the memory


def smooth(recording: Recording, times: Float[np.ndarray, "times"]) -> Float[np.ndarray, "times 4"]:
    """The state [q1, q2, dq1, dq2] (rad, rad/s) at any times (s) within the recording."""
    time, q = recording.time[recording.fresh], recording.q[recording.fresh]
    blocks = [times[start : start + CHUNK] for start in range(0, len(times), CHUNK)]
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
    minimum = min(MINIMUM_ROWS, len(time))
    nearest = np.clip(np.searchsorted(time, times) - minimum // 2, 0, len(time) - minimum)
    few = high - low < minimum
    return np.where(few, nearest, low), np.where(few, nearest + minimum, high)


STRIDE = 0.1  # time between the starts of two windows (s)
FIT_LENGTH = 0.25  # length of the windows of a fit (s)
INTERVAL = 0.05  # time between the states of a window (s)
MINIMUM_SPEED = 1.0  # a segment in which no joint is faster (rad/s) has little information: it is left out

TORQUE_STEP = 0.0005  # spacing of the torques' integral over a window (s)
HISTORY = 0.06
"""Torques before the start of a window that are kept (s): the largest delay, and what a lag remembers."""
AHEAD = 0.02  # torques after the end of a window that are kept (s): measured torques may be late
BY_SEGMENT = ("log", "start", "states", "impulse")  # fields with an entry for each segment


@dataclass(frozen=True)
class Segments:
    """Segments of equal length, of one recording or several."""

    log: Int[np.ndarray, "segments"]  # Which recording each segment comes from
    start: Float[np.ndarray, "segments"]  # Start of each segment in its recording (s)
    offsets: Float[np.ndarray, "points"]  # Times of the states after the start (s)
    states: Float[np.ndarray, "segments points 4"]
    """[q1, q2, dq1, dq2] (rad, rad/s): smoothed, or predicted from the smoothed first one."""
    impulse: Float[np.ndarray, "segments grid 2"]
    """Integral of the torques since the recording's first row (N m s)."""

    def __len__(self) -> int:
        return len(self.start)

    @property
    def times(self) -> Float[np.ndarray, "segments points"]:
        """Times of the states in their recording (s)."""
        return self.start[:, None] + self.offsets

    def take(self, rows: np.ndarray) -> "Segments":
        """Select segments by their numbers or by truth values."""
        return replace(self, **{name: getattr(self, name)[rows] for name in BY_SEGMENT})


def cut_windows(
    recording: Recording, length: float, stride: float = STRIDE, log: int = 0, minimum_speed: float = MINIMUM_SPEED
) -> Segments:
    """Windows of ``length`` (s) every ``stride`` (s), with states ``INTERVAL`` apart.

    The first window starts one stride after the first row. Impulses are ``TORQUE_STEP`` apart, from
    ``HISTORY`` before the start to ``AHEAD`` after the end.
    """
    # The smoother needs rows to both sides of a window.
    last = recording.duration - length - REACH
    starts = stride * np.arange(1, max(1, int(last / stride + 1e-9) + 1))
    offsets = INTERVAL * np.arange(round(length / INTERVAL) + 1)
    grid = TORQUE_STEP * np.arange(round((HISTORY + length + AHEAD) / TORQUE_STEP) + 1)
    # Speeds every 10 ms: a joint may be fast between two states.
    speeds = 0.01 * np.arange(round(length / 0.01) + 1)
    return cut(recording, starts, Layout(length, offsets, speeds, grid, HISTORY), log, minimum_speed)


class Layout(NamedTuple):
    """Times of a segment after its start (s)."""

    length: float
    states: Float[np.ndarray, "points"]
    speeds: Float[np.ndarray, "looks"]  # at which joints may be fast
    impulse: Float[np.ndarray, "grid"]  # counted from ``history`` before the start
    history: float


def cut(
    recording: Recording,
    starts: Float[np.ndarray, "starts"],
    layout: Layout,
    log: int = 0,
    minimum_speed: float = MINIMUM_SPEED,
) -> Segments:
    """Segments with these starts (s) that cross no gap and in which a joint is faster than ``minimum_speed``."""
    starts = starts[clear_of_gaps(recording, starts, starts + layout.length)]
    # Speeds first: states and impulses are far more numbers, and most starts of a log at rest are left out.
    speeds = np.abs(_smoothed(recording, starts[:, None] + layout.speeds)[..., 2:]).max(axis=(1, 2), initial=0.0)
    starts = starts[speeds > minimum_speed]
    states = _smoothed(recording, starts[:, None] + layout.states)
    impulse = cumulative_torque(recording, starts[:, None] + layout.impulse - layout.history)
    return Segments(np.full(len(starts), log), starts, layout.states, states, impulse)


def clear_of_gaps(
    recording: Recording, begin: Float[np.ndarray, "spans"], end: Float[np.ndarray, "spans"]
) -> Bool[np.ndarray, "spans"]:
    """Whether spans of a log from ``begin`` to ``end`` (s), with what the smoother sees beyond, cross no gap."""
    gaps, seen = np.flatnonzero(recording.gaps), recording.time[recording.fresh]
    # A sensor may be slower than the loop: its own rows are what the smoother sees.
    period = float(np.median(np.diff(seen)))
    holes, reach = np.flatnonzero(np.diff(seen) > longest_step(period)), max(REACH, 3.0 * period)
    lefts = np.concatenate([recording.time[gaps], seen[holes]])
    rights = np.concatenate([recording.time[gaps + 1], seen[holes + 1]])
    clear = np.ones(len(begin), bool)
    for left, right in zip(lefts, rights, strict=True):
        clear &= (right <= begin - reach) | (left >= end + reach)
    return clear


def join(parts: Sequence[Segments]) -> Segments:
    """The segments of several recordings, in order."""
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in BY_SEGMENT}
    return replace(parts[0], **columns)


def _smoothed(recording: Recording, times: Float[np.ndarray, "segments points"]) -> np.ndarray:
    return smooth(recording, times.ravel()).reshape(*times.shape, 4)


def cumulative_torque(recording: Recording, times: Float[np.ndarray, "*times"]) -> Float[np.ndarray, "*times 2"]:
    """Integral of the torques from the first row to any times (N m s): each row's torque holds until the next."""
    time, u = recording.time, recording.u * np.asarray(recording.driven)
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(u[:-1] * np.diff(time)[:, None], axis=0)])
    # Beyond the rows the last torque holds; before them it is zero.
    time = np.append(time, time[-1] + 1.0)
    total = np.append(total, total[-1:] + u[-1:], axis=0)
    columns = [np.interp(times.ravel(), time, total[:, joint]).reshape(times.shape) for joint in (0, 1)]
    return np.stack(columns, axis=-1)
