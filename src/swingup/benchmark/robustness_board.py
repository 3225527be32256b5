"""The robustness board: the shares of a grid of simulations in which the pendulum ends upright."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import fmean
from typing import Annotated, Any, ClassVar

import numpy as np

from ..common.checks import MAXIMUM_SEEDS, one_of
from ..common.errors import SwingupError
from ..dynamics.dynamics import upright_error
from ..dynamics.integrate import stable_substeps
from ..loop.disturbance import Disturbance, undisturbed
from ..loop.draw import vary
from ..plant.plant import LEADERBOARD, Plant, Robot, validated
from ..plant.units import NUMBER, PLANT_UNITS, STATE, TIME, TORQUE, VELOCITY, Scales, scaled, scales_of
from .board import AbstractBoard, Case, Run, Setting, Summary
from .disturbances import PushRules, draw_pushes, floored_delay_steps
from .rollout import Scenario, Trajectory
from .values import mean_interval

MAX_CASES = 10_000  # Simulations of one criterion; more are refused


@dataclass(frozen=True)
class Sweep:
    """Evenly spaced values of one quantity, both ends included, each simulated ``repetitions`` times."""

    low: float
    high: float
    count: int = 21
    repetitions: int = 1

    def values(self) -> list[float]:
        """The values."""
        return np.linspace(self.low, self.high, self.count).tolist()

    def __mul__(self, factor: float) -> "Sweep":
        """The sweep with all values multiplied by a factor."""
        return replace(self, low=self.low * factor, high=self.high * factor)


@dataclass(frozen=True)
class ModelSweep:
    """Values of one parameter of the plant; the controller keeps the nominal model."""

    parameter: str
    """Field of :class:`~swingup.plant.plant.Plant` that changes."""
    sweep: Sweep
    relative: bool = False  # The values are factors on the nominal one; otherwise they are added to it
    mass: str | None = None
    """If given, the sweep is of the product of this mass and the parameter: m1 r1 or m2 r2."""

    def varied(self, plant: Plant, value: float) -> Plant:
        """The plant with one value of the sweep: with a product m r it is r that changes."""
        return vary(plant, self.parameter, value, self.relative, self.mass)

    def in_units(self, scales: Scales) -> "ModelSweep":
        """The sweep for another pendulum: factors stay."""
        unit = NUMBER if self.relative else PLANT_UNITS[self.parameter]
        return replace(self, sweep=scales.scaled(self.sweep, unit))


_QUARTER = Sweep(0.75, 1.25)
# Absolute values, because the nominal friction is 0. The negative ones drive the joint; the benchmark has them.
_DAMPING, _COULOMB = Sweep(-0.1, 0.1), Sweep(-0.2, 0.2)

MODEL_SWEEPS = {
    # Absolute for the same reason: the leaderboards' plant has no motor inertia.
    "Ir": ModelSweep("Ir", Sweep(0.0, 1e-4)),
    "m1r1": ModelSweep("r1", _QUARTER, relative=True, mass="m1"),
    "I1": ModelSweep("I1", _QUARTER, relative=True),
    "b1": ModelSweep("b1", _DAMPING),
    "cf1": ModelSweep("cf1", _COULOMB),
    "m2r2": ModelSweep("r2", _QUARTER, relative=True, mass="m2"),
    # r2 stays, so that the product m2 r2 varies with m2.
    "m2": ModelSweep("m2", _QUARTER, relative=True),
    "I2": ModelSweep("I2", _QUARTER, relative=True),
    "b2": ModelSweep("b2", _DAMPING),
    "cf2": ModelSweep("cf2", _COULOMB),
}
"""The criterion "model": errors of one parameter at a time (kg m², kg m, kg, N m s/rad, N m, or a factor)."""

SWEPT_CRITERIA = ("velocity_noise", "torque_noise", "torque_response", "delay")
"""Criteria that sweep one number of the disturbance (rad/s, N m, -, s)."""

CRITERIA = ("model", *SWEPT_CRITERIA, "perturbations")  # The six criteria of the robustness score

RANDOM_CRITERIA = ("velocity_noise", "torque_noise", "perturbations")  # Criteria that depend on the seed


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
    side_by_side: int = MAXIMUM_SEEDS
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
        return any(name in RANDOM_CRITERIA for name in self.criteria)

    def on(self, setting: Setting) -> "RobustnessBoard":
        """The grid in the pendulum's own units; responses and all counts stay."""
        scales = scales_of(setting.nominal)
        model = {name: each.in_units(scales) for name, each in self.model.items()}
        return replace(scaled(self, scales), model=model)

    def cases(self, setting: Setting, seeds: Sequence[int]) -> list[Case]:
        """The grid: the criteria without randomness once, the others with each seed."""
        robot, plant = setting.robot, setting.plant
        cases = [
            case
            for seed in seeds
            for name in self.criteria
            if seed == seeds[0] or name in RANDOM_CRITERIA
            for case in make_cases(robot, self, name, seed, plant)
        ]
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
        values = {name: fmean(each[name] for each in by_seed) for name in by_seed[0]}
        complete, intervals = len(values) == len(CRITERIA), {}
        if len(seeds) > 1:
            random = [name for name in RANDOM_CRITERIA if name in values]
            intervals = {name: mean_interval([each[name] for each in by_seed], 0.0, 100.0) for name in random}
            if complete:
                intervals["score"] = mean_interval([fmean(each.values()) / 100 for each in by_seed], 0.0, 1.0)
        # The mean of the means, as the board rounds: the mean of the scores differs in the last digit.
        return values | {"score": fmean(values.values()) / 100 if complete else None}, intervals


