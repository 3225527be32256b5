"""What a fit does not see: a whole log, or the last quarter of the motion in each."""

import numpy as np
from jaxtyping import Bool

from ..log.windows import Windows

LOGS = 3
"""From this number of logs on, one is held out whole."""
SHARE = 0.25
"""Of the windows of each log, at its end, otherwise."""


def held_out(windows: Windows) -> Bool[np.ndarray, "windows"]:
    """Windows to hold out, of all logs' windows.

    A log with few windows, such as a swing-up, may be the last: then the log with the median number is held out.
    """
    logs, counts = np.unique(windows.log, return_counts=True)
    if len(logs) >= LOGS:
        middle = logs[np.argsort(counts, kind="stable")[len(logs) // 2]]
        chosen: np.ndarray = windows.log == middle
        return chosen
    held = np.zeros(len(windows), bool)
    for log in logs:
        rows = np.flatnonzero(windows.log == log)
        held[rows[len(rows) - max(1, round(SHARE * len(rows))) :]] = True
    return held


def clear_of(windows: Windows, held: Windows, length: float, held_length: float) -> Bool[np.ndarray, "windows"]:
    """Windows of ``length`` (s) that share no time with held-out ones of ``held_length`` (s)."""
    free = np.ones(len(windows), bool)
    for log in np.unique(held.log):
        starts = held.time[held.log == log]
        apart = (windows.time[:, None] + length <= starts) | (windows.time[:, None] >= starts + held_length)
        free &= (windows.log != log) | apart.all(axis=1)
    return free
