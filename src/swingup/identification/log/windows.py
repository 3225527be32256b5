"""Windows of a recording: where a prediction starts, the torques that drive it, and what it should reach."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from .recording import Recording
from .smoothing import REACH, smooth

STRIDE = 0.1
"""Time between the starts of two windows (s)."""
FIT_LENGTH = 0.25
"""Length of the windows of a fit (s)."""
INTERVAL = 0.05
"""Time between the states that a prediction reports (s)."""
LEAST_SPEED = 1.0
"""A window in which no joint is faster (rad/s) says little: it is left out."""

TORQUE_STEP = 0.0005
"""Spacing of the torques' integral (s)."""
HISTORY = 0.06
"""Torques before the start of a window that are kept (s): the largest delay, and what a lag remembers."""
AHEAD = 0.02
"""Torques after the end of a window that are kept (s): measured torques may be late."""


@dataclass(frozen=True)
class Windows:
    """Windows of equal length, of one recording or several."""

    log: Int[np.ndarray, "windows"]
    """Which recording each window comes from."""
    time: Float[np.ndarray, "windows"]
    """Start of each window in its recording (s)."""
    start: Float[np.ndarray, "windows 4"]
    """The smoothed state [q1, q2, dq1, dq2] at the start."""
    impulse: Float[np.ndarray, "windows grid 2"]
    """Integral of the torques (N m s) at times ``TORQUE_STEP`` apart, from ``HISTORY`` before the start."""
    reference: Float[np.ndarray, "windows outputs 4"]
    """Smoothed states at ``INTERVAL``, 2 ``INTERVAL``, ... after the start."""

    def __len__(self) -> int:
        return len(self.time)

    def take(self, rows: Int[np.ndarray, "chosen"]) -> "Windows":
        """Some of the windows."""
        return Windows(self.log[rows], self.time[rows], self.start[rows], self.impulse[rows], self.reference[rows])


def cut_windows(
    recording: Recording, length: float, stride: float = STRIDE, log: int = 0, least_speed: float = LEAST_SPEED
) -> Windows:
    """Windows of ``length`` (s) every ``stride`` (s) in which a joint is faster than ``least_speed`` (rad/s).

    The first window starts one stride after the first row; no window crosses a gap.
    """
    outputs = round(length / INTERVAL)
    last = recording.duration - length - REACH
    starts = stride * np.arange(1, max(1, int(last / stride + 1e-9) + 1))
    starts = starts[[_is_whole(recording, start, length) for start in starts]] if starts.size else starts
    times = starts[:, None] + INTERVAL * np.arange(outputs + 1)
    # Speeds every 10 ms: a joint may be fast between two states that are reported.
    fine = starts[:, None] + 0.01 * np.arange(round(length / 0.01) + 1)
    speeds = smooth(recording, fine.ravel()).reshape(*fine.shape, 4)[..., 2:]
    moving = np.abs(speeds).max(axis=(1, 2)) > least_speed if starts.size else np.zeros(0, bool)
    starts, times = starts[moving], times[moving]
    states = smooth(recording, times.ravel()).reshape(len(starts), outputs + 1, 4)
    grid = starts[:, None] + TORQUE_STEP * np.arange(grid_size(length)) - HISTORY
    return Windows(
        log=np.full(len(starts), log),
        time=starts,
        start=states[:, 0],
        impulse=cumulative_torque(recording, grid),
        reference=states[:, 1:],
    )


def join(parts: Sequence[Windows]) -> Windows:
    """The windows of several recordings, in order."""
    names = ("log", "time", "start", "impulse", "reference")
    return Windows(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def grid_size(length: float) -> int:
    """Number of points of the torques' integral for windows of ``length`` (s)."""
    return round((HISTORY + length + AHEAD) / TORQUE_STEP) + 1


def _is_whole(recording: Recording, start: float, length: float) -> bool:
    """Whether a window and the supports of its smoother have no gap."""
    rows = np.flatnonzero(recording.gaps)
    begins, ends = recording.time[rows], recording.time[rows + 1]
    return not bool(np.any((ends > start - REACH) & (begins < start + length + REACH)))


def cumulative_torque(recording: Recording, times: Float[np.ndarray, "*times"]) -> Float[np.ndarray, "*times 2"]:
    """Integral of the torques from the first row to any times (N m s): each row's torque holds until the next."""
    time, u = recording.time, recording.u * np.asarray(recording.driven)
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(u[:-1] * np.diff(time)[:, None], axis=0)])
    # Beyond the rows the last torque holds; before them there is none.
    time = np.append(time, time[-1] + 1.0)
    total = np.append(total, total[-1:] + u[-1:], axis=0)
    columns = [np.interp(times.ravel(), time, total[:, joint]).reshape(times.shape) for joint in (0, 1)]
    return np.stack(columns, axis=-1)
