"""An excitation: torques and a motion to play on a robot."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ...common.table import write_columns
from .waves import PERIOD


@dataclass(frozen=True)
class Limits:
    """What the robot may do."""

    torque: tuple[float, float]
    """Of each motor (N m); 0 on a joint that is not driven."""
    speed: float
    """Of either joint (rad/s)."""
    angle: float
    """Of either joint, from hanging (rad)."""


@dataclass(frozen=True)
class Excitation:
    """Torques, the motion they make in the middle of the prior, and the feedback around it."""

    torque: Float[np.ndarray, "rows 2"]
    """N m, rows ``PERIOD`` apart."""
    state: Float[np.ndarray, "rows 4"]
    """Of the plant in the middle of the prior (rad, rad/s)."""
    feedback: Float[np.ndarray, "2 2"]
    """kp of both joints (N m/rad), kd of both (N m s/rad); 0 where the torques are played alone."""
    limits: Limits
    angle: float
    """Largest angle over all checked plants (rad)."""
    speed: float
    """Largest speed over all checked plants (rad/s)."""
    plants: int
    """Number of checked plants."""

    @property
    def time(self) -> Float[np.ndarray, "rows"]:
        """Of the rows (s)."""
        return PERIOD * np.arange(len(self.torque))

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "duration": len(self.torque) * PERIOD,
            "limits": vars(self.limits) | {"torque": list(self.limits.torque)},
            "reached": {
                "torque": np.abs(self.torque).max(axis=0).tolist(),
                "speed": self.speed,
                "angle": self.angle,
            },
            "plants": self.plants,
            "feedback": {"kp": self.feedback[0].tolist(), "kd": self.feedback[1].tolist()},
        }

    def save(self, path: str | Path) -> None:
        """Write time, motion, torques and gains K of u = tau + K (x - motion), under RealAIGym's names.

        CloudPendulum's desired motions have the same names of time, pos, vel and acc.
        """
        columns = {"time": self.time}
        columns |= dict(zip(("pos1", "pos2", "vel1", "vel2"), self.state.T, strict=True))
        columns |= dict(zip(("acc1", "acc2"), np.gradient(self.state[:, 2:], PERIOD, axis=0).T, strict=True))
        columns |= dict(zip(("tau1", "tau2"), self.torque.T, strict=True))
        for joint in (0, 1):
            gains = np.zeros(4)
            gains[[joint, 2 + joint]] = -self.feedback[:, joint]
            rows = np.tile(gains, (len(self.torque), 1))
            columns |= dict(zip((f"K{joint + 1}{entry}" for entry in (1, 2, 3, 4)), rows.T, strict=True))
        write_columns(path, columns)
