"""Recipes: stages of refinement as data, and the function that runs them."""

import dataclasses
import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np

from ..benchmark.board import Criteria
from ..benchmark.judge import judge
from ..benchmark.runner import StageProgress
from ..common import __version__
from ..common.checks import check_seeds, one_of
from ..common.errors import SwingupError
from ..controllers.stack.policy import PolicyController, make_controller, plant_of, policy_alone, policy_of
from ..loop.domain import Domain
from ..loop.resolve import resolve
from ..loop.starts import Starts
from ..plant.plant import LEADERBOARD, Plant, PlantLike, Robot
from ..plant.units import ACCELERATION, arm_scales, scaled, similar_plant
from ..policy.estimator import default_estimator
from ..policy.identifier import IdentifierSettings
from ..policy.network import stages_for
from ..policy.pendulum import PendulumPolicy, plant_difference, policy_plant, write_pendulum_policy
from ..policy.regulator import RegulatorSettings
from .distil import DistillationStage, RecoveryStage, ScoredSteps, distil, recover
from .gradient import EpisodeWeights, GradientStage, descend
from .teachers import PlantDraws, behind_motor, draw_plants, make_training_set

_LOGGER = logging.getLogger(__name__)

Stage = GradientStage | DistillationStage | RecoveryStage

RECOVER, ADAPT = "recover", "adapt"  # recipes by name; the second makes a policy that sees its plant
RECIPES: dict[str, tuple[Stage, ...]] = {
    RECOVER: (GradientStage(EpisodeWeights(down=1.0, away=0.2)),),
    ADAPT: (
        # Recoveries below the speeds at which loops of real robots stop.
        GradientStage(EpisodeWeights(down=1.0, away=0.2, fast=4.0)),
        DistillationStage(
            PlantDraws(single=160, joint=160, friction=120, robot=400),
            ScoredSteps(
                steps=1500,
                weight=3.0,
                swingups=6,
                recoveries=48,
                duration=1.5,
                starts=Starts(thrown=0.5, near_top=0.5),
                nominal=0.0,
                weights=EpisodeWeights(down=3.0, away=2.0, fast=30.0),
                batch=(256, 2048),
            ),
        ),
    ),
}
"""``recover``: be up again soon after throws. ``adapt``: recover calmly, then see the plant and swing up any of
many."""
RECOVER_ON_MANY: tuple[Stage, ...] = (
    RecoveryStage(
        PlantDraws(single=80, joint=80, friction=60, robot=500),
        ScoredSteps(
            steps=1000,
            weight=2.0,
            swingups=4,
            recoveries=96,
            duration=2.0,
            starts=Starts(thrown=0.45, thrown_on_robot=0.3, passing=0.1, hanging=0.15, spread=0.02),
            nominal=0.8,
            weights=EpisodeWeights(down=0.75, away=0.5, fast=7.5, wound=0.5),
            batch=(0, 1024),
        ),
    ),
)
"""``recover`` for a policy that sees its plant."""

HAND_OVER = {
    "acrobot": RegulatorSettings(enter=2.6, leave=15.0, enter_coulomb=0.004),
    "pendubot": RegulatorSettings(enter=0.04, leave=6.0, leave_coulomb=0.1),
}
"""Chosen on plants and seeds that no board has, the acrobot's ``enter`` by its score too (``lab/adaptive.md``)."""
IDENTIFIERS = {
    "acrobot": IdentifierSettings(load_deviation=0.01, spring_deviation=0.01),
    "pendubot": IdentifierSettings(load_deviation=0.02, spring_deviation=0.01),
}
"""Identifiers that look for loads and springs. Chosen on robots outside of the package (``lab/adaptive.md``)."""
ACCELERATION_NOISE = 10.0
"""The estimator's where the model is the plant found (rad/s²): such a model errs less. Chosen."""
RECORDED = "recorded"  # The domain of the robot's plants, where a policy sees its plant and no domain is given
GUESS = 0.1  # share by which masses and inertias of a plant without ranges may be off


