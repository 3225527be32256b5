"""What else holds the plants that a controller does not: the same controller told them, and the optimum of each."""

from typing import Any, NamedTuple

import numpy as np
from adaptive_plants import ALL, FULL, TOLD, Judge
from holding_range import holding_range
from upper_bound import simulated

from swingup.benchmark.board import Case
from swingup.benchmark.boards import PERFORMANCE
from swingup.benchmark.robustness_board import RobustnessBoard, upright
from swingup.benchmark.rollout import Trajectory
from swingup.benchmark.runner import stack
from swingup.benchmark.swing_up_board import compute_criteria
from swingup.controllers.baselines.continuation import continue_swingups
from swingup.plant.plant import Plant, Robot

SAMPLE = 20
"""Plants that are not held, drawn from all sets."""
SAMPLE_SEED = (2026, 20)


class Optimum(NamedTuple):
    """What an optimal swing-up of a plant and the plant's own LQR make of it."""

    reached: bool
    """Whether the continuation came to the plant; else it is the swing-up of the last one on the way."""
    held: bool
    score: float
    """RealAI score (0 to 1), 0 without success."""


def failing_rows(judge: Judge) -> list[dict[str, Any]]:
    """A sample of the plants that the controller does not hold, and who holds them."""
    every = [
        (name, case, bool(told))
        for name, cases in judge.sets.items()
        for case, held, told in zip(cases, judge.held(FULL, name), judge.held(TOLD, name), strict=True)
        if not held
    ]
    random = np.random.default_rng(SAMPLE_SEED)
    chosen = sorted(random.permutation(len(every))[:SAMPLE])
    sample = [every[index] for index in chosen]
    found = optima(judge.policy.robot, [case for _, case, _ in sample], judge.rules)
    return [
        {
            "plants": name,
            **case.settings,
            TOLD: told,
            **optimum._asdict(),
            "range": holding_range(case.scenario.parameters, judge.policy.robot),
        }
        for (name, case, told), optimum in zip(sample, found, strict=True)
    ]


def optima(robot: Robot, cases: list[Case], rules: RobustnessBoard) -> list[Optimum]:
    """Each plant's swing-up by iterative LQR, followed with feedback and then held by the plant's LQR."""
    if not cases:
        return []
    plants = [case.scenario.parameters for case in cases]
    found = continue_swingups(robot, stack(plants))
    controllers = [found.controller(index, plant) for index, plant in enumerate(plants)]
    final, rows = simulated(controllers, plants, rules)
    held = upright(final, rules.tolerance)
    return [
        Optimum(bool(found.reached[index] == 1.0), bool(held[index]), _score(plant, rows, index))
        for index, plant in enumerate(plants)
    ]


def _score(plant: Plant, rows: Trajectory, index: int) -> float:
    time, x, u = (np.asarray(each)[index] for each in (rows.time, rows.x, rows.u))
    return compute_criteria(time, x, u, float(plant.l1), float(plant.l2), PERFORMANCE).score


def failing_lines(rows: list[dict[str, Any]]) -> list[list[str]]:
    """A line for each plant, for a table."""

    def plant(row: dict[str, Any]) -> str:
        if row["parameter"] == ALL:
            return f"joint draw {row['draw']}"
        return f"{row['plants']}: {row['parameter']} = {row['value']:.3g}"

    def yes(answer: bool) -> str:
        return "yes" if answer else "no"

    def score(row: dict[str, Any]) -> str:
        return f"{row['score']:.3f}" if row["held"] else "-"

    return [[plant(row), f"{row['range']:.2f}", yes(row[TOLD]), yes(row["held"]), score(row)] for row in rows]
