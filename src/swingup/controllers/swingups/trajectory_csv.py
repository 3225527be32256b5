"""Swing-up trajectories as CSV files in RealAIGym's format, with their feedback gains.

Its trajectory controllers command u = tau + K (x - [pos, vel]), with a row of gains for each joint: K11 to K14 for
the shoulder, K21 to K24 for the elbow. That is this package's convention as well.
"""

from pathlib import Path

import numpy as np

from ...common.errors import SwingupError
from ...common.table import read_table, write_columns
from ...plant.robots import Robot, get_robot
from .reference import Reference

STATE_COLUMNS = ("pos1", "pos2", "vel1", "vel2")
TORQUE_COLUMNS = ("tau1", "tau2")
GAIN_COLUMNS = tuple(f"K{joint}{entry}" for joint in (1, 2) for entry in (1, 2, 3, 4))

# Plain names first: files for trajectory controllers hold these.
_GROUPS = (
    (("time",),),
    (("pos1", "pos2"), ("pos_des1", "pos_des2"), ("pos_meas1", "pos_meas2")),
    (("vel1", "vel2"), ("vel_des1", "vel_des2"), ("vel_meas1", "vel_meas2")),
    (("tau1", "tau2"), ("tau_des1", "tau_des2"), ("tau_con1", "tau_con2")),
)
"""The columns to read, in order: of each group, the first choice that is complete."""

SPACING_TOLERANCE = 1e-6
"""Largest distance of a time from an even spacing (s)."""


def save_reference_csv(path: str | Path, reference: Reference) -> None:
    """Write a swing-up atomically, exactly, with its gains.

    Raises:
        SwingupError: the file cannot be written.
    """
    driven = np.array(reference.robot.actuation)
    # The gains stand in the driven joint's row; the passive joint's row is 0.
    torques, gains = np.outer(reference.torque, driven), np.kron(driven, np.asarray(reference.gains))
    table = np.column_stack([reference.time, reference.states, torques, gains])
    names = ("time", *STATE_COLUMNS, *TORQUE_COLUMNS, *GAIN_COLUMNS)
    write_columns(path, dict(zip(names, table.T, strict=True)))


def load_reference_csv(path: str | Path, robot: Robot | str) -> Reference:
    """Read a swing-up to follow; without columns of gains all gains are 0, which is enough to design a TVLQR.

    Raises:
        SwingupError: the file is not a trajectory, its times are not evenly spaced from 0 on, or it moves the joint
            that this robot does not drive.
    """
    robot = get_robot(robot)
    columns = read_table(path, _GROUPS, GAIN_COLUMNS).values
    table = list(columns.values())
    time, states, torques = table[0], np.column_stack(table[1:5]), np.column_stack(table[5:7])
    # The mean spacing: single differences carry the rounding of the file's decimals.
    dt = float(time[-1] / (len(time) - 1))
    if not np.allclose(time, dt * np.arange(len(time)), rtol=0, atol=SPACING_TOLERANCE):
        raise SwingupError(f"{path}: its times are not evenly spaced from 0 on: resample it")
    # A swing-up of the other robot drives this joint.
    passive = 1 - robot.joint
    if np.any(torques[:, passive] != 0):
        raise SwingupError(f"{path} has torque on the passive joint {passive + 1}: it is not for the {robot.name}")
    chosen = GAIN_COLUMNS[4 * robot.joint : 4 * robot.joint + 4]
    gains = np.column_stack([columns[name] if name in columns else np.zeros(len(time)) for name in chosen])
    return Reference(robot, dt, states, torques[:, robot.joint], gains)
