"""What a rehearsal shows: the runs as the judge sees them, the guard, and the calls' times."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..benchmark.result import Result
from .folder import Folder
from .loop import Timing


@dataclass(frozen=True)
class Rehearsal:
    """What the runs of one folder showed."""

    folder: Folder
    result: Result
    """As of the judge."""
    stops: tuple[dict[str, Any] | None, ...]
    """When (s) and why the folder's guard stopped each run."""
    difference: str | None
    """How the plant differs from the one that the policy was made for; None if it differs little."""
    limits: tuple[float, float] | None
    """Largest angle (rad) and speed (rad/s) of a joint; None where neither guard nor board has limits."""
    real_time: bool
    timings: tuple[Timing, ...]
    """What was measured of each run."""
    facts: dict[str, Any]
    """What the folder says of itself."""

    @property
    def calls(self) -> list[float]:
        """Times inside the calls of all runs (s)."""
        return [each for timing in self.timings for each in timing.calls]

    @property
    def periods(self) -> list[float]:
        """Times between the calls of each run (s)."""
        return [each for timing in self.timings for each in timing.periods]

    @property
    def missed(self) -> int:
        """Periods that ended without an answer."""
        return sum(timing.missed for timing in self.timings)

    @property
    def late(self) -> int:
        """Periods that began late because the simulation was slow."""
        return sum(timing.late for timing in self.timings)

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON: the judge's result, and what a folder adds; times in s."""
        return self.result.as_dict() | {
            "folder": str(self.folder.entry.parent),
            "form": self.folder.form,
            "difference": self.difference,
            "limits": self.limits and dict(zip(("angle", "speed"), self.limits, strict=True)),
            "guard": self.facts["guard"],
            "stops": list(self.stops),
            "packages": self.facts["packages"],
            "calls": spread(self.calls),
            "real_time": self.real_time,
            "periods": spread(self.periods) if self.real_time else None,
            "missed": self.missed if self.real_time else None,
            "late": self.late if self.real_time else None,
        }


def spread(seconds: Sequence[float]) -> dict[str, float]:
    """Median, 99th percentile and longest of measured times (s)."""
    if not seconds:
        return {}
    middle, most = np.percentile(seconds, [50, 99]).tolist()
    return {"p50": middle, "p99": most, "longest": max(seconds)}
