"""Times of a table's rows: rounded ones are spread, and a clock that restarts goes on."""

import itertools

import numpy as np
from jaxtyping import Bool, Float

LEAST_ROWS = 20
"""Rows that show an even rate."""
LEAST_SHARE = 0.2
"""Share of rows that repeat a time from which times are rounded; fewer are faults."""


def spread_evenly(time: Float[np.ndarray, "rows"]) -> Float[np.ndarray, "rows"] | None:
    """Even times for rows whose times were rounded so far that several share one; None if they are not that."""
    steps = np.diff(time)
    if len(time) < LEAST_ROWS or np.any(steps < 0) or np.mean(steps == 0) < LEAST_SHARE or not np.any(steps > 0):
        return None
    rows, resolution = np.arange(len(time)), float(np.median(steps[steps > 0]))
    even = np.polyval(np.polyfit(rows, time, 1), rows)
    if np.abs(even - time).max() > 1.01 * resolution:
        return None
    return np.asarray(even - even[0] + time[0])


def one_clock(
    time: Float[np.ndarray, "rows"], longest: float, pause: float
) -> tuple[Bool[np.ndarray, "rows"], Float[np.ndarray, "rows"], int, int]:
    """Times that increase, for episodes that each have their own clock, in which rows may come late or twice.

    Args:
        time: as recorded (s).
        longest: time between rows that is a gap (s).
        pause: time between two episodes of the result (s).

    Returns:
        The rows to keep, their times, the number of restarts, and the number of rows whose times were spread.
    """
    steps = np.diff(time)
    restarts = np.flatnonzero(steps < -longest) + 1
    pieces, offset, spread = [], 0.0, 0
    keep = np.zeros(len(time), bool)
    for start, end in itertools.pairwise([0, *restarts.tolist(), len(time)]):
        own = time[start:end]
        cuts = np.flatnonzero(np.diff(own) > longest) + 1
        parts = [spread_evenly(part) for part in np.split(own, cuts)]
        spread += sum(len(part) for part in parts if part is not None)
        own = np.concatenate(
            [old if new is None else new for new, old in zip(parts, np.split(own, cuts), strict=True)]
        )
        own = own - own[0] + offset
        keep[start:end] = np.concatenate([[True], own[1:] > np.maximum.accumulate(own)[:-1]])
        pieces.append(own[keep[start:end]])
        offset = pieces[-1][-1] + pause
    return keep, np.concatenate(pieces), len(restarts), spread