def upright(final: np.ndarray, tolerance: Sequence[float]) -> np.ndarray:
    """Whether states (n, 4) are strictly within the tolerance of upright at rest, angles wrapped about it."""
    return np.all(np.abs(upright_error(final)) < np.asarray(tolerance), axis=1)


def _percentages(runs: Sequence[Run], seed: int) -> dict[str, float]:
    """Each criterion's percentage with one seed; criteria without randomness are the same for every seed."""
    groups: dict[str, dict[int, list[bool]]] = {}
    for run in runs:
        case = run.case
        if case.settings.get("seed", seed) == seed:
            groups.setdefault(str(case.criterion), {}).setdefault(case.group, []).append(run.success)
    counts = {name: [2 * sum(group) > len(group) for group in each.values()] for name, each in groups.items()}
    return {name: 100.0 * fmean(each) for name, each in counts.items()}


def make_cases(
    robot: Robot, rules: RobustnessBoard, criterion: str, seed: int, plant: Plant = LEADERBOARD
) -> list[Case]:
    """All simulations of one criterion on a grid around the plant; the seed is that of noise and pushes."""
    nominal = plant.driven(robot)
    # Room for pushes in every case: scenarios of one structure can be stacked.
    calm = undisturbed(rules.perturbations.pushes)
    if criterion == "model":
        cases = _model_cases(nominal, calm, rules)
    elif criterion == "perturbations":
        cases = _push_cases(nominal, calm, rules, seed)
    else:
        cases = _sweep_cases(nominal, calm, rules, criterion)
    made = list(itertools.islice(cases, MAX_CASES + 1))
    if len(made) > MAX_CASES:
        raise SwingupError(f"{criterion} has more than {MAX_CASES} simulations: make its grid smaller")
    return [_seeded(case, seed, index) for index, case in enumerate(made)] if criterion in RANDOM_CRITERIA else made


def _model_cases(nominal: Plant, calm: Disturbance, rules: RobustnessBoard) -> Iterator[Case]:
    swept = [(name, model, value) for name, model in rules.model.items() for value in model.sweep.values()]
    for group, (name, model, value) in enumerate(swept):
        settings = {"parameter": name, "relative": model.relative, "value": value}
        yield Case(Scenario(validated(model.varied(nominal, value)), calm), settings, "model", group)


