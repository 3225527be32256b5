"""What a log shows before any model is fitted: joints that rest, motors that saturate, time that jumps."""

import numpy as np
from jaxtyping import Bool, Float

from ...common.columns import UNITS
from ...common.errors import SwingupError

SHORTEST_LOG = 0.8
"""Least duration of a log (s): a window of prediction lasts 0.5 s."""
LEAST_ROWS = 6
"""Rows with a measurement of their own that a smoother needs: its cubic has four coefficients."""
LEAST_POSITIONS = 20
"""Different pairs of angles that a log needs: base parameters and friction are nine numbers and four."""
SLOWEST_PERIOD = 0.1
"""Longest median period (s): a pendulum moves too far between rows."""
SLOW_PERIOD = 0.0315
"""Median period (s) from which parameters come out wrong: those of C.1 by a quarter at 20 Hz."""
USUAL_PERIODS = (2e-4, 0.06)
"""Usual periods (s), which tell the unit of a time."""
LEAST_MOTION = 2e-3
"""Least range of an angle (rad)."""
SATURATED_SHARE = 0.25
"""Share of rows at the largest torque from which a motor counts as saturated."""
GAP, GAP_PERIODS = 0.06, 20.0
"""A longer time between rows, in s and in median periods, is a gap that no prediction crosses."""
SLOPE_WINDOW = 0.02
"""Time over which angles give velocities (s)."""


def check_time(name: str, time: Float[np.ndarray, "rows"], title: str) -> None:
    """Refuse a time that is not in seconds, and a log that is too short or too slow.

    The title is the word of ``--columns`` for the time, without a unit.
    """
    period = float(np.median(np.diff(time)))
    # A time in other units shows as a period that no loop has.
    usual = next(
        (unit for unit, size in UNITS["time"].items() if USUAL_PERIODS[0] <= period * size <= USUAL_PERIODS[1]), ""
    )
    if period > SLOWEST_PERIOD and usual and usual != "s":
        raise SwingupError(
            f"{name}: rows are {period:g} s apart (median): the time looks like {usual}; read it with "
            f"--columns {title}:{usual}"
        )
    if period > SLOWEST_PERIOD:
        raise SwingupError(
            f"{name}: rows are {period:g} s apart (median), too slow for a pendulum: record at 33 Hz or faster"
        )
    if time[-1] < SHORTEST_LOG:
        raise SwingupError(
            f"{name} lasts {time[-1]:g} s: at least {SHORTEST_LOG:g} s are needed, with time in seconds"
        )


def check_fresh(name: str, fresh: Bool[np.ndarray, "rows"], q: Float[np.ndarray, "rows 2"]) -> None:
    """Refuse a log with too few measurements, or too few positions."""
    count = int(np.count_nonzero(fresh))
    if count < LEAST_ROWS:
        raise SwingupError(
            f"{name} has {count} different rows, the others repeat the one before: at least {LEAST_ROWS} are needed"
        )
    # Rounded angles repeat, and repeated equations tell nothing new.
    positions = len(np.unique(q, axis=0))
    if positions < LEAST_POSITIONS:
        raise SwingupError(
            f"{name} has only {positions} different pairs of angles in {len(q)} rows: record a motion, with all "
            "digits of the angles"
        )


def check_motion(name: str, q: Float[np.ndarray, "rows 2"]) -> None:
    """Refuse a joint that never moves."""
    for joint, reach in enumerate(np.ptp(q, axis=0), start=1):
        if reach < LEAST_MOTION:
            raise SwingupError(
                f"{name}: joint {joint} never moves (its angle stays within {reach:.2g} rad): check the encoder, "
                "or leave this log out"
            )


def find_warnings(
    time: Float[np.ndarray, "rows"],
    u: Float[np.ndarray, "rows 2"],
    measured: Float[np.ndarray, "rows 2"] | None,
    fresh: Bool[np.ndarray, "rows"],
) -> list[str]:
    """What a user should know of a log that can be used: one line for each finding."""
    found = []
    periods = np.diff(time)
    period, longest = float(np.median(periods)), float(periods.max())
    if longest > longest_step(period):
        at = float(time[int(periods.argmax())])
        found.append(f"time jumps by {longest:.3g} s at {at:.3g} s: no prediction crosses the gap")
    if period > SLOW_PERIOD:
        found.append(f"rows are {period:.3g} s apart: below 33 Hz parameters come out wrong, by a quarter at 20 Hz")
    if not np.any(u):
        found.append("the torques are all zero: it counts as a free fall")
    for joint in (0, 1):
        peak = float(np.abs(u[:, joint]).max())
        # A torque that stands at its limit excites nothing while it stands.
        share = float(np.mean(np.abs(u[:, joint]) > 0.995 * peak)) if peak > 0 else 0.0
        if peak > 0 and np.ptp(u[:, joint]) == 0:
            found.append(f"torque {joint + 1} is {u[0, joint]:.3g} N m in every row: check its column")
        elif share > SATURATED_SHARE:
            found.append(f"torque {joint + 1} stands at ±{peak:.3g} N m in {share:.0%} of the rows: saturated")
        if measured is not None and peak > 0:
            delivered = float(np.abs(measured[:, joint]).max())
            at_most = float(np.mean(np.abs(measured[:, joint]) > 0.98 * delivered))
            # A motor that saturates stands at its peak; one that is slow passes through it.
            if delivered < 0.8 * peak and at_most > 0.05:
                most = f"{delivered:.3g} of {peak:.3g} N m"
                found.append(f"motor {joint + 1} delivers at most {most}: clip the log's commands to that")
    if (repeated := float(np.mean(~fresh))) > 0.05:
        found.append(f"{repeated:.0%} of the rows repeat the one before: they are left out")
    return found


def longest_step(period: float) -> float:
    """The longest time between rows that does not count as a gap (s), for a median ``period`` (s)."""
    return max(GAP, GAP_PERIODS * period)


def slopes_of(
    time: np.ndarray, q: np.ndarray, window: float = SLOPE_WINDOW, reach: int | None = None
) -> Float[np.ndarray, "rows 2"]:
    """Mean velocities (rad/s) over a window (s) about each row, or over a number of rows to each side of it."""
    reach = max(1, round(0.5 * window / float(np.median(np.diff(time))))) if reach is None else reach
    rows = np.arange(len(time))
    after, before = np.minimum(rows + reach, len(time) - 1), np.maximum(rows - reach, 0)
    return (q[after] - q[before]) / (time[after] - time[before])[:, None]
