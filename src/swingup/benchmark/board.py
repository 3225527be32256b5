"""What a board is, as data: how scenarios are drawn, runs are scored and summed up; and what the judge finds."""

import abc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean
from typing import Any, ClassVar

from ..common import __version__
from ..controllers.check import CallTime
from ..loop.domain import Domain
from ..loop.supervisors import Limits
from ..plant.plant import Plant, Robot
from .disturbances import DisturbanceSettings
from .rollout import Scenario, Trajectory
from .values import Interval, mean_interval, share_interval


@dataclass(frozen=True)
class Setting:
    """What a controller is judged on."""

    robot: Robot
    plant: Plant  # The plant of all runs, or the one that controllers in the domain are designed for
    domain: Domain | None = None
    """Plants and loops are drawn from it; None for the plant in the board's own loop."""
    disturbance: DisturbanceSettings | None = None  # What disturbs the board's perfect loop, if anything

    @property
    def nominal(self) -> Plant:
        """The plant with the robot's one motor."""
        return self.plant.driven(self.robot)


@dataclass(frozen=True)
class Case:
    """One simulation of a board."""

    scenario: Scenario
    settings: Mapping[str, Any] = field(default_factory=dict)
    """The seed where the case has one, and what is changed; ready for JSON."""
    criterion: str | None = None  # Criterion that the run belongs to, on a board with several
    group: int = 0  # Cases of one group are repetitions: the group counts if more than half of them succeed


@dataclass(frozen=True)
class Criteria:
    """Result of one swing-up."""

    success: bool
    """The tip was up from ``swingup_time`` to the end, and the run lasted long enough."""
    swingup_time: float | None
    """Start of the last unbroken stretch above the line that lasts to the end (s); None on failure."""
    energy: float
    """Σ over joints and rows |Δq_k u_k| (J)."""
    torque_cost: float
    """Σ u_kᵀ u_k Δt_k (N² m² s)."""
    torque_smoothness: float
    """Standard deviation of u_{k+1} - u_k, summed over the joints (N m)."""
    velocity_cost: float
    """Σ q̇_kᵀ q̇_k Δt_k (rad²/s)."""
    score: float
    """1 - (1/5) Σ tanh(π c_i / n_i) on success, else 0."""


CAUSES = ("no swing-up", "beyond a limit", "fell", "up late", "stopped")
"""Kinds of failures: in the swing-up, at a limit of angle or speed in either phase, at the top, too slow, or ended
early, by a guard for instance."""


@dataclass(frozen=True)
class TipHistory:
    """The height of the tip during a run, and the reason of a failure."""

    highest: float  # Largest height above the shoulder (m)
    reach: float  # l1 + l2 (m)
    failure: str | None  # Why the run failed; None if it succeeded
    cause: str | None = None  # The kind of failure, one of CAUSES

    @property
    def percent(self) -> float:
        """The largest height in percent of l1 + l2."""
        return 100.0 * self.highest / self.reach

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        heights = {"highest_tip": self.highest, "highest_tip_percent": self.percent}
        return heights | {"failure": self.failure, "cause": self.cause}


@dataclass(frozen=True)
class Run:
    """How one simulation, or one recording, ended."""

    case: Case
    success: bool
    score: float
    fault: str | None = None
    """What was wrong with the controller's answers, if anything."""
    criteria: Criteria | None = None
    """Success and costs of a swing-up."""
    tip: TipHistory | None = None
    """How high the tip came, and why a swing-up failed."""
    speed: float | None = None
    """Largest speed of a joint (rad/s), as the robot measured it where it keeps a record."""
    angle: float | None = None
    """Largest angle of a joint (rad), where the board has limits."""
    stop: float | None = None
    """When the robot stopped the run (s), if it did."""

    def as_dict(self) -> dict[str, Any]:
        """Flat and ready for JSON; values that the board does not measure are left out."""
        head = {} if self.case.criterion is None else {"criterion": self.case.criterion}
        costs = {} if self.criteria is None else vars(self.criteria)
        tip = {} if self.tip is None else self.tip.as_dict()
        others = {name: getattr(self, name) for name in ("fault", "speed", "angle", "stop")}
        measured = {name: value for name, value in others.items() if value is not None}
        shown = head | dict(self.case.settings) | costs | tip | measured
        return shown | {"success": self.success, "score": self.score}


