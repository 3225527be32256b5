"""The grid of the robustness benchmark: every simulation with its plant and its disturbance."""

import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ..common.errors import SwingupError
from ..loop.disturbance import Disturbance, undisturbed
from ..plant.plant import LEADERBOARD, Plant, PlantLike, load_plant, validated
from ..plant.robots import Robot
from .board import Case
from .disturbances import draw_pushes, floored_delay_steps
from .rollout import Scenario
from .rules import CRITERIA, RANDOM, SWEPT, ModelSweep, Sweep

if TYPE_CHECKING:
    from .robustness_board import RobustnessBoard

MOST_CASES = 10_000
"""Simulations of one criterion; more are refused."""


def make_cases(
    robot: Robot, rules: "RobustnessBoard", criterion: str, seed: int, plant: PlantLike = LEADERBOARD
) -> list[Case]:
    """All simulations of one criterion on a grid around the plant; the seed is that of noise and pushes."""
    nominal = load_plant(plant).driven(robot)
    # Room for pushes in every case: scenarios of one structure can be stacked.
    calm = undisturbed(rules.perturbations.pushes)
    if criterion == "model":
        made = list(_model_cases(nominal, calm, rules))
    elif criterion == "perturbations":
        made = list(_push_cases(nominal, calm, rules, seed))
    else:
        made = list(_sweep_cases(nominal, calm, rules, criterion))
    if len(made) > MOST_CASES:
        raise SwingupError(
            f"{criterion} has {len(made)} simulations: at most {MOST_CASES} can have noise of their own"
        )
    if criterion in RANDOM:
        made = [_seeded(case, seed, index) for index, case in enumerate(made)]
    return made


def _model_cases(nominal: Plant, calm: Disturbance, rules: "RobustnessBoard") -> Iterator[Case]:
    group = 0
    for name, model in rules.model.items():
        for value in model.sweep.values():
            parameters = validated(vary(nominal, model, value))
            settings = {"parameter": name, "relative": model.relative, "value": value}
            yield Case(Scenario(parameters, calm), settings, "model", group)
            group += 1


def vary(nominal: Plant, model: ModelSweep, value: float) -> Plant:
    """The plant with one value of a sweep: with a product m r it is r that changes."""
    if model.relative:
        mass = 1.0 if model.mass is None else getattr(nominal, model.mass)
        # The benchmark varies m r and divides by m. Another order of operations would round differently.
        value = mass * getattr(nominal, model.parameter) * value / mass
    else:
        # Added: the leaderboards' plant has 0 of what changes so, other plants have not.
        value = getattr(nominal, model.parameter) + value
    return nominal.changed(**{model.parameter: value})


def _sweep_cases(nominal: Plant, calm: Disturbance, rules: "RobustnessBoard", criterion: str) -> Iterator[Case]:
    sweep: Sweep = getattr(rules, criterion)
    for group, value in enumerate(sweep.values()):
        # A negative response can be simulated; a negative deviation or delay has no meaning.
        if criterion != "torque_response" and value < 0:
            raise SwingupError(f"{criterion} = {value:g} must not be negative: correct the grid")
        if criterion == "delay":
            disturbed = dataclasses.replace(calm, delay_steps=floored_delay_steps(value, rules.dt))
        else:
            disturbed = calm.changed(**{"response" if criterion == "torque_response" else criterion: value})
        scenario = Scenario(nominal, disturbed)
        for repetition in range(sweep.repetitions):
            settings = {"value": value} | ({"repetition": repetition} if sweep.repetitions > 1 else {})
            yield Case(scenario, settings, criterion, group)


def _push_cases(nominal: Plant, calm: Disturbance, rules: "RobustnessBoard", seed: int) -> Iterator[Case]:
    random = np.random.default_rng(seed)
    for profile in range(rules.perturbations.profiles):
        pushes = draw_pushes(random, rules.perturbations, rules.duration)
        numbers = {name: getattr(pushes, name).tolist() for name in ("centre", "width", "amplitude")}
        scenario = Scenario(nominal, dataclasses.replace(calm, pushes=pushes))
        yield Case(scenario, {"profile": profile, **numbers}, "perturbations", profile)


def _seeded(case: Case, seed: int, index: int) -> Case:
    """The case with a noise of its own: no two of a grid, and no two seeds, share a key."""
    # The stride leaves room for the largest grid of each criterion.
    key = np.array([seed, MOST_CASES * CRITERIA.index(str(case.criterion)) + index], np.uint32)
    assert case.scenario.disturbance is not None
    disturbance = dataclasses.replace(case.scenario.disturbance, noise=key)
    scenario = Scenario(case.scenario.parameters, disturbance)
    return dataclasses.replace(case, settings={**case.settings, "seed": seed}, scenario=scenario)


def change_grid(rules: "RobustnessBoard", text: str) -> "RobustnessBoard":
    """Rules with other values in one sweep, and a name that says so.

    The text is ``NAME=LOW:HIGH:COUNT`` or ``NAME=LOW:HIGH:COUNT:REPETITIONS`` for a criterion or a parameter of the
    model, or ``perturbations=PROFILES``.
    """
    name, _, values = text.partition("=")
    changed: dict[str, Any]
    if name == "perturbations":
        profiles = _parse(text, values, 1)[0]
        changed = {name: dataclasses.replace(rules.perturbations, profiles=_count(text, profiles))}
    elif name in rules.model:
        model = dataclasses.replace(rules.model[name], sweep=_parse_sweep(text, values, 1))
        changed = {"model": {**rules.model, name: model}}
    elif name in SWEPT:
        changed = {name: _parse_sweep(text, values, getattr(rules, name).repetitions)}
    else:
        known = ", ".join([*SWEPT, "perturbations", *rules.model])
        raise SwingupError(f"grid {text!r} names no sweep: use NAME=LOW:HIGH:COUNT with one of {known}")
    return dataclasses.replace(rules, name=f"{rules.name} {text}", **changed)


def _parse_sweep(text: str, values: str, repetitions: int) -> Sweep:
    low, high, count, *rest = _parse(text, values, 3, 4)
    return Sweep(low, high, _count(text, count), _count(text, rest[0]) if rest else repetitions)


def _parse(text: str, values: str, *lengths: int) -> list[float]:
    parts = values.split(":")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    # The comparison also refuses NaN, which float() accepts.
    if len(numbers) not in lengths or not all(abs(number) < 1e9 for number in numbers):
        raise SwingupError(f"grid {text!r} is malformed: write NAME=LOW:HIGH:COUNT or perturbations=PROFILES")
    return numbers


def _count(text: str, number: float) -> int:
    if number != int(number) or not 1 <= number < 10_000:
        raise SwingupError(f"grid {text!r} has a count of {number:g}: use a whole number of 1 to 9999")
    return int(number)
