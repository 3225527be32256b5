"""The optimal-control baselines by name, designed for a plant."""

import functools
import logging
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np

from ..errors import SwingupError
from ..physics.angles import UPRIGHT
from ..physics.equations import StateFloats
from ..physics.plant import Plant, PlantLike
from ..physics.units import scales_of
from ..robots import Robot, get_robot
from .controller import AbstractController
from .lqr import LQR, upright_lqr
from .model import model_of
from .mpc import mpc
from .optimal import OPTIMAL, Optimal, compute_optimal_reference
from .own_units import scaled_optimal, scaled_published, stretched
from .published import PUBLISHED, Published
from .reference import Reference, compute_reference, load_reference
from .search import SEARCH
from .switch import LatchingSwitch
from .tracking import riccati_controller, tvlqr

BASELINES = ("lqr", "tvlqr", "ilqr-riccati", "ilqr-mpc", "tvlqr-score")
"""Names of the baselines: the LQR at the top, and controllers that follow a swing-up and end with that LQR.

All settings are the published ones, except those of ``tvlqr-score``, which is ours.
"""

SHIPPED_TRAJECTORIES = {"published": "ilqr", "score": "score"}
"""Endings of the file names, by the optimisation's problem."""

DESIGN_SEED = 0
"""Seed of the swing-ups that are computed for other plants."""
FAR = 0.1
"""A swing-up that ends farther from upright than this, in an angle, is none (rad)."""

_LOGGER = logging.getLogger(__name__)


@dataclass(frozen=True)
class Design:
    """What a baseline is designed from."""

    robot: Robot
    model: Plant
    published: Published
    """In the model's units."""
    optimal: Optimal
    """In the model's units."""
    shipped: bool
    """Whether the package ships the model's swing-ups; others are computed."""

    def reference(self, problem: str) -> Reference:
        """The swing-up that optimises a problem, "published" or "score"."""
        if self.shipped:
            return shipped_reference(self.robot, problem)[0]
        return _computed_reference(self.robot, problem, self.model)


def design_of(robot: Robot, plant: PlantLike | None) -> Design:
    """Settings for a plant; for the leaderboards' (None) the published ones and the shipped swing-ups.

    Raises:
        SwingupError: there is no such plant, or it has no units.
    """
    model, published, optimal = model_of(plant, robot), PUBLISHED[robot.name], OPTIMAL[robot.name]
    if plant is None or model == model_of(None, robot):
        return Design(robot, model, published, optimal, shipped=True)
    scales = scales_of(model)
    if not scales.torque_limit > 0:
        raise SwingupError(f"the {robot.name}'s motor has a torque limit of 0: raise tl{robot.joint + 1}")
    return Design(robot, model, scaled_published(published, scales), scaled_optimal(optimal, scales), False)


def baseline(name: str, robot: Robot | str, plant: PlantLike | None = None) -> AbstractController[Any]:
    """A baseline for a robot.

    Args:
        name: one of :data:`BASELINES`.
        robot: which joint is driven.
        plant: what it is designed for: a plant, its name or its file; None for the leaderboards',
            with the published settings and the shipped swing-up. For another plant the settings are in its own
            units, Coulomb friction is left out, and the swing-up is computed, once in a process.

    Raises:
        SwingupError: there is no such baseline, robot or plant.
    """
    robot = get_robot(robot)
    if name not in BASELINES:
        raise SwingupError(f"unknown baseline {name!r}: use one of {', '.join(BASELINES)}")
    design = design_of(robot, plant)
    if name == "tvlqr-score":
        return _tvlqr_score(design)
    parameters, published = design.model, design.published
    top = upright_lqr(parameters, robot, published.lqr)
    if name == "lqr":
        return top
    reference = design.reference("published")
    if name == "tvlqr":
        s = published.tvlqr
        Q = np.diag(s.state_weights)
        Qf = np.asarray(top.cost_to_go) if s.final_factor is None else s.final_factor * Q
        following = tvlqr(reference, parameters, robot, (Q, s.torque_weight, Qf), s.pieces)
        return _ending(following, top, published.tvlqr_threshold)
    if name == "ilqr-mpc":
        return _ending(mpc(reference, parameters, robot, published.mpc), top, published.mpc_threshold)
    return _ending(riccati_controller(reference, parameters), top, published.riccati_threshold)


def shipped_reference(robot: Robot | str, problem: str = "published") -> tuple[Reference, dict[str, Any]]:
    """The swing-up that the package ships for a robot, and its metadata.

    Args:
        robot: which joint is driven.
        problem: "published" for the one that the published baselines follow, "score" for that of ``tvlqr-score``.

    Raises:
        SwingupError: there is no such robot or problem.
    """
    robot = get_robot(robot)
    if problem not in SHIPPED_TRAJECTORIES:
        raise SwingupError(f"unknown problem {problem!r}: use one of {', '.join(SHIPPED_TRAJECTORIES)}")
    file = f"{robot.name}-{SHIPPED_TRAJECTORIES[problem]}.safetensors"
    with resources.as_file(resources.files("swingup") / "zoo" / file) as path:
        return load_reference(path)


@functools.lru_cache(maxsize=32)
def _computed_reference(robot: Robot, problem: str, model: Plant) -> Reference:
    """A swing-up for a model, computed once in a process; a warning says when it does not come up."""
    design = design_of(robot, model)
    if problem == "score":
        found = compute_score_reference(design, DESIGN_SEED)[0]
    else:
        found = compute_reference(robot, design.published.swingup, DESIGN_SEED, model)[0]
    if not comes_up(found, model):
        _LOGGER.warning("no swing-up of the %s was found for this plant: its baselines will fail", robot.name)
    return found


def compute_score_reference(design: Design, seed: int) -> tuple[Reference, dict[str, Any]]:
    """Optimise a swing-up for the score; takes one or two minutes, or, for other plants, a few times as long.

    Args:
        design: the model and the problem. For another plant than the leaderboards' longer durations are tried until
            one is enough.
        seed: of the first torques.

    Returns:
        The trajectory, and its provenance: JSON values for the file.

    Raises:
        SwingupError: no first torque led to a finite cost.
    """
    for stretch in (1.0,) if design.shipped else SEARCH.durations:
        problem = stretched(design.optimal.swingup, stretch)
        found, provenance = compute_optimal_reference(design.robot, problem, seed, design.model)
        if comes_up(found, design.model):
            break
    return found, provenance


def comes_up(reference: Reference, parameters: Plant) -> bool:
    """Whether a swing-up ends near upright, with torques that the motor has."""
    error = np.abs(np.asarray(reference.states)[-1] - UPRIGHT)[:2].max()
    return bool(error < FAR and np.abs(reference.torque).max() <= max(parameters.tl1, parameters.tl2))


def _tvlqr_score(design: Design) -> LatchingSwitch:
    parameters, robot, optimal = design.model, design.robot, design.optimal
    top, reference = upright_lqr(parameters, robot, optimal.lqr), design.reference("score")
    # Q and R are per second, as those of the LQR at the top, whose cost-to-go the recursion starts from.
    Q, R = reference.dt * np.diag(optimal.lqr.state_weights), reference.dt * optimal.lqr.torque_weight
    pieces = len(reference.torque) // optimal.rows_per_piece
    following = tvlqr(reference, parameters, robot, (Q, R, np.asarray(top.cost_to_go)), pieces)
    return _ending(following, top, optimal.threshold)


def _ending(first: AbstractController[Any], top: LQR, threshold: StateFloats) -> LatchingSwitch:
    return LatchingSwitch(first, top, np.array(threshold), top.robot)
