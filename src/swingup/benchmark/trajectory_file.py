"""Trajectories as CSV files in RealAIGym's format: a header line and comma-separated columns, found by name.

What the leaderboards score is read and written: time, positions, velocities and torques. Other columns, such as
feedback gains, are ignored; ``controllers/swingups/reference.py`` has those.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..common.table import read_table, write_columns
from .rollout import Trajectory

FILE_COLUMNS = ("time", "pos_meas1", "pos_meas2", "vel_meas1", "vel_meas2", "tau_con1", "tau_con2")
"""Columns of a written file (s, rad, rad/s, N m)."""

# Measured columns first: the leaderboards score these.
_GROUPS = (
    (("time",),),
    (("pos_meas1", "pos_meas2"), ("pos1", "pos2")),
    (("vel_meas1", "vel_meas2"), ("vel1", "vel2")),
    (("tau_con1", "tau_con2"), ("tau1", "tau2")),
)
"""What is read, in order: the first complete choice of each group."""


def save_trajectory(path: str | Path, trajectory: Trajectory) -> None:
    """Write a trajectory atomically, with enough digits to read the same float64 back."""
    parts = (trajectory.time, trajectory.x, trajectory.u)
    table = np.column_stack([np.asarray(part, np.float64) for part in parts])
    write_columns(path, dict(zip(FILE_COLUMNS, table.T, strict=True)))


def load_trajectory(path: str | Path, columns: Sequence[str] = ()) -> Trajectory:
    """Read a trajectory as NumPy arrays in float64, cut to the shortest of its columns.

    Units as in ``time[ms]`` are converted; spaces, and a byte order mark or ``#`` before the header are accepted.
    ``columns`` are those of :func:`~swingup.common.table.read_table`. Refused are a column that is missing or there
    twice, fewer than three complete rows, a cell that is not a finite number, a time that does not increase.
    """
    table: Any = np.column_stack(list(read_table(path, _GROUPS, columns=columns).values.values()))
    return Trajectory(time=table[:, 0].copy(), x=table[:, 1:5].copy(), u=table[:, 5:].copy())
