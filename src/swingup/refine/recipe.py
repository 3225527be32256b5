"""Recipes: the stages that a policy goes through, as data, and what runs them."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import equinox as eqx
import jax
import numpy as np

from ..benchmark.criteria import Criteria
from ..benchmark.evaluate import evaluate
from ..control.controller import AbstractController
from ..control.registry import get_controller
from ..errors import SwingupError
from ..physics.parameters import Robot
from ..policy.jax_backend.controller import PolicyController
from .analytic_policy_gradient import AnalyticPolicyGradient, PolicyGradientSettings
from .behaviour_cloning import CloningSettings, imitate
from .episodes import Draws, draw
from .objective import TIME


@dataclass(frozen=True)
class Refinement:
    """A stage of gradient steps."""

    descent: PolicyGradientSettings
    draws: Draws
    weak: float = 1.0
    """Strength of errors and disturbances in the first step; it grows to 1 over four fifths of the steps."""

    def strength(self, iteration: int) -> float:
        """Of errors and disturbances in this step, from 0 to 1."""
        return min(1.0, self.weak + (1.0 - self.weak) * iteration / (0.8 * self.descent.iterations))


Stage = CloningSettings | Refinement

HARDEN = Refinement(
    PolicyGradientSettings(), Draws(nominal=40, model=48, pushed=24, measured=16, anywhere=8), weak=0.3
)
"""Make a good swing-up robust, from mild disturbances to strong ones."""

RECOVER = Refinement(
    PolicyGradientSettings(
        iterations=900, learning_rate=5e-4, duration=1.5, adjoint_limit=4.0, nominal=TIME, others=TIME
    ),
    Draws(nominal=4, model=0, pushed=0, measured=0, anywhere=18, thrown=180),
)
"""Be up again soon, from wherever a throw leaves the pendulum."""

RECIPES: dict[str, tuple[Stage, ...]] = {
    "score": (CloningSettings(),),
    "harden": (HARDEN,),
    "recover": (RECOVER,),
}
"""``score``: a teacher's swing-up. ``harden``: the policy's own, made robust. ``recover``: back up after throws."""


@dataclass(frozen=True)
class Report:
    """Where a recipe stands."""

    stage: int
    """Counted from 1."""
    iteration: int
    """Gradient steps of this stage so far."""
    of: int
    """Gradient steps of this stage in all."""
    seconds: float
    """Since the recipe began."""
    controller: PolicyController
    """The policy as it is now."""
    criteria: Criteria
    """Its performance."""
    measures: dict[str, float] = field(default_factory=dict)
    """Means over the latest episodes: score of the nominal ones, share of time down of all others."""


def refine(
    controller: PolicyController,
    robot: Robot,
    stages: tuple[Stage, ...],
    seed: int = 0,
    report: Callable[[Report], Any] = lambda _: None,
    every: int = 10,
) -> PolicyController:
    """Take a policy through the stages of a recipe.

    Args:
        controller: the policy to start from.
        robot: its robot.
        stages: what to do, in order.
        seed: of everything that is drawn.
        report: called after every ``every`` gradient steps and after each stage.
        every: gradient steps between reports.

    Raises:
        SwingupError: the weights are no longer finite, or a teacher cannot teach.
    """
    start = time.perf_counter()
    controller = eqx.tree_at(lambda c: c.policy.actor.std_head, controller, None, is_leaf=lambda leaf: leaf is None)
    random = np.random.default_rng(seed)
    for number, stage in enumerate(stages, start=1):

        def tell(
            now: PolicyController, iteration: int, of: int, measures: dict[str, float], number: int = number
        ) -> None:
            criteria = evaluate(now, robot).criteria
            report(Report(number, iteration, of, time.perf_counter() - start, now, criteria, measures))

        if isinstance(stage, CloningSettings):
            teacher = get_controller(stage.teacher, robot)
            if not isinstance(teacher, AbstractController):
                raise SwingupError(f"teacher {stage.teacher!r} is plain Python: use a controller in JAX")
            controller = imitate(controller, teacher, robot, stage, random)
            tell(controller, stage.steps, stage.steps, {})
        else:
            controller = _descend(controller, robot, stage, random, tell, every)
    return controller


def _descend(
    controller: PolicyController,
    robot: Robot,
    stage: Refinement,
    random: np.random.Generator,
    tell: Callable[[PolicyController, int, int, dict[str, float]], None],
    every: int,
) -> PolicyController:
    descent, number = AnalyticPolicyGradient(controller, stage.descent), stage.descent.iterations
    recent: list[dict[str, float]] = []
    for iteration in range(number):
        episodes = draw(random, robot, stage.draws, stage.strength(iteration))
        measures = descent.step(episodes)
        recent.append(_means(np.asarray(episodes.nominal), measures))
        if (iteration + 1) % every == 0 or iteration + 1 == number:
            controller = _with_actor(controller, descent)
            tell(
                controller,
                iteration + 1,
                number,
                {name: float(np.mean([each[name] for each in recent])) for name in recent[0]},
            )
            recent.clear()
    return controller


def _means(nominal: np.ndarray, measures: Any) -> dict[str, float]:
    score, down = np.asarray(measures.score), np.asarray(measures.down)
    means = {"nominal_score": score[nominal], "others_down": down[~nominal]}
    return {name: float(values.mean()) for name, values in means.items() if values.size}


def _with_actor(controller: PolicyController, descent: AnalyticPolicyGradient) -> PolicyController:
    actor = jax.tree.map(np.asarray, descent.iterate.actor)
    if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(actor)):
        raise SwingupError("refining diverged: weights are not finite; start from another policy or seed")
    return eqx.tree_at(lambda c: c.policy.actor, controller, actor)
