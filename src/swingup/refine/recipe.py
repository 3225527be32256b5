"""Recipes: stages of refinement as data, and the function that runs them."""

import dataclasses
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import equinox as eqx
import jax
import numpy as np

from ..benchmark.board import Criteria
from ..benchmark.judge import judge
from ..benchmark.runner import StageProgress
from ..common.errors import SwingupError
from ..controllers.stack.policy import PolicyController, make_controller, plant_of, policy_of
from ..loop.domain import Domain, load_domain
from ..plant.files import load_plant
from ..plant.plant import LEADERBOARD, Plant, PlantLike, Robot
from ..plant.units import ACCELERATION, arm_scales, scaled, similar_plant
from ..policy.estimator import default_estimator
from ..policy.identifier import IdentifierSettings
from ..policy.network import stages_for
from ..policy.pendulum import PendulumPolicy, plant_difference, policy_plant
from ..policy.regulator import RegulatorSettings
from ..policy.shipped import ADAPTIVE, load_policy
from .analytic_policy_gradient import (
    AnalyticPolicyGradient,
    EpisodeSettings,
    PolicyGradientSettings,
    sample_episodes,
    with_actor,
)
from .distillation import distil, recover
from .distillation_settings import DistillationSettings, RecoverySettings
from .objective import EpisodeWeights
from .plant_draws import RECORDED, PlantDraws, behind_motor, draw_plants
from .teacher import make_school

_LOGGER = logging.getLogger(__name__)


@dataclass(frozen=True)
class GradientStage:
    """A stage of gradient steps; its default makes a policy recover from wherever a throw leaves the pendulum."""

    gradient: PolicyGradientSettings = PolicyGradientSettings()  # noqa: RUF009 - frozen
    episodes: EpisodeSettings = EpisodeSettings()  # noqa: RUF009 - frozen


RecipeStage = GradientStage | DistillationSettings

RECOVER, ADAPT = "recover", "adapt"
"""Recipes; the second makes a policy which sees its plant."""
CALM = PolicyGradientSettings(weights=EpisodeWeights(down=1.0, away=0.2, fast=4.0))
"""Recoveries below the speeds at which loops of real robots stop."""
RECIPES: dict[str, tuple[RecipeStage, ...]] = {
    RECOVER: (GradientStage(),),
    ADAPT: (GradientStage(CALM), DistillationSettings()),
}
"""``recover``: be up again soon after throws. ``adapt``: recover calmly, then see the plant and swing up any of
many."""
RECOVER_ON_MANY = DistillationSettings(
    draws=PlantDraws(single=80, joint=80, friction=60, robot=500),
    rounds=0,
    runs=3,
    batch=1024,
    anywhere=0,
    anywhere_batch=0,
    score_steps=1000,
    score_weight=2.0,
    score_episodes=4,
    recoveries=RecoverySettings(
        episodes=96,
        duration=2.0,
        thrown=0.45,
        nominal=0.8,
        robots=0.3,
        top=0.0,
        passing=0.1,
        hanging=0.15,
        weights=EpisodeWeights(down=0.75, away=0.5, fast=7.5, wound=0.5),
    ),
)
"""``recover`` for a policy that sees its plant: no teachers, so no rounds, and no lessons from anywhere."""


def stages_of(recipe: str, controller: PolicyController) -> tuple[RecipeStage, ...]:
    """A recipe's stages for a policy."""
    return (RECOVER_ON_MANY,) if recipe == RECOVER and controller.policy.sees_plant else RECIPES[recipe]


HAND_OVER = {
    "acrobot": RegulatorSettings(enter=2.6, leave=15.0, enter_coulomb=0.004),
    "pendubot": RegulatorSettings(enter=0.04, leave=6.0, leave_coulomb=0.1),
}
"""Chosen on plants and seeds that no board has, the acrobot's ``enter`` by its score too (``lab/adaptive.md``)."""
FINDING = {
    "acrobot": IdentifierSettings(load_deviation=0.01, spring_deviation=0.01),
    "pendubot": IdentifierSettings(load_deviation=0.02, spring_deviation=0.01),
}
"""Which loads are looked for. Chosen on robots outside of the package (``lab/adaptive.md``)."""
ACCELERATION_NOISE = 10.0
"""The estimator's where the model is the plant found (rad/s²): such a model errs less. Chosen."""


