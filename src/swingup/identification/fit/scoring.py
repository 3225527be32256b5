"""The fixed scoring of predictions: errors after 0.1, 0.25 and 0.5 s, over windows that no model can choose.

Windows of 0.5 s start every 0.1 s where a joint is faster than 1 rad/s. A prediction starts from the smoothed
measurement, and its start is never optimised. It is compared with the smoothed measurement. The error is the root
mean square over all windows and both joints.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ..log.recording import Recording
from ..log.segments import FIT_LENGTH, INTERVAL, Segments, cut_windows, join
from .prediction import CHUNK, INDEX, LARGEST_ERROR, Integration, predict

HORIZONS = (0.1, 0.25, 0.5)
"""s"""
LENGTH = max(HORIZONS)
WHOLE_LOGS = 3
"""From this number of logs on, one is held out whole."""
HELD_SHARE = 0.25
"""Share of the windows of each log that are held out, at its end, where there are fewer logs."""


@dataclass(frozen=True)
class ErrorRow:
    """Errors of some windows after one time."""

    windows: int
    angle: float | None
    """Root mean square over windows and joints (rad); None without windows."""
    velocity: float | None
    """Root mean square of the velocities' errors (rad/s)."""
    angle_median: float | None
    """Median over windows of the root mean square over joints (rad)."""
    velocity_median: float | None
    """Median over windows of the root mean square over joints (rad/s)."""


Errors = Mapping[str, ErrorRow]
"""By horizon (s), as in "0.25"."""


def score_windows(recordings: Sequence[Recording]) -> Segments:
    """The windows that the scoring looks at."""
    return join([cut_windows(recording, LENGTH, log=log) for log, recording in enumerate(recordings)])


def prediction_errors(
    setting: Integration, models: Float[np.ndarray, "logs 15"], windows: Segments
) -> Float[np.ndarray, "windows outputs 4"]:
    """Predicted minus smoothed states; each log has its model."""
    errors = np.zeros_like(windows.states[:, 1:])
    for log in np.unique(windows.log):
        rows = windows.log == log
        errors[rows] = predict(setting, models[log], windows.take(rows)) - windows.states[rows, 1:]
    return np.clip(np.nan_to_num(errors, nan=LARGEST_ERROR), -LARGEST_ERROR, LARGEST_ERROR)


def summarise(errors: Float[np.ndarray, "windows outputs 4"], horizons: Sequence[float] = HORIZONS) -> Errors:
    """Errors by horizon."""
    return {f"{horizon:g}": error_row(errors[:, round(horizon / INTERVAL) - 1]) for horizon in horizons}


def error_row(errors: Float[np.ndarray, "windows 4"]) -> ErrorRow:
    """Summarise the errors of windows after one time: of both angles, and of both velocities."""
    if not len(errors):
        return ErrorRow(0, None, None, None, None)
    squares = np.stack([np.mean(errors[:, :2] ** 2, axis=1), np.mean(errors[:, 2:] ** 2, axis=1)])
    means, medians = np.sqrt(squares.mean(axis=1)), np.sqrt(np.median(squares, axis=1))
    return ErrorRow(len(errors), float(means[0]), float(means[1]), float(medians[0]), float(medians[1]))


def hold_out(everything: Segments, windows: Segments) -> tuple[Segments, Segments]:
    """What is judged of all windows of the scoring, and what is fitted: windows that share no time with them."""
    judged = everything.take(_held_out(everything))
    free = np.ones(len(windows), bool)
    for log in np.unique(judged.log):
        held, starts = judged.start[judged.log == log], windows.start[:, None]
        # Windows overlap: one that shares any time with a judged one has seen its motion.
        apart = (starts + FIT_LENGTH <= held) | (starts >= held + LENGTH)
        free &= (windows.log != log) | apart.all(axis=1)
    return judged, windows.take(free)


def _held_out(windows: Segments) -> Bool[np.ndarray, "windows"]:
    logs, counts = np.unique(windows.log, return_counts=True)
    if len(logs) >= WHOLE_LOGS:
        # A log with few windows, such as a swing-up, may be the last: the one with the median number is held out.
        middle = logs[np.argsort(counts, kind="stable")[len(logs) // 2]]
        return np.asarray(windows.log == middle)
    held = np.zeros(len(windows), bool)
    for log in logs:
        rows = np.flatnonzero(windows.log == log)
        held[rows[len(rows) - max(1, round(HELD_SHARE * len(rows))) :]] = True
    return held


def prediction_skill(
    recording: Recording, setting: Integration, start: Float[np.ndarray, "15"], values: Mapping[str, float]
) -> float:
    """Error of the angles after 0.25 s as a share of their motion (medians), by the better of two plants.

    128 of the log's windows count. The other plant has other base parameters than the starting one.
    """
    windows, output = score_windows([recording]), round(FIT_LENGTH / INTERVAL)
    if not len(windows):
        return np.inf
    # As many as one call of the compiled program predicts.
    windows = windows.take(np.linspace(0, len(windows) - 1, min(len(windows), CHUNK)).astype(int))
    other = start.copy()
    other[[INDEX[name] for name in values]] = list(values.values())
    moved = np.linalg.norm(windows.states[:, output, :2] - windows.states[:, 0, :2], axis=1)
    errors = [prediction_errors(setting, model[None], windows)[:, output - 1, :2] for model in (start, other)]
    return float(min(np.median(np.linalg.norm(each, axis=1)) for each in errors) / max(np.median(moved), 1e-9))
