"""The robustness score: success of one controller in every simulation of the grid."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import fmean
from typing import Any

import numpy as np

from ..common.checks import one_of
from ..common.errors import SwingupError
from ..common.version import __version__
from ..controllers.registry import has_estimator
from ..dynamics.angles import UPRIGHT, wrap_difference
from ..dynamics.integrate import stable_substeps
from ..plant.plant import LEADERBOARD, Plant, PlantLike, load_plant
from ..plant.robots import Robot, get_robot
from ..plant.units import scales_of
from .grid import Case, make_cases
from .interval import Interval, mean_interval
from .rollout import Scenario
from .rules import CRITERIA, DEFAULT_RULES, RANDOM, RobustnessRules, get_robustness_rules
from .runner import Progress, prepare, run_many, stack
from .seeds import check_seeds


@dataclass(frozen=True)
class Result:
    """How one simulation of the grid ended."""

    case: Case
    success: bool
    fault: str | None = None
    """What was wrong with the controller's answers, if anything."""

    def as_dict(self) -> dict[str, Any]:
        """Flat and ready for JSON."""
        fault = {} if self.fault is None else {"fault": self.fault}
        return {"criterion": self.case.criterion, **self.case.settings, "success": self.success, **fault}


@dataclass(frozen=True)
class Robustness:
    """A controller's robustness on a robot."""

    robot: str
    controller: str
    rules: str
    seeds: tuple[int, ...]
    """Seeds of the noise and the pushes; the percentages are means over them."""
    percent: dict[str, float]
    """Each measured criterion's successes (%)."""
    overall: float | None
    """Mean of the six criteria, 0 to 1; None if not all of them were measured."""
    intervals: dict[str, Interval]
    """95 % intervals of the random criteria's means and of ``overall``, with two seeds or more."""
    results: tuple[Result, ...]
    """Every simulation."""
    version: str = __version__
    """Version of swingup that measured."""
    estimator: bool = False
    """Whether a state estimator stood before the controller."""
    plant: Plant = LEADERBOARD
    """What the grid is around."""

    @property
    def faults(self) -> list[Result]:
        """Simulations in which the controller failed to answer."""
        return [result for result in self.results if result.fault is not None]

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON: criteria in percent, ``overall`` from 0 to 1, every simulation in ``details``."""
        seeds: dict[str, Any] = {"seed": self.seeds[0]}
        if len(self.seeds) > 1:
            seeds |= {"seeds": list(self.seeds), "intervals": self.intervals}
        names = ("robot", "controller", "estimator", "rules")
        head = {name: getattr(self, name) for name in names} | self.plant.summary(self.robot) | seeds
        scores = {**self.percent, "overall": self.overall}
        return {**head, "version": self.version, **scores, "details": [result.as_dict() for result in self.results]}


def robustness(
    controller: Any,
    robot: Robot | str,
    name: str = "controller",
    rules: RobustnessRules | str = DEFAULT_RULES,
    seed: int = 0,
    seeds: int = 1,
    criteria: str | Sequence[str] = CRITERIA,
    progress: Progress | None = None,
    plant: PlantLike = LEADERBOARD,
) -> Robustness:
    """Simulate the whole grid of the robustness board in float64, and score it.

    Args:
        controller: a controller in JAX (all simulations side by side), an object with
            ``get_control_output(x, t)`` or a function of (x, t) (one call after another).
        robot: which joint is driven.
        name: name of the controller in the result.
        rules: rules of the robustness board, or their name.
        seed: the first seed of the noise and the pushes.
        seeds: number of seeds in a row; the random criteria are simulated with each.
        criteria: the criteria to measure; ``overall`` needs all six.
        progress: called with the number of finished simulations and of all.
        plant: what the grid is around, with disturbances in that pendulum's own units: a plant, its
            name or its file.

    Raises:
        SwingupError: there is no such robot or plant, there are no such rules or criteria, a seed is out of range,
            or the controller is for the other robot. A controller that fails to answer loses that simulation only.
    """
    robot, rules = get_robot(robot), get_robustness_rules(rules)
    every, chosen = check_seeds(seed, seeds), check_criteria(criteria)
    found = load_plant(plant)
    nominal = found.driven(robot)
    rules = rules.in_units(scales_of(nominal))
    estimator, controller = has_estimator(controller), prepare(controller, robot, name, nominal)
    cases = [case for criterion in chosen for case in make_cases(robot, rules, criterion, every[0], found)]
    # The other criteria do not depend on the seed: one simulation of each is enough.
    for other in every[1:]:
        cases += [case for one in chosen if one in RANDOM for case in make_cases(robot, rules, one, other, found)]
    disturbances = [case.scenario.disturbance for case in cases]
    # One state more than the largest delay: the present one.
    depth = 1 + max(int(each.delay_steps) for each in disturbances if each is not None)
    # All criteria in one stack share one compiled program.
    scenarios = stack(_stable([case.scenario for case in cases], rules.dt, found))
    batch = run_many(controller, scenarios, rules.dt, rules.steps, depth, progress=progress)
    ends = zip(cases, upright(batch.final, rules.tolerance), batch.faults, strict=True)
    # A controller that failed gets no success, even if the pendulum happened to end upright.
    results = tuple(Result(case, bool(success) and fault is None, fault) for case, success, fault in ends)
    percent, overall, intervals = summarise(results, tuple(every))
    head = robot.name, name, rules.name, tuple(every)
    return Robustness(*head, percent, overall, intervals, results, estimator=estimator, plant=found)


def _stable(scenarios: list[Scenario], dt: float, plant: Plant) -> list[Scenario]:
    """Scenarios in steps short enough for the stiffest plant among them; the board's grid takes one of RK4."""
    if plant == LEADERBOARD:
        return scenarios
    substeps = max(stable_substeps(each.parameters, dt) for each in scenarios)
    return [replace(each, substeps=substeps) for each in scenarios]


