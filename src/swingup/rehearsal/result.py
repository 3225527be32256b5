"""What a rehearsal shows: the run as the judge sees it, the robot's limits, the guard, and the calls' times."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..benchmark.criteria import Criteria, TipHistory
from ..benchmark.rollout import Trajectory
from ..loop.domain import Domain
from .folder import Folder
from .loop import Timing


@dataclass(frozen=True)
class Rehearsal:
    """What one rehearsal showed."""

    folder: Folder
    robot: str
    domain: Domain
    """What plant and loop were drawn from."""
    seed: int
    real_time: bool
    criteria: Criteria
    tip: TipHistory
    difference: str | None
    """How the plant differs from the one that the policy was made for; None if it differs little."""
    limits: tuple[float, float]
    """Largest angle (rad) and speed (rad/s) of a joint; the robot stops beyond them."""
    timing: Timing
    facts: dict[str, Any]
    """What the folder says of itself: its packages, and when and why its guard stopped it."""
    trajectory: Trajectory

    @property
    def angle(self) -> float:
        """Largest angle of a joint (rad)."""
        return float(np.abs(self.trajectory.x[:, :2]).max())

    @property
    def speed(self) -> float:
        """Largest speed of a joint (rad/s)."""
        return float(np.abs(self.trajectory.x[:, 2:]).max())

    @property
    def violation(self) -> float | None:
        """When a joint first passed a limit (s); None for never."""
        most = np.repeat(self.limits, 2)
        # Negated, so that a state that has diverged is beyond them.
        beyond = ~(np.abs(self.trajectory.x) <= most).all(axis=1)
        return float(self.trajectory.time[beyond.argmax()]) if beyond.any() else None

    @property
    def success(self) -> bool:
        """It swung up and stayed there, within the robot's limits."""
        return self.criteria.success and self.violation is None

    @property
    def score(self) -> float:
        """The RealAI score, 0 without success."""
        return self.criteria.score if self.success else 0.0

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON; times in s."""
        return {
            "folder": str(self.folder.entry.parent),
            "form": self.folder.form,
            "robot": self.robot,
            "domain": {"name": self.domain.name} | self.domain.as_dict(),
            "seed": self.seed,
            "success": self.success,
            **{name: value for name, value in asdict(self.criteria).items() if name not in ("success", "score")},
            "score": self.score,
            **self.tip.as_dict(),
            "difference": self.difference,
            "speed": self.speed,
            "angle": self.angle,
            "violation": self.violation,
            "limits": {"angle": self.limits[0], "speed": self.limits[1]},
            "guard": self.facts["guard"],
            "stopped": self.facts["stopped"],
            "packages": self.facts["packages"],
            "calls": spread(self.timing.calls),
            "real_time": self.real_time,
            "periods": spread(self.timing.periods) if self.real_time else None,
            "missed": self.timing.missed if self.real_time else None,
            "late": self.timing.late if self.real_time else None,
        }


def spread(seconds: Sequence[float]) -> dict[str, float]:
    """Median, 99th percentile and longest of measured times (s)."""
    if not seconds:
        return {}
    middle, most = np.percentile(seconds, [50, 99]).tolist()
    return {"p50": middle, "p99": most, "longest": max(seconds)}