@dataclass(frozen=True)
class RefinementReport:
    """The progress of a recipe."""

    stages: tuple[Stage, ...]
    """The stages of the recipe."""
    stage: int
    """The present one, counted from 1."""
    iteration: int
    """Gradient steps of this stage so far; rounds of a distillation."""
    total: int
    """Gradient steps or rounds of the whole stage."""
    seconds: float
    """Since the recipe began."""
    policy: PendulumPolicy
    """The policy so far, with what stands around it."""
    criteria: Criteria
    """The policy's result on the board ``performance``."""
    measures: dict[str, float]
    """Means over the latest episodes: the score of the nominal ones, and the share of time down of the others."""


def run_recipe(
    policy: PendulumPolicy,
    recipe: str | Sequence[Stage] = RECOVER,
    seed: int = 0,
    *,
    plant: PlantLike | Domain | None = None,
    domain: Domain | str | None = None,
    finished: int = 0,
    report: Callable[[RefinementReport], Any] = lambda _: None,
    progress: StageProgress = lambda _, __, ___: None,
) -> PendulumPolicy:
    """Take a policy through the stages of a recipe, in minutes to an hour; it computes in C.1's units.

    Args:
        policy: the policy to start from; what stands around it is made anew.
        recipe: ``recover``, ``adapt``, or stages in order. ``adapt`` starts from a policy that recovers.
        seed: seed of all random numbers.
        plant: what the policy is refined on: a plant, its name or its file; None for the leaderboards' plant. For a
            policy that sees its plant it stands in the loop of the domain; without ranges it is a guess, which is
            off by 10 %. None for the domain's plants.
        domain: for a policy that sees its plant: plants, about the one that the domain is designed for, without
            friction, and loops; None for ``recorded``.
        finished: stages of the recipe that the policy has gone through already; those that are left draw other
            numbers then.
        report: called after every ten gradient steps, after each round of a distillation, and after each stage.
        progress: called with what a distillation computes, how much of it is done, and of how much.

    Raises:
        SwingupError: there is no such recipe, plant or domain, the weights are no longer finite, or a stage does
            not take such a policy or plant.
    """
    check_seeds(seed, 1)
    stages, robot = recipe, policy.robot
    if isinstance(stages, str):
        stages = RECIPES[one_of("recipe", stages, RECIPES)]
        if recipe == RECOVER and policy.network.plant_stage is not None:
            stages = RECOVER_ON_MANY
    stages = tuple(stages)
    controller = policy_alone(policy)
    around, found = _refined_on(policy, stages, plant, domain)
    # Only the mean acts when a policy is judged; the deviation's head would stay without gradient.
    controller = eqx.tree_at(lambda c: c.policy.actor.std_head, controller, None, is_leaf=lambda leaf: leaf is None)
    facts = policy_plant(found, robot)
    # As it moves its own plant, in that plant's units, so it is to move this one.
    similar, share = similar_plant(facts, arm_scales(facts)), policy.torque_limit / policy.plant.limit(robot.joint)
    controller = for_similar_plant(controller, similar, share)
    limit = around.high.passive_limit(robot)
    random, start = np.random.default_rng([seed, finished] if finished else seed), time.perf_counter()

    def judge_and_report(
        number: int, total: int, now: PolicyController, iteration: int, measures: dict[str, float] | None = None
    ) -> None:
        if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(now.policy.actor)):
            raise SwingupError("refining diverged: weights are not finite; start from another policy or seed")
        # Alone, or where it sees its plant with what finds that.
        wrapped = wrapped_policy(for_similar_plant(now, facts, share), limit)
        judged = make_controller(wrapped, estimator=now.policy.sees_plant)
        criteria = judge(judged, robot, plant=found).criteria
        seconds = time.perf_counter() - start
        report(RefinementReport(stages, number, iteration, total, seconds, wrapped, criteria, measures or {}))

    for number, stage in enumerate(stages[finished:], start=finished + 1):
        if isinstance(stage, GradientStage):
            controller = descend(controller, stage, random, partial(judge_and_report, number, stage.steps), similar)
            continue
        targets = draw_plants(random, robot, stage.draws, similar, around)
        if isinstance(stage, RecoveryStage):
            after_part, regulator = partial(judge_and_report, number, 1), HAND_OVER[robot.name]
            controller = recover(controller, targets, stage, random, regulator, after_part, progress)
        else:
            training = make_training_set(controller, targets, stage.copies, partial(progress, "swing-ups"))
            after_round = partial(judge_and_report, number, stage.rounds + 1)
            controller = distil(training, stage, random, after_round, progress)
    return wrapped_policy(for_similar_plant(controller, facts, share), limit)