def check_criteria(criteria: str | Sequence[str]) -> list[str]:
    """Criteria in the board's order; they may be given in one text, with commas.

    Raises:
        SwingupError: one is unknown, or there is none.
    """
    texts = [criteria] if isinstance(criteria, str) else criteria
    criteria = [name for text in texts for name in text.split(",")]
    if not criteria:
        raise SwingupError(f"unknown criterion '': use one of {', '.join(CRITERIA)}")
    for name in criteria:
        one_of("criterion", name, CRITERIA)
    return [name for name in CRITERIA if name in criteria]


def upright(final: np.ndarray, tolerance: Sequence[float]) -> np.ndarray:
    """Whether states (n, 4) are strictly within the tolerance of upright at rest, angles wrapped about it."""
    error = np.asarray(final, np.float64) - UPRIGHT
    error[:, :2] = wrap_difference(error[:, :2])
    return np.all(np.abs(error) < np.asarray(tolerance), axis=1)


def summarise(
    results: Sequence[Result], seeds: Sequence[int]
) -> tuple[dict[str, float], float | None, dict[str, Interval]]:
    """Percentages, the overall score and their intervals from single simulations.

    A group of repetitions counts if more than half of it succeeded; a criterion is the share of groups that count.
    """
    by_seed = [_percentages(results, seed) for seed in seeds]
    percent = {name: fmean(each[name] for each in by_seed) for name in by_seed[0]}
    complete = len(percent) == len(CRITERIA)
    overall = fmean(percent.values()) / 100 if complete else None
    intervals = {}
    if len(seeds) > 1:
        random = [name for name in RANDOM if name in percent]
        intervals = {name: mean_interval([each[name] for each in by_seed], 0.0, 100.0) for name in random}
        if complete:
            intervals["overall"] = mean_interval([fmean(each.values()) / 100 for each in by_seed], 0.0, 1.0)
    return percent, overall, intervals


def _percentages(results: Sequence[Result], seed: int) -> dict[str, float]:
    """Each criterion's percentage with one seed; criteria without randomness are the same for every seed."""
    groups: dict[str, dict[int, list[bool]]] = {}
    for result in results:
        case = result.case
        if case.settings.get("seed", seed) == seed:
            groups.setdefault(case.criterion, {}).setdefault(case.group, []).append(result.success)
    counts = {name: [2 * sum(group) > len(group) for group in each.values()] for name, each in groups.items()}
    return {name: 100.0 * fmean(each) for name, each in counts.items()}
