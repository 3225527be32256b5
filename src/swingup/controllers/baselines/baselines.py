"""The optimal-control baselines by name, designed for a plant."""

import functools
import logging
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np

from ...common.errors import SwingupError
from ...dynamics.angles import UPRIGHT
from ...plant.equations import StateFloats
from ...plant.plant import LEADERBOARD, Plant, PlantLike
from ...plant.robots import Robot, get_robot
from ...plant.units import Scales, scales_of, similar_plant
from ..interface.controller import AbstractController
from ..swingups.design import compute_reference, design_model
from ..swingups.reference import Reference, load_reference
from .lqr import LQR, upright_lqr
from .mpc import mpc
from .optimal import OPTIMAL, Optimal
from .own_units import in_own_units, optimal_for, published_for
from .published import PUBLISHED, Published
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
LARGEST_FINAL_ERROR = 0.1
"""A swing-up ends within this of upright, in both angles (rad)."""

_LOGGER = logging.getLogger(__name__)


@dataclass(frozen=True)
class Design:
    """What a baseline is designed from: a similar pendulum in C.1's units, and the settings."""

    robot: Robot
    model: Plant
    """The similar pendulum."""
    scales: Scales
    """The plant's units as multiples of C.1's."""
    published: Published
    optimal: Optimal
    shipped: bool
    """Whether the package ships the model's swing-ups; others are computed."""

    def reference(self, problem: str) -> Reference:
        """The similar pendulum's swing-up that optimises a problem, "published" or "score"."""
        return shipped_reference(self.robot, problem)[0] if self.shipped else _computed_reference(self, problem)

    def compute(self, problem: str, seed: int) -> tuple[Reference, dict[str, Any]]:
        """Optimise this swing-up, see :func:`design.compute_reference`."""
        swingup = self.optimal.swingup if problem == "score" else self.published.swingup
        return compute_reference(self.robot, swingup, seed, self.model)


def design_of(robot: Robot, plant: PlantLike) -> Design:
    """Settings for a plant; for the leaderboards' the published ones and the shipped swing-ups."""
    model, published, optimal = design_model(plant, robot), PUBLISHED[robot.name], OPTIMAL[robot.name]
    scales = scales_of(model)
    if model == design_model(LEADERBOARD, robot):
        return Design(robot, model, scales, published, optimal, shipped=True)
    if not scales.torque > 0:
        raise SwingupError(f"the {robot.name}'s motor has a torque limit of 0: raise tl{robot.joint + 1}")
    settings = published_for(published, scales.time), optimal_for(optimal, scales.time)
    return Design(robot, similar_plant(model, scales), scales, *settings, shipped=False)


def baseline(name: str, robot: Robot | str, plant: PlantLike = LEADERBOARD) -> AbstractController[Any]:
    """A baseline for a robot.

    Args:
        name: one of :data:`BASELINES`.
        robot: which joint is driven.
        plant: what it is designed for: a plant, its name or its file. The leaderboards' has the published settings
            and the shipped swing-up. For another plant the settings are in its own units, Coulomb friction is left
            out, and the swing-up is computed, once in a process.

    Raises:
        SwingupError: there is no such baseline, robot or plant.
    """
    robot = get_robot(robot)
    if name not in BASELINES:
        raise SwingupError(f"unknown baseline {name!r}: use one of {', '.join(BASELINES)}")
    design = design_of(robot, plant)
    designed = _designed(name, design)
    return designed if design.shipped else in_own_units(designed, design_model(plant, robot), robot, design.scales)


def _designed(name: str, design: Design) -> AbstractController[Any]:
    """A baseline for the similar pendulum."""
    parameters, robot, published, optimal = design.model, design.robot, design.published, design.optimal
    top = upright_lqr(parameters, robot, optimal.lqr if name == "tvlqr-score" else published.lqr)
    if name == "lqr":
        return top
    reference = design.reference("score" if name == "tvlqr-score" else "published")
    if name == "tvlqr-score":
        # Q and R are per second, as those of the LQR at the top, whose cost-to-go the recursion starts from.
        Q, R = reference.dt * np.diag(optimal.lqr.state_weights), reference.dt * optimal.lqr.torque_weight
        pieces = len(reference.torque) // optimal.rows_per_piece
        following = tvlqr(reference, parameters, robot, (Q, R, np.asarray(top.cost_to_go)), pieces)
        return _ending(following, top, optimal.threshold)
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
    """
    robot = get_robot(robot)
    if problem not in SHIPPED_TRAJECTORIES:
        raise SwingupError(f"unknown problem {problem!r}: use one of {', '.join(SHIPPED_TRAJECTORIES)}")
    file = f"{robot.name}-{SHIPPED_TRAJECTORIES[problem]}.safetensors"
    with resources.as_file(resources.files("swingup") / "zoo" / file) as path:
        return load_reference(path)


@functools.lru_cache(maxsize=32)
def _computed_reference(design: Design, problem: str) -> Reference:
    """A swing-up, computed once in a process; a warning says when it does not come up."""
    found = design.compute(problem, DESIGN_SEED)[0]
    if not reaches_upright(found, design.model):
        _LOGGER.warning(
            "no swing-up of the %s was found for this plant: its baselines will fail", design.robot.name
        )
    return found


def reaches_upright(reference: Reference, parameters: Plant) -> bool:
    """Whether a swing-up ends near upright, with torques that the motor has."""
    error = np.abs(np.asarray(reference.states)[-1] - UPRIGHT)[:2].max()
    limit = parameters.limit(reference.robot.joint)
    # The units of a plant are right to rounding.
    return bool(error < LARGEST_FINAL_ERROR and np.abs(reference.torque).max() <= limit * (1 + 1e-9))


def _ending(first: AbstractController[Any], top: LQR, threshold: StateFloats) -> LatchingSwitch:
    return LatchingSwitch(first, top, np.array(threshold), top.robot)