def _refined_on(
    policy: PendulumPolicy, stages: Sequence[Stage], plant: PlantLike | Domain | None, domain: Domain | str | None
) -> tuple[Domain, Plant]:
    # The plants in their loops where the policy sees its plant, or will; and the plant that it is made for.
    on_one = [isinstance(stage, GradientStage) for stage in stages]
    sees_plant = policy.network.plant_stage is not None
    if sees_plant and any(on_one):
        raise SwingupError(
            "the policy sees its plant, and gradient steps on a single one would blind it: take the recipe recover"
        )
    if sees_plant or not all(on_one):
        around = resolve(plant, RECORDED if domain is None else domain, GUESS)
        found = first_plant(around, policy.robot)
        if sees_plant and plant is None and domain is None:
            _warn_of_other_plant(policy, found)
        return around, found
    if domain is not None:
        name = domain.name if isinstance(domain, Domain) else domain
        raise SwingupError(f"the domain {name} is for a policy that sees its plant: give a plant alone")
    found = resolve(LEADERBOARD if plant is None else plant).facts
    if plant is None:
        _warn_of_other_plant(policy, found)
    return resolve(domain=RECORDED), found


def _warn_of_other_plant(policy: PendulumPolicy, found: Plant) -> None:
    driven, stage = found.driven(policy.robot), policy.network.plant_stage
    difference = plant_difference(policy.plant, driven, policy.robot, stage)
    if difference is not None:
        _LOGGER.warning("without a plant the policy is refined for the leaderboards' robot: %s", difference)


def first_plant(domain: Domain, robot: Robot) -> Plant:
    """The plant that policies for a domain begin with, without friction.

    It is the design that the domain's source names, or else the middle of the ranges as it seems behind a motor of
    the middle gain: an identifier that begins with it errs least.
    """
    plant = domain.design.frictionless()
    if domain.design != domain.nominal_plant:
        return plant
    return behind_motor(plant, getattr(domain.nominal.loop, f"gain{robot.joint + 1}"))


def for_similar_plant(controller: PolicyController, plant: Plant, share: float = 1.0) -> PolicyController:
    """A policy for another plant, in that plant's units, with a share of its motor's torque."""
    stages = stages_for(controller.policy.stages, plant_of(controller), plant)
    policy = dataclasses.replace(controller.policy, stages=stages)
    limit = share * plant.limit(controller.robot.joint)
    return dataclasses.replace(controller, policy=policy, plant=plant, torque_limit=limit)


def wrapped_policy(controller: PolicyController, passive_limit: float | None = None) -> PendulumPolicy:
    """What the file of a refined policy holds: an estimator, and around a policy that sees its plant what finds it.

    ``passive_limit`` is the largest compensation of the passive joint's friction (N m); None for the default.
    """
    scales = arm_scales(plant_of(controller))
    policy, estimator = policy_of(controller), default_estimator(plant_of(controller))
    if not controller.policy.sees_plant:
        return dataclasses.replace(policy, estimator=estimator)
    noise = scales.scaled(ACCELERATION_NOISE, ACCELERATION)
    estimator = dataclasses.replace(estimator, acceleration_noise=noise)
    identifier = scaled(IDENTIFIERS[controller.robot.name], scales)
    if passive_limit is not None:
        identifier = dataclasses.replace(identifier, passive_limit=passive_limit)
    regulator = scaled(HAND_OVER[controller.robot.name], scales)
    return dataclasses.replace(policy, estimator=estimator, identifier=identifier, regulator=regulator)


def save_refined(
    path: str | Path, report: RefinementReport, base: PendulumPolicy, command: str, seed: int, **more: Any
) -> None:
    """Write the policy of a report, with how it was made, the origin of the policy before, and more metadata."""
    kept = ("version", "preset", "command", "seed", "frames", "seconds", "scores")
    provenance = {
        "version": __version__,
        "command": command,
        "seed": seed,
        "seconds": round(report.seconds, 1),
        "stages": [{"kind": type(stage).__name__} | dataclasses.asdict(stage) for stage in report.stages],
        "scores": {"v2": dataclasses.asdict(report.criteria)},
        "base": {name: base.metadata[name] for name in kept if name in base.metadata},
    }
    write_pendulum_policy(path, report.policy, provenance | more)
