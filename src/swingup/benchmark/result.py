"""What the judge finds: the same for every board."""

from dataclasses import dataclass, field
from typing import Any

from ..common import __version__
from ..loop.domain import Domain
from ..plant.plant import Plant
from .board import Criteria, Run, TipHistory
from .rollout import Trajectory
from .values import Interval, share_interval


@dataclass(frozen=True)
class Result:
    """A controller, or a recording, on a board."""

    robot: str
    controller: str
    board: str
    values: dict[str, float | None]
    """By the board's columns: means over the runs, the score last."""
    intervals: dict[str, Interval]
    """95 % intervals of those values that vary from seed to seed, with two seeds or more."""
    runs: tuple[Run, ...]
    """Every simulation."""
    trajectory: Trajectory | None = field(repr=False)
    """Rows of the first run, as the robot records them where one is simulated; None on boards that keep none."""
    plant: Plant
    """The plant of all runs, or the one that the domain starts from."""
    seeds: tuple[int, ...] = ()
    """Seeds of noise, pushes, throws and plants; empty where nothing is random."""
    domain: Domain | None = None
    """What plants and loops were drawn from, if anything."""
    estimator: bool | None = None
    """Whether a state estimator stood before the controller; None for a recording."""
    call_time: float | None = None
    """Wall time of one call of the controller on this machine (s); None where it was not measured."""
    rate: float | None = None
    """Rows a second of a recording, from the median period (Hz)."""
    warnings: tuple[str, ...] = ()
    """What keeps the score from being that of a real run."""
    note: str | None = None
    """What the board says of itself."""
    version: str = __version__
    """Version of swingup that judged."""

    @property
    def score(self) -> float | None:
        """The value that the board is sorted by, from 0 to 1; None if parts of the board were left out."""
        return self.values["score"]

    @property
    def interval(self) -> Interval | None:
        """95 % interval of the score, with two seeds or more."""
        return self.intervals.get("score")

    @property
    def successes(self) -> int:
        """Number of runs that succeeded."""
        return sum(run.success for run in self.runs)

    @property
    def success_interval(self) -> Interval:
        """95 % interval of the share of successes."""
        return share_interval(self.successes, len(self.runs))

    @property
    def faults(self) -> list[Run]:
        """Runs in which the controller failed to answer."""
        return [run for run in self.runs if run.fault is not None]

    @property
    def criteria(self) -> Criteria:
        """The criteria of the first run, on a board of swing-ups."""
        found = self.runs[0].criteria
        assert found is not None, f"the board {self.board} does not measure criteria"
        return found

    @property
    def tip(self) -> TipHistory:
        """How high the tip of the first run came, on a board that follows it."""
        found = self.runs[0].tip
        assert found is not None, f"the board {self.board} does not follow the tip"
        return found

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON: what was judged, successes, the board's values, and every run under ``details``."""
        known = {} if self.estimator is None else {"estimator": self.estimator}
        drawn = {} if self.domain is None else {"domain": {"name": self.domain.name} | self.domain.as_dict()}
        note = {} if self.note is None else {"note": self.note}
        return {
            "robot": self.robot,
            "controller": self.controller,
            **known,
            "board": self.board,
            **self.plant.summary(self.robot),
            **drawn,
            "seeds": list(self.seeds),
            "version": self.version,
            "runs": len(self.runs),
            "successes": self.successes,
            "success_interval": self.success_interval,
            **self.values,
            "intervals": self.intervals,
            "call_time": self.call_time,
            **({} if self.rate is None else {"rate": self.rate}),
            "warnings": list(self.warnings),
            **note,
            "details": [run.as_dict() for run in self.runs],
        }