@dataclass(frozen=True)
class RefinementReport:
    """The progress of a recipe."""

    stage: int
    """Counted from 1."""
    iteration: int
    """Gradient steps of this stage so far; rounds of a distillation."""
    of: int
    """The same in all."""
    seconds: float
    """Since the recipe began."""
    controller: PolicyController
    """The policy so far."""
    criteria: Criteria
    """Its performance on the board performance."""
    measures: dict[str, float] = field(default_factory=dict)
    """Means over the latest episodes: the score of the nominal ones, and the share of time down of the others."""


def run_recipe(
    controller: PolicyController,
    robot: Robot,
    stages: tuple[RecipeStage, ...],
    seed: int = 0,
    report: Callable[[RefinementReport], Any] = lambda _: None,
    every: int = 10,
    plant: PlantLike = LEADERBOARD,
    domain: Domain | str | None = None,
    progress: StageProgress = lambda _, __, ___: None,
) -> PolicyController:
    """Take a policy through the stages of a recipe, in C.1's units.

    Args:
        controller: the policy to start from.
        robot: its robot.
        stages: the recipe's stages, in order.
        seed: seed of all random numbers.
        report: called after every ``every`` gradient steps, each round of a distillation, and each stage.
        every: gradient steps between reports.
        plant: what the policy is refined on: a plant, its name or its file.
        domain: plants that a policy learns to see, instead: about the one that the domain is designed for, without
            friction; None for those about the leaderboards' plant.
        progress: called with what a distillation computes, how much of it is done, and of how much.

    Raises:
        SwingupError: there is no such plant, the weights are no longer finite, or a stage does not take such a
            policy or plant.
    """
    kinds = {type(stage) for stage in stages}
    if controller.policy.sees_plant and GradientStage in kinds:
        raise SwingupError(
            "the policy sees its plant, and gradient steps on a single one would blind it: take the recipe recover"
        )
    sees = DistillationSettings in kinds
    if sees and plant != LEADERBOARD:
        raise SwingupError("plants are drawn for a policy that sees its plant: give a domain, not a plant")
    around = load_domain(domain or RECORDED) if not isinstance(domain, Domain) else domain
    start, found = time.perf_counter(), first_plant(around, robot) if sees else load_plant(plant)
    if found == LEADERBOARD and not sees:
        difference = plant_difference(plant_of(controller), found.driven(robot), robot)
        if difference is not None:
            _LOGGER.warning("without a plant the policy is refined on the leaderboards': %s", difference)
    # Only the mean acts when a policy is judged; the deviation's head would stay without gradient.
    controller = eqx.tree_at(lambda c: c.policy.actor.std_head, controller, None, is_leaf=lambda leaf: leaf is None)
    facts = policy_plant(found, robot)
    # As it moves its own plant, in that plant's units, so it is to move this one.
    similar = similar_plant(facts, arm_scales(facts))
    controller = on_plant(controller, similar)
    limit = float(around.high.loop.passive_limit)
    random = np.random.default_rng(seed)

    def tell(
        number: int, of: int, now: PolicyController, iteration: int, measures: dict[str, float] | None = None
    ) -> None:
        if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(now.policy.actor)):
            raise SwingupError("refining diverged: weights are not finite; start from another policy or seed")
        # Alone, or where it sees its plant with what finds that.
        real = on_plant(now, facts)
        judged = make_controller(wrapped_policy(real, limit)) if now.policy.sees_plant else real
        criteria = judge(judged, robot, plant=found).criteria
        seconds = time.perf_counter() - start
        report(RefinementReport(number, iteration, of, seconds, real, criteria, measures or {}))

    for number, stage in enumerate(stages, start=1):
        if isinstance(stage, GradientStage):
            told = partial(tell, number, stage.gradient.iterations)
            controller = _gradient_steps(controller, stage, random, told, every, similar)
            continue
        told = partial(tell, number, stage.rounds + bool(stage.score_steps))
        targets = draw_plants(random, robot, stage.draws, similar, around)
        if not stage.rounds:
            controller = recover(controller, targets, stage, random, HAND_OVER[robot.name], told, progress)
            continue
        school = make_school(controller, targets, stage.nominal, partial(progress, "swing-ups"))
        controller = distil([school], stage, random, told, progress)
    return on_plant(controller, facts)


