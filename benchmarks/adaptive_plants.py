"""What `adaptive.py` judges: plants around the leaderboards', and a policy with parts of it switched off."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from swingup.benchmark.board import Case, Result
from swingup.benchmark.judge import judge
from swingup.benchmark.robustness_board import (
    SWEPT_CRITERIA,
    ModelSweep,
    RobustnessBoard,
    Sweep,
    make_cases,
    upright,
)
from swingup.benchmark.rollout import Scenario, simulate
from swingup.benchmark.runner import run_many, stack
from swingup.common.errors import SwingupError
from swingup.controllers.interface import AbstractController
from swingup.controllers.stack.estimator import EstimatingController
from swingup.controllers.stack.policy import make_controller
from swingup.plant.base_parameters import BASE, base_parameters
from swingup.plant.plant import LEADERBOARD, Plant, Robot, validated
from swingup.plant.units import similar_plant
from swingup.policy.identifier import UNKNOWNS
from swingup.policy.pendulum import PendulumPolicy

GRID, MIDPOINTS, JOINT = "grid", "midpoints", "joint draws"
"""Sets of plants."""
ALL = "all"
"""In the place of a parameter's name, where all are off."""
JOINT_DRAWS = 200
JOINT_SEED = (2026, 200)
"""Of the joint draws alone: training and its choices draw with other seeds."""
SHARE = 0.5
"""Of the sweeps' ranges about the nominal plant, for joint draws."""
NOMINAL_CRITERIA = (*SWEPT_CRITERIA, "perturbations")
"""The criteria of the robustness board whose plant is the nominal one."""

FULL, OFF, TOLD = "adaptive", "identification off", "told the true plant"
NO_REGULATOR, NO_MEMORY = "regulator off", "memory off"


def midpoint_rules(rules: RobustnessBoard) -> RobustnessBoard:
    """Rules whose model errors lie midway between neighbouring values of these rules' sweeps."""

    def between(model: ModelSweep) -> ModelSweep:
        sweep = model.sweep
        half = 0.5 * (sweep.high - sweep.low) / (sweep.count - 1)
        return dataclasses.replace(model, sweep=Sweep(sweep.low + half, sweep.high - half, sweep.count - 1))

    model = {name: between(each) for name, each in rules.model.items()}
    return dataclasses.replace(rules, name=f"{rules.name}, midpoints", model=model)


def joint_cases(robot: Robot, rules: RobustnessBoard) -> list[Case]:
    """Plants with all parameters off, each drawn evenly from the inner half of its sweep's range."""
    random, nominal = np.random.default_rng(JOINT_SEED), LEADERBOARD.driven(robot)
    calm = make_cases(robot, rules, "model", 0)[0].scenario.disturbance
    cases = []
    for draw in range(JOINT_DRAWS):
        plant, values = nominal, {}
        for name, model in rules.model.items():
            centre = 1.0 if model.relative else 0.0
            values[name] = centre + SHARE * (random.uniform(model.sweep.low, model.sweep.high) - centre)
            plant = model.varied(plant, values[name])
        settings = {"parameter": ALL, "draw": draw, "values": values}
        cases.append(Case(Scenario(validated(plant), calm), settings, "model", draw))
    return cases


def plant_sets(robot: Robot, rules: RobustnessBoard) -> dict[str, list[Case]]:
    """The board's grid, the midpoints between its values, and the joint draws."""
    return {
        GRID: make_cases(robot, rules, "model", 0),
        MIDPOINTS: make_cases(robot, midpoint_rules(rules), "model", 0),
        JOINT: joint_cases(robot, rules),
    }


