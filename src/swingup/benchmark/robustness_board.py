"""The robustness board: the shares of a grid of simulations in which the pendulum ends upright."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import fmean
from typing import Annotated, ClassVar

import numpy as np

from ..common.checks import one_of
from ..dynamics.angles import UPRIGHT, wrap_difference
from ..dynamics.integrate import stable_substeps
from ..plant.plant import LEADERBOARD
from ..plant.units import STATE, TIME, TORQUE, VELOCITY, scaled, scales_of
from .board import AbstractBoard, Case, Run, Setting, Summary
from .grid import make_cases
from .interval import mean_interval
from .rollout import Trajectory
from .rules import CRITERIA, MODEL_SWEEPS, RANDOM, ModelSweep, PushRules, Sweep
from .seeds import MOST_SEEDS


@dataclass(frozen=True, kw_only=True)
class RobustnessBoard(AbstractBoard):
    """Sweeps of model errors, noise, motor response and delay, profiles of pushes, and the condition of success."""

    keeps_rows: ClassVar[bool] = False
    model: Mapping[str, ModelSweep] = field(default_factory=lambda: dict(MODEL_SWEEPS))
    velocity_noise: Annotated[Sweep, VELOCITY] = field(default=Sweep(0.0, 0.5, repetitions=10))
    torque_noise: Annotated[Sweep, TORQUE] = field(default=Sweep(0.0, 1.1, repetitions=10))
    torque_response: Sweep = field(default=Sweep(0.1, 2.0))
    delay: Annotated[Sweep, TIME] = field(default=Sweep(0.0, 0.04))
    perturbations: PushRules = field(default=PushRules())
    tolerance: Annotated[tuple[float, ...], *STATE] = (0.35, 0.35, 1.0, 1.0)
    """Success: the last state is strictly within this of upright at rest (rad, rad, rad/s, rad/s)."""
    criteria: tuple[str, ...] = CRITERIA
    """The criteria that are measured; the score needs all six."""
    side_by_side: int = MOST_SEEDS
    """All simulations at once share one compiled program, and keep no rows."""

    def __post_init__(self) -> None:
        """Refuse unknown criteria, and put the others in the board's order."""
        for name in self.criteria or ("",):
            one_of("criterion", name, CRITERIA)
        object.__setattr__(self, "criteria", tuple(name for name in CRITERIA if name in self.criteria))

    @property
    def columns(self) -> tuple[str, ...]:
        """The measured criteria (%) and the score."""
        return (*self.criteria, "score")

    def is_random(self, setting: Setting) -> bool:
        """Noise and pushes depend on the seed."""
        return any(name in RANDOM for name in self.criteria)

    def on(self, setting: Setting) -> "RobustnessBoard":
        """The grid in the pendulum's own units; responses and all counts stay."""
        scales = scales_of(setting.nominal)
        model = {name: each.in_units(scales) for name, each in self.model.items()}
        return replace(scaled(self, scales), model=model)

    def cases(self, setting: Setting, seeds: Sequence[int]) -> list[Case]:
        """The grid: the criteria without randomness once, the others with each seed."""
        robot, plant = setting.robot, setting.plant
        drawn = [(name, seed) for seed in seeds for name in self.criteria if seed == seeds[0] or name in RANDOM]
        cases = [case for name, seed in drawn for case in make_cases(robot, self, name, seed, plant)]
        if plant == LEADERBOARD:
            return cases  # whose grid takes one step of RK4
        # Short enough for the stiffest plant of the grid.
        substeps = max(stable_substeps(case.scenario.parameters, self.dt) for case in cases)
        return [replace(case, scenario=replace(case.scenario, substeps=substeps)) for case in cases]

    def score(self, case: Case, rows: Trajectory, fault: str | None = None, stop: float | None = None) -> Run:
        """Whether the last state is upright at rest; a controller that failed gets no success even so."""
        success = fault is None and bool(upright(np.asarray(rows.x)[-1:], self.tolerance)[0])
        return Run(case, success, float(success), fault)

    def summarise(self, runs: Sequence[Run], seeds: Sequence[int]) -> Summary:
        """Percentages, the score and their intervals.

        A group of repetitions counts if more than half of it succeeded; a criterion is the share of groups that
        count.
        """
        by_seed = [_percentages(runs, seed) for seed in seeds]
        values: dict[str, float | None] = {name: fmean(each[name] for each in by_seed) for name in by_seed[0]}
        complete = len(values) == len(CRITERIA)
        scores = [fmean(each.values()) / 100 for each in by_seed] if complete else []
        intervals = {}
        if len(seeds) > 1:
            random = [name for name in RANDOM if name in values]
            intervals = {name: mean_interval([each[name] for each in by_seed], 0.0, 100.0) for name in random}
            if complete:
                intervals["score"] = mean_interval(scores, 0.0, 1.0)
        # The mean of the means, as the board rounds: the mean of the scores differs in the last digit.
        percent = [fmean(each[name] for each in by_seed) for name in by_seed[0]]
        return values | {"score": fmean(percent) / 100 if complete else None}, intervals


def upright(final: np.ndarray, tolerance: Sequence[float]) -> np.ndarray:
    """Whether states (n, 4) are strictly within the tolerance of upright at rest, angles wrapped about it."""
    error = np.asarray(final, np.float64) - UPRIGHT
    error[:, :2] = wrap_difference(error[:, :2])
    return np.all(np.abs(error) < np.asarray(tolerance), axis=1)


def _percentages(runs: Sequence[Run], seed: int) -> dict[str, float]:
    """Each criterion's percentage with one seed; criteria without randomness are the same for every seed."""
    groups: dict[str, dict[int, list[bool]]] = {}
    for run in runs:
        case = run.case
        if case.settings.get("seed", seed) == seed:
            groups.setdefault(str(case.criterion), {}).setdefault(case.group, []).append(run.success)
    counts = {name: [2 * sum(group) > len(group) for group in each.values()] for name, each in groups.items()}
    return {name: 100.0 * fmean(each) for name, each in counts.items()}