def first_plant(domain: Domain, robot: Robot) -> Plant:
    """The plant that policies for a domain begin with, without friction.

    It is the design that the domain's source names, or else the middle of the ranges as it seems behind a motor of
    the middle gain: an identifier that begins with it errs least.
    """
    plant = domain.design.frictionless()
    if domain.design != domain.nominal_plant:
        return plant
    return behind_motor(plant, getattr(domain.nominal.loop, f"gain{robot.joint + 1}"))


def on_plant(controller: PolicyController, plant: Plant) -> PolicyController:
    """A policy for another plant, in that one's units."""
    stages = stages_for(controller.policy.stages, plant_of(controller), plant)
    policy = dataclasses.replace(controller.policy, stages=stages)
    limit = plant.limit(controller.robot.joint)
    return dataclasses.replace(controller, policy=policy, plant=plant, torque_limit=limit)


def shipped_for(domain: Domain, robot: Robot) -> PendulumPolicy | None:
    """The shipped ``adaptive`` in the units of a domain's plants; None where their first one is beyond it."""
    try:
        found = load_policy(ADAPTIVE, robot, first_plant(domain, robot))
    except SwingupError:
        return None
    assert found.identifier is not None  # it finds its plant
    identifier = dataclasses.replace(found.identifier, passive_limit=float(domain.high.loop.passive_limit))
    return dataclasses.replace(found, identifier=identifier)


def wrapped_policy(controller: PolicyController, passive_limit: float | None = None) -> PendulumPolicy:
    """What the file of a refined policy holds: an estimator, and for one that sees its plant what finds that.

    ``passive_limit`` is the largest compensation of the passive joint's friction (N m); None for the usual one.
    """
    scales = arm_scales(plant_of(controller))
    policy, estimator = policy_of(controller), default_estimator(plant_of(controller))
    if not controller.policy.sees_plant:
        return dataclasses.replace(policy, estimator=estimator)
    noise = scales.scaled(ACCELERATION_NOISE, ACCELERATION)
    estimator = dataclasses.replace(estimator, acceleration_noise=noise)
    identifier = scaled(FINDING[controller.robot.name], scales)
    if passive_limit is not None:
        identifier = dataclasses.replace(identifier, passive_limit=passive_limit)
    regulator = scaled(HAND_OVER[controller.robot.name], scales)
    return dataclasses.replace(policy, estimator=estimator, identifier=identifier, regulator=regulator)


def _gradient_steps(
    controller: PolicyController,
    stage: GradientStage,
    random: np.random.Generator,
    tell: Callable[[PolicyController, int, dict[str, float]], None],
    every: int,
    plant: Plant,
) -> PolicyController:
    learner, number = AnalyticPolicyGradient(controller, stage.gradient, plant), stage.gradient.iterations
    recent: list[dict[str, float]] = []
    for iteration in range(1, number + 1):
        x0, nominal = sample_episodes(random, controller.robot, stage.episodes, plant)
        recent.append(_means(nominal, learner.step(x0)))
        if iteration % every == 0 or iteration == number:
            controller = with_actor(controller, jax.tree.map(np.asarray, learner.actor))
            means = {name: float(np.mean([each[name] for each in recent])) for name in recent[0]}
            tell(controller, iteration, means)
            recent.clear()
    return controller


def _means(nominal: np.ndarray, measures: Any) -> dict[str, float]:
    score, down = np.asarray(measures.score), np.asarray(measures.down)
    means = {"nominal_score": score[nominal], "others_down": down[~nominal]}
    return {name: float(values.mean()) for name, values in means.items() if values.size}
