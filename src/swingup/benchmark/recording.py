"""Recordings of a run, simulated or of a robot: files, the rows that count, and those that every score refuses.

Files are CSV in RealAIGym's format: a header line and comma-separated columns, found by name. What the leaderboards
score is read and written: time, positions, velocities and torques. Other columns, such as feedback gains, are
ignored; ``controllers/swingups/reference.py`` has those.
"""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..common.errors import SwingupError
from ..common.table import read_table, write_columns
from ..loop.supervisors import Limits
from ..plant.plant import ROBOTS, Robot
from .rollout import Trajectory

MAX_START = 0.2
"""A run's first time is within this of 0 (s): six periods of the slowest recordings, which have 33 Hz."""

MIN_PERIOD = 1e-6  # A period below this (s) is not measured in seconds

DOMINANT_RATIO = 3.0  # A joint whose largest torque is this many times the other's is the driven one

MIN_ROWS = 3  # Rows of which costs can be summed

NO_ZEROS = (0.0, 0.0)  # Of encoders that show 0 where the pendulum hangs

# Measured columns first: the leaderboards score these.
_GROUPS = (
    (("time",),),
    (("pos_meas1", "pos_meas2"), ("pos1", "pos2")),
    (("vel_meas1", "vel_meas2"), ("vel1", "vel2")),
    (("tau_con1", "tau_con2"), ("tau1", "tau2")),
)
"""What is read (s, rad, rad/s, N m): the first complete choice of each group. The first choices are written."""


def save_trajectory(path: str | Path, trajectory: Trajectory, zeros: ArrayLike = NO_ZEROS) -> None:
    """Write a trajectory atomically, with enough digits to read the same float64 back.

    A file has the angles that the encoders show: from their ``zeros`` (rad).
    """
    x = np.asarray(trajectory.x) + np.append(zeros, NO_ZEROS) if np.any(zeros) else trajectory.x
    parts = (trajectory.time, x, trajectory.u)
    table = np.column_stack([np.asarray(part, np.float64) for part in parts])
    names = itertools.chain(*(choices[0] for choices in _GROUPS))
    write_columns(path, dict(zip(names, table.T, strict=True)))


def load_trajectory(path: str | Path, columns: Sequence[str] = (), zeros: ArrayLike = NO_ZEROS) -> Trajectory:
    """Read a trajectory as NumPy arrays in float64, cut to the shortest of its columns, less the encoders' zeros.

    Units as in ``time[ms]`` are converted; spaces, and a byte order mark or ``#`` before the header are accepted.
    ``columns`` are those of :func:`~swingup.common.table.read_table`. Refused are a column that is missing or there
    twice, fewer than three complete rows, a cell that is not a finite number, a time that does not increase.
    """
    table: Any = np.column_stack(list(read_table(path, _GROUPS, columns=columns).values.values()))
    return Trajectory(table[:, 0].copy(), table[:, 1:5] - np.append(zeros, NO_ZEROS), table[:, 5:].copy())


def checked_rows(trajectory: Trajectory, name: str = "the trajectory") -> Trajectory:
    """A trajectory in float64, refused unless its rows are finite, three or more, and in the order of time."""
    time, x, u = (np.asarray(rows, np.float64) for rows in (trajectory.time, trajectory.x, trajectory.u))
    rows = time.size
    if rows < MIN_ROWS or time.shape != (rows,) or x.shape != (rows, 4) or u.shape != (rows, 2):
        shapes = f"{time.shape}, {x.shape} and {u.shape}"
        wanted = "pass (N,), (N, 4) and (N, 2) with N of 3 or more"
        raise SwingupError(f"{name}: time, x and u have shapes {shapes}: {wanted}")
    if not (np.isfinite(time).all() and np.isfinite(x).all() and np.isfinite(u).all()):
        raise SwingupError(f"{name} holds values that are not finite: end it before them")
    if not np.all(np.diff(time) > 0):
        raise SwingupError(f"{name}: its times do not increase, keep one run, in order")
    return Trajectory(time, x, u)


def scorable_rows(trajectory: Trajectory) -> Trajectory:
    """A trajectory in float64, whose times are those of a run in seconds."""
    rows = checked_rows(trajectory)
    usual = float(np.median(np.diff(rows.time)))
    if usual < MIN_PERIOD:
        raise SwingupError(f"the trajectory's rows are {usual:g} s apart (median): give its times in seconds")
    if abs(start := float(rows.time[0])) > MAX_START:
        raise SwingupError(f"the trajectory starts at t = {start:g} s: give its times as seconds since its start")
    return rows


def recorded(rows: Trajectory, duration: float) -> tuple[Trajectory, float | None]:
    """What counts of one simulated run of a duration (s), and when the robot stopped it (s), if it did.

    It is the rows until the run diverged, it stopped, or time was up; on a robot what the robot writes down:
    measured states, and the torques that were asked for. Late turns make a simulation longer than the run.
    """
    time, x, u = (np.asarray(part) for part in (rows.time, rows.x, rows.u))
    kept, stop = (time < duration) & np.logical_and.accumulate(np.isfinite(x).all(axis=1)), None
    if rows.record is not None:
        x, u, over = (np.asarray(part) for part in (rows.record.x, rows.record.u, rows.record.over))
        stop = float(time[kept & over][0]) if (kept & over).any() else None
        kept &= ~over
    kept &= np.isfinite(x).all(axis=1)  # samples may be spoilt
    if np.count_nonzero(kept) < MIN_ROWS:
        kept[:MIN_ROWS] = True
    return Trajectory(time[kept], x[kept], u[kept]), stop


def stopped(rows: Trajectory, limits: Limits, duration: float) -> tuple[Trajectory, float | None]:
    """What counts of a recording where the robot stops beyond limits, and when it stops (s), if it does."""
    beyond = np.flatnonzero((np.abs(rows.x) > limits.bounds).any(axis=1) & (rows.time < duration))
    if not beyond.size:
        return rows, None
    return rows.take(slice(max(int(beyond[0]), MIN_ROWS))), float(rows.time[beyond[0]])


def driven_robot(name: str | Path, u: ArrayLike) -> Robot:
    """The robot whose joint has the torque u (rows, 2) (N m), or most of it: the other's friction is compensated.

    The name is the recording's, in messages.
    """
    size = np.abs(u).max(axis=0)
    joint = int(np.argmax(size))
    if size[joint] == 0.0 or size[joint] < DOMINANT_RATIO * size[1 - joint]:
        seen = "has no torque" if size[joint] == 0.0 else "drives both joints"
        raise SwingupError(f"{name} {seen}: name the robot with --robot {' or '.join(ROBOTS)}")
    return next(robot for robot in ROBOTS.values() if robot.joint == joint)
