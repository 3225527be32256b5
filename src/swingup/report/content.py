"""What a report page shows, and its form as JSON for the scripts in the page."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..benchmark.rollout import Trajectory
from ..common.errors import SwingupError
from ..common.text import one_line, quoted
from ..export.javascript_backend.page import policy_data
from ..plant.plant import NAMES, Plant
from ..plant.robots import get_robot
from ..policy.pendulum import PendulumPolicy

if TYPE_CHECKING:
    from ..benchmark.leaderboard import Board

LIVE_STEP = 0.002
"""Time step of the live pendulum (s), the same as in the benchmark."""


@dataclass(frozen=True)
class Show:
    """One controller's recorded swing-ups."""

    name: str
    clean: Trajectory | None
    """Without a disturbance; None if the controller failed."""
    disturbed: Trajectory | None
    """With the section's disturbance; None if the controller failed."""
    note: str | None = None
    """Why a trajectory is missing, or another remark."""


@dataclass(frozen=True)
class Section:
    """What the page shows about one robot."""

    robot: str
    parameters: Plant
    """The plant; a torque limit of 0 makes a joint passive."""
    boards: Sequence["Board"]
    shows: Sequence[Show]
    disturbance: str
    """What disturbs the disturbed trajectories, in one sentence."""
    policy: PendulumPolicy | None = None
    """Drives the live pendulum; without a policy the page has no live pendulum."""
    policy_note: str | None = None
    """Which policy that is, in one sentence; None for nothing to say."""


def encode_section(section: Section) -> dict[str, Any]:
    """A section as JSON values; arrays are base64 of little-endian float32, row by row.

    Raises:
        SwingupError: there is no such robot, a trajectory's arrays do not fit together, or the page's scripts
            cannot run the policy.
    """
    return {
        "robot": section.robot,
        "driven": get_robot(section.robot).joint,
        "dt": LIVE_STEP,
        "parameters": {name: float(getattr(section.parameters, name)) for name in NAMES},
        "shows": [encode_show(show) for show in section.shows],
        "policy": None if section.policy is None else policy_data(section.policy),
    }


def encode_show(show: Show) -> dict[str, Any]:
    """A show as JSON values."""
    runs = {"clean": show.clean, "disturbed": show.disturbed}
    return {"name": one_line(show.name)} | {
        name: None if run is None else _encode_trajectory(show.name, run) for name, run in runs.items()
    }


def _encode_trajectory(name: str, trajectory: Trajectory) -> dict[str, Any] | None:
    """Rows up to the first that is not finite; None if there are none."""
    time, x, u = (np.asarray(rows, np.float64) for rows in (trajectory.time, trajectory.x, trajectory.u))
    if time.ndim != 1 or x.shape != (time.size, 4) or u.shape != (time.size, 2):
        shapes = f"{time.shape}, {x.shape} and {u.shape}"
        raise SwingupError(f"trajectory of {quoted(name)} has shapes {shapes}: pass (N,), (N, 4) and (N, 2)")
    with np.errstate(over="ignore"):  # numbers too large for single precision become infinite, and are cut
        table = np.column_stack([time, x, u]).astype(np.float32)
    finite = np.isfinite(table).all(axis=1)
    rows = time.size if finite.all() else int(np.argmin(finite))
    if rows == 0:
        return None
    return {"time": _base64(table[:rows, 0]), "x": _base64(table[:rows, 1:5]), "u": _base64(table[:rows, 5:])}


def _base64(array: Any) -> str:
    return base64.b64encode(np.ascontiguousarray(array, "<f4").tobytes()).decode("ascii")
