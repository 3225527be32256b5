"""Recordings of a run, from a simulation or a robot: the rows that count, and those that every score refuses."""

import numpy as np
from jaxtyping import Float

from ..common.errors import SwingupError
from .rollout import Trajectory

START = 0.2
"""A run's first time is within this of 0 (s): six periods of the slowest recordings, which have 33 Hz."""

SHORTEST = 1e-6
"""A period below this (s) is not measured in seconds."""

LEAST = 3
"""Rows of which costs can be summed."""

CheckedRows = tuple[Float[np.ndarray, "rows"], Float[np.ndarray, "rows 4"], Float[np.ndarray, "rows 2"]]


def checked_rows(trajectory: Trajectory) -> CheckedRows:
    """The times (s), states (rad, rad/s) and torques (N m) of a trajectory, in float64.

    Raises:
        SwingupError: the trajectory has fewer than 3 rows, rows of other shapes, values that are not finite, or
            times that do not increase, are hardly apart or start far from 0.
    """
    time, x, u = (np.asarray(rows, np.float64) for rows in (trajectory.time, trajectory.x, trajectory.u))
    rows = time.size
    if rows < LEAST or time.shape != (rows,) or x.shape != (rows, 4) or u.shape != (rows, 2):
        shapes = f"{time.shape}, {x.shape} and {u.shape}"
        raise SwingupError(f"time, x and u have shapes {shapes}: pass (N,), (N, 4) and (N, 2) with N of 3 or more")
    if not (np.isfinite(time).all() and np.isfinite(x).all() and np.isfinite(u).all()):
        raise SwingupError("the trajectory holds values that are not finite: end it before them")
    if not np.all(np.diff(time) > 0):
        raise SwingupError("the trajectory's times do not increase: keep one run, in order")
    usual = float(np.median(np.diff(time)))
    if usual < SHORTEST:
        raise SwingupError(f"the trajectory's rows are {usual:g} s apart (median): give its times in seconds")
    if abs(time[0]) > START:
        raise SwingupError(f"the trajectory starts at t = {time[0]:g} s: give its times as seconds since its start")
    return time, x, u


def recorded(rows: Trajectory, duration: float) -> Trajectory:
    """What counts of one simulated run of a duration (s): rows until it diverged, it stopped, or time was up.

    On a robot it is what the robot writes down: measured states, and the torques that were asked for.

    Args:
        rows: the simulation; late turns make it longer than the run.
        duration: length of the run (s).
    """
    time, x, u = (np.asarray(part) for part in (rows.time, rows.x, rows.u))
    kept = time < duration
    if rows.record is not None:
        x, u = np.asarray(rows.record.x), np.asarray(rows.record.u)
        kept &= ~np.asarray(rows.record.over)
    kept &= np.logical_and.accumulate(np.isfinite(x).all(axis=1))
    kept[:LEAST] = True
    return Trajectory(time[kept], x[kept], u[kept])


def stopped_at(rows: Trajectory, duration: float) -> float | None:
    """When the robot stopped one run of a duration (s), if it did (s)."""
    if rows.record is None:
        return None
    times = np.asarray(rows.time)[np.asarray(rows.record.over)]
    return float(times[0]) if times.size and times[0] < duration else None