def make_variants(policy: PendulumPolicy) -> dict[str, AbstractController[Any]]:
    """The controller of a file, and the same with one part off.

    The one that is told the true plant is told it by :func:`tell_everything`, plant by plant.

    Raises:
        SwingupError: the policy has no identifier.
    """
    if policy.identifier is None:
        raise SwingupError("the policy has no identifier: choose a file with one, as acrobot-adaptive.safetensors")
    told_nominal = make_controller(dataclasses.replace(policy, identifier=None))
    full = make_controller(policy)
    variants = {FULL: full, OFF: told_nominal, TOLD: full}
    if policy.regulator is not None:
        variants[NO_REGULATOR] = make_controller(dataclasses.replace(policy, regulator=None))
    # Without an estimator there is no identifier: the policy sees measurements and the nominal plant.
    return {**variants, NO_MEMORY: make_controller(policy, estimator=False)}


def tell_everything(controller: EstimatingController, plant: Plant) -> EstimatingController:
    """The controller whose identifier knows this plant for sure, with a dead motor of the undriven joint.

    Raises:
        SwingupError: the controller has no identifier.
    """
    if controller.identifier is None:
        raise SwingupError("the controller has no identifier: choose one with it, as adaptive")
    # No offsets, no lag, and nothing that the undriven joint's motor delivers.
    base = base_parameters(similar_plant(plant, controller.scales), jnp)
    mean = jnp.concatenate([base, jnp.zeros(UNKNOWNS - BASE)])
    return dataclasses.replace(controller, prior=(mean, jnp.zeros((UNKNOWNS, UNKNOWNS))))


class Judge:
    """Simulates each variant on each set of plants once."""

    def __init__(self, policy: PendulumPolicy, rules: RobustnessBoard, seed: int, seeds: int) -> None:
        """Make the plants and the variants.

        Args:
            policy: of a file.
            rules: of the robustness board.
            seed: the first seed of noise and pushes.
            seeds: number of seeds in a row.
        """
        self.policy, self.rules, self.seeds = policy, rules, range(seed, seed + seeds)
        self.variants, self.sets = make_variants(policy), plant_sets(policy.robot, rules)
        self._held: dict[str, dict[str, np.ndarray]] = {}
        self._boards: dict[str, Result] = {}

    def held(self, variant: str, plants: str) -> np.ndarray:
        """Whether each plant of a set ends upright, with the rules of the board."""
        if variant not in self._held:
            # One stack of all sets: one compiled program.
            success = self._successes(variant, [case for cases in self.sets.values() for case in cases])
            ends = np.cumsum([len(cases) for cases in self.sets.values()])
            self._held[variant] = dict(zip(self.sets, np.split(success, ends[:-1]), strict=True))
        return self._held[variant][plants]

    def _successes(self, variant: str, cases: list[Case]) -> np.ndarray:
        controller, rules = self.variants[variant], self.rules
        scenarios = stack([case.scenario for case in cases])
        if variant == TOLD:
            return upright(_told_ends(controller, scenarios, rules), rules.tolerance)
        batch = run_many(controller, scenarios, rules.dt, rules.steps)
        answered = np.array([fault is None for fault in batch.faults])
        return upright(batch.final, rules.tolerance) & answered

    def nominal(self, variant: str) -> Result:
        """The criteria of the board whose plant is the nominal one."""
        # There the true plant is the nominal one: telling it is switching identification off.
        variant = OFF if variant == TOLD else variant
        if variant not in self._boards:
            seed, seeds, found = self.seeds[0], len(self.seeds), self.variants[variant]
            board = dataclasses.replace(self.rules, criteria=NOMINAL_CRITERIA)
            judged = judge(found, self.policy.robot, board, seeds, seed=seed, name=variant)
            self._boards[variant] = judged
        return self._boards[variant]


def _told_ends(controller: AbstractController[Any], scenarios: Scenario, rules: RobustnessBoard) -> np.ndarray:
    """Last states (n, 4) with each plant told to the controller."""
    assert isinstance(controller, EstimatingController)

    @jax.jit
    @jax.vmap
    def final(scenario: Scenario) -> jax.Array:
        knowing = tell_everything(controller, scenario.parameters)
        return simulate(scenario, knowing, jnp.zeros(4), rules.dt, rules.steps)[0]

    with jax.enable_x64(True):
        return np.asarray(final(scenarios))
