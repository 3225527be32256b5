"""Swing-up trajectories to follow, their documented files without pickle, and CSV files in RealAIGym's format.

Its trajectory controllers command u = tau + K (x - [pos, vel]), with a row of gains for each joint: K11 to K14 for
the shoulder, K21 to K24 for the elbow. That is this package's convention as well.
"""

from pathlib import Path
from typing import Annotated, Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ...common import __version__
from ...common.arrays import load_arrays, save_arrays
from ...common.checks import positive_number
from ...common.errors import SwingupError
from ...common.table import write_columns
from ...plant.plant import Robot, get_robot
from ...plant.units import DAMPING, STATE, TIME, TORQUE

REFERENCE_FORMAT = "swingup trajectory"
REFERENCE_VERSION = 1

RECOMPUTE = "compute it again with swingup export --to trajectory"

GAIN_COLUMNS = tuple(f"K{joint}{entry}" for joint in (1, 2) for entry in (1, 2, 3, 4))


class Reference(eqx.Module):
    """A trajectory x_{n+1} = f(x_n, u_n) of the driven joint's torques, with feedback gains along it."""

    robot: Robot = eqx.field(static=True)
    dt: Annotated[float, TIME]  # Time between rows (s)
    states: Annotated[Float[Any, "rows 4"], *STATE]  # [q1, q2, dq1, dq2] (rad, rad/s)
    torque: Annotated[Float[Any, "rows"], TORQUE]  # N m
    gains: Annotated[Float[Any, "rows 4"], TORQUE, TORQUE, DAMPING, DAMPING]
    """K (N m/rad, N m s/rad) of u + K (x - x_i)."""

    @property
    def time(self) -> Float[np.ndarray, "rows"]:
        """Time of each row (s)."""
        return self.dt * np.arange(len(self.torque))


REFERENCE_ARRAYS = ("states", "torque", "gains")


def save_reference(path: str | Path, reference: Reference, provenance: dict[str, Any]) -> None:
    """Write a trajectory file; ``provenance`` (JSON values) is kept under its own names, but for robot and dt."""
    head = {"robot": reference.robot.name, "dt": reference.dt, "version": __version__}
    arrays = {name: np.asarray(getattr(reference, name), np.float64) for name in REFERENCE_ARRAYS}
    save_arrays(path, REFERENCE_FORMAT, REFERENCE_VERSION, {**provenance, **head}, arrays)


def load_reference(path: str | Path) -> tuple[Reference, dict[str, Any]]:
    """Read a trajectory file and its metadata."""
    metadata, arrays = load_arrays(path, REFERENCE_FORMAT, REFERENCE_VERSION, REFERENCE_ARRAYS.__contains__)
    missing = [name for name in ("robot", "dt") if name not in metadata]
    missing += [name for name in REFERENCE_ARRAYS if name not in arrays]
    if missing:
        raise SwingupError(f"trajectory file {path} lacks {', '.join(missing)}: {RECOMPUTE}")
    dt, rows = metadata["dt"], arrays["torque"].shape
    # A spacing of more than a second is not a swing-up's: its times were not in seconds.
    dt = positive_number(f"trajectory file {path} has dt", dt, 1.0, "s")
    for name in REFERENCE_ARRAYS:
        array, shape = arrays[name], rows if name == "torque" else (*rows, 4)
        # A single row has no spacing.
        if len(rows) != 1 or rows[0] < 2 or array.shape != shape:
            raise SwingupError(f"trajectory file {path} has {name} of shape {array.shape}: {RECOMPUTE}")
        if array.dtype.kind != "f" or not np.isfinite(array).all():
            raise SwingupError(
                f"trajectory file {path} has values in {name} that are not finite numbers: {RECOMPUTE}"
            )
    fields = {name: arrays[name].astype(np.float64) for name in REFERENCE_ARRAYS}
    return Reference(robot=get_robot(metadata["robot"]), dt=dt, **fields), metadata


def save_reference_csv(path: str | Path, reference: Reference, zeros: tuple[float, float] = (0.0, 0.0)) -> None:
    """Write a swing-up atomically, with its gains and the angles that encoders with these zeros (rad) show.

    Raises:
        SwingupError: the file cannot be written.
    """
    driven = np.array(reference.robot.actuation)
    # The gains stand in the driven joint's row; the passive joint's row is 0.
    torques, gains = np.outer(reference.torque, driven), np.kron(driven, np.asarray(reference.gains))
    table = np.column_stack([reference.time, np.add(reference.states, [*zeros, 0.0, 0.0]), torques, gains])
    names = ("time", "pos1", "pos2", "vel1", "vel2", "tau1", "tau2", *GAIN_COLUMNS)
    write_columns(path, dict(zip(names, table.T, strict=True)))
