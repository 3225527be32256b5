"""The optimal-control baselines by name, with the leaderboard's plant as their model."""

from importlib import resources
from typing import Any

import numpy as np

from ..errors import SwingupError
from ..physics.equations import StateFloats
from ..physics.parameters import Robot, get_robot, leaderboard_parameters
from .controller import AbstractController
from .lqr import LQR, upright_lqr
from .mpc import mpc
from .optimal import OPTIMAL
from .published import PUBLISHED
from .reference import Reference, load_reference
from .switch import LatchingSwitch
from .tracking import RiccatiController, tvlqr

BASELINES = ("lqr", "tvlqr", "ilqr-riccati", "ilqr-riccati-unregularised", "ilqr-mpc", "tvlqr-score")
"""Names of the baselines: the LQR at the top, and controllers that follow a shipped swing-up and end with that LQR.

All settings are the published ones, except those of ``tvlqr-score``, which is ours.
"""

SHIPPED_TRAJECTORIES = {"published": "ilqr", "score": "score"}
"""Endings of the file names, by the optimisation's problem."""


def baseline(name: str, robot: Robot | str) -> AbstractController[Any]:
    """A baseline for a robot.

    Raises:
        SwingupError: there is no such baseline or robot.
    """
    robot = get_robot(robot)
    if name not in BASELINES:
        raise SwingupError(f"unknown baseline {name!r}: use one of {', '.join(BASELINES)}")
    if name == "tvlqr-score":
        return _tvlqr_score(robot)
    parameters, published = leaderboard_parameters(robot), PUBLISHED[robot.name]
    top = upright_lqr(parameters, robot, published.lqr)
    if name == "lqr":
        return top
    reference = shipped_reference(robot)[0]
    if name == "tvlqr":
        s = published.tvlqr
        Q = np.diag(s.state_weights)
        Qf = np.asarray(top.cost_to_go) if s.final_factor is None else s.final_factor * Q
        following = tvlqr(reference, parameters, robot, (Q, s.torque_weight, Qf), s.pieces)
        return _ending(following, top, published.tvlqr_threshold)
    if name == "ilqr-mpc":
        return _ending(mpc(reference, parameters, robot, published.mpc), top, published.mpc_threshold)
    gains = reference.gains if name == "ilqr-riccati" else reference.unregularised_gains
    riccati = RiccatiController(reference.dt, reference.states, reference.torque, gains, robot)
    return _ending(riccati, top, published.riccati_threshold)


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
    file = f"{robot.name}-{SHIPPED_TRAJECTORIES[problem]}.npz"
    with resources.as_file(resources.files("swingup") / "zoo" / file) as path:
        return load_reference(path)


def _tvlqr_score(robot: Robot) -> LatchingSwitch:
    parameters, optimal = leaderboard_parameters(robot), OPTIMAL[robot.name]
    top, reference = upright_lqr(parameters, robot, optimal.lqr), shipped_reference(robot, "score")[0]
    # Q and R are per second, as those of the LQR at the top, whose cost-to-go the recursion starts from.
    Q, R = reference.dt * np.diag(optimal.lqr.state_weights), reference.dt * optimal.lqr.torque_weight
    pieces = len(reference.torque) // optimal.rows_per_piece
    following = tvlqr(reference, parameters, robot, (Q, R, np.asarray(top.cost_to_go)), pieces)
    return _ending(following, top, optimal.threshold)


def _ending(first: AbstractController[Any], top: LQR, threshold: StateFloats) -> LatchingSwitch:
    return LatchingSwitch(first, top, np.array(threshold), top.robot)