Summary = tuple[dict[str, float | None], dict[str, Interval]]
"""Values by the board's columns, and 95 % intervals of those that several runs have."""


def summed_scores(runs: Sequence[Run]) -> Summary:
    """The best score of the runs and their mean, with its interval where there are several."""
    scores = [run.score for run in runs]
    interval = {"score": mean_interval(scores, 0.0, 1.0)} if len(runs) > 1 else {}
    return {"best": max(scores), "score": fmean(scores)}, interval


@dataclass(frozen=True, kw_only=True)
class AbstractBoard(abc.ABC):
    """A board. ``dataclasses.replace`` makes another one, with shorter runs for example."""

    keeps_rows: ClassVar[bool] = True
    """Whether runs are scored by their rows; otherwise by the state after the last step alone."""
    name: str
    duration: float = 10.0
    """Length of a run (s)."""
    dt: float = 0.002
    """Time of one control and simulation step (s): 500 Hz."""
    runs: int = 1
    """Seeds of one judgement where no number is given."""
    domain: str | None = None
    """Plants and loops are drawn from this domain, or from another; None for one plant in a perfect loop."""
    side_by_side: int = 100
    """Seeds that are simulated side by side, as the memory for their rows permits."""
    perfect: bool = False
    """Whether its runs are those of the plant in a perfect loop alone: no robot has such a board."""
    note: str | None = None
    """What readers of a result should know."""

    @property
    def steps(self) -> int:
        """Steps of a run."""
        # Rounded: a quotient of decimals need not be whole.
        return round(self.duration / self.dt)

    @property
    @abc.abstractmethod
    def columns(self) -> tuple[str, ...]:
        """Names of the values that the board shows; the last one is the score that it is sorted by."""

    @abc.abstractmethod
    def is_random(self, setting: Setting) -> bool:
        """Whether runs depend on the seed."""

    @abc.abstractmethod
    def on(self, setting: Setting) -> "AbstractBoard":
        """The board of one robot, in the units of the pendulum that is judged."""

    def stop_limits(self) -> Limits | None:
        """The limits beyond which the robot stops a run; None for a board without such a stop."""
        return None

    @abc.abstractmethod
    def cases(self, setting: Setting, seeds: Sequence[int]) -> list[Case]:
        """The simulations of some seeds, with scenarios of one structure; call it in 64-bit mode."""

    @abc.abstractmethod
    def score(self, case: Case, rows: Trajectory, fault: str | None = None, stop: float | None = None) -> Run:
        """Score one run by its rows: states and torques, the robot's record, or the last state alone.

        ``fault`` is what was wrong with the controller's answers, ``stop`` when the robot stopped the run (s).
        """

    @abc.abstractmethod
    def summarise(self, runs: Sequence[Run], seeds: Sequence[int]) -> Summary:
        """Sum the scores of all runs up."""


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
    """Rows of the first run, as the robot records them where one is simulated, less the encoders' zeros; None on
    boards that keep none."""
    plant: Plant
    """The plant of all runs, or the one that the domain starts from."""
    seeds: tuple[int, ...] = ()
    """Seeds of noise, pushes, throws and plants; empty where nothing is random."""
    domain: Domain | None = None
    """What plants and loops were drawn from, if anything."""
    estimator: bool | None = None
    """Whether a state estimator stood before the controller; None for a recording."""
    call_time: CallTime | None = None
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
            "call_time": self.call_time and self.call_time._asdict(),
            **({} if self.rate is None else {"rate": self.rate}),
            "warnings": list(self.warnings),
            **note,
            "details": [run.as_dict() for run in self.runs],
        }