def _sweep_cases(nominal: Plant, calm: Disturbance, rules: RobustnessBoard, criterion: str) -> Iterator[Case]:
    sweep: Sweep = getattr(rules, criterion)
    for group, value in enumerate(sweep.values()):
        # A negative response can be simulated; a negative deviation or delay has no meaning.
        if criterion != "torque_response" and value < 0:
            raise SwingupError(f"{criterion} = {value:g} must not be negative: correct the grid")
        if criterion == "delay":
            disturbed = replace(calm, delay_steps=floored_delay_steps(value, rules.dt))
        else:
            disturbed = calm.changed(**{"response" if criterion == "torque_response" else criterion: value})
        scenario = Scenario(nominal, disturbed)
        for repetition in range(sweep.repetitions):
            settings = {"value": value} | ({"repetition": repetition} if sweep.repetitions > 1 else {})
            yield Case(scenario, settings, criterion, group)


def _push_cases(nominal: Plant, calm: Disturbance, rules: RobustnessBoard, seed: int) -> Iterator[Case]:
    random = np.random.default_rng(seed)
    for profile in range(rules.perturbations.profiles):
        pushes = draw_pushes(random, rules.perturbations, rules.duration)
        numbers = {name: getattr(pushes, name).tolist() for name in ("centre", "width", "amplitude")}
        scenario = Scenario(nominal, replace(calm, pushes=pushes))
        yield Case(scenario, {"profile": profile, **numbers}, "perturbations", profile)


def _seeded(case: Case, seed: int, index: int) -> Case:
    """The case with a noise of its own: no two of a grid, and no two seeds, share a key."""
    # The stride leaves room for the largest grid of each criterion.
    key = np.array([seed, MAX_CASES * CRITERIA.index(str(case.criterion)) + index], np.uint32)
    assert case.scenario.disturbance is not None
    disturbance = replace(case.scenario.disturbance, noise=key)
    scenario = replace(case.scenario, disturbance=disturbance)
    return replace(case, settings={**case.settings, "seed": seed}, scenario=scenario)


def change_grid(rules: RobustnessBoard, text: str) -> RobustnessBoard:
    """Rules with other values in one sweep, and a name that says so.

    The text is ``NAME=LOW:HIGH:COUNT`` for a parameter of the model or a criterion, which may have ``:REPETITIONS``
    as well, or ``perturbations=PROFILES``.
    """
    name, _, values = text.partition("=")
    changed: dict[str, Any]
    if name == "perturbations":
        _, (profiles,) = _parse(text, values, 0, 1)
        changed = {name: replace(rules.perturbations, profiles=profiles)}
    elif name in rules.model:
        (low, high), (count,) = _parse(text, values, 2, 1)
        model = replace(rules.model[name], sweep=Sweep(low, high, count))
        changed = {"model": {**rules.model, name: model}}
    elif name in SWEPT_CRITERIA:
        (low, high), (count, *repetitions) = _parse(text, values, 2, 1, 2)
        changed = {name: Sweep(low, high, count, *(repetitions or [getattr(rules, name).repetitions]))}
    else:
        known = ", ".join([*SWEPT_CRITERIA, "perturbations", *rules.model])
        raise SwingupError(f"grid {text!r} names no sweep: use NAME=LOW:HIGH:COUNT with one of {known}")
    if (criterion := "model" if name in rules.model else name) not in rules.criteria:
        raise SwingupError(f"grid {text!r} is of {criterion}, which is not measured: add it to --criteria")
    return replace(rules, name=f"{rules.name} {text}", **changed)


def _parse(text: str, values: str, ends: int, *counts: int) -> tuple[list[float], list[int]]:
    """The ends of a range and the counts behind them; ``counts`` are the accepted numbers of counts."""
    try:
        numbers = [float(part) for part in values.split(":")]
    except ValueError:
        numbers = []
    # The comparison also refuses NaN, which float() accepts.
    if len(numbers) - ends not in counts or not all(abs(number) < 1e9 for number in numbers):
        raise SwingupError(f"grid {text!r} is malformed: write NAME=LOW:HIGH:COUNT or perturbations=PROFILES")
    for number in numbers[ends:]:
        if number != int(number) or not 1 <= number < 10_000:
            raise SwingupError(f"grid {text!r} has a count of {number:g}: use a whole number of 1 to 9999")
    return numbers[:ends], [int(number) for number in numbers[ends:]]
