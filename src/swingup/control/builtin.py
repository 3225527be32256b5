"""The optimal-control baselines by name, with the leaderboard's plant as their model and the published settings."""

from importlib import resources
from typing import Any

import numpy as np

from ..errors import SwingupError
from ..physics.parameters import Robot, get_robot, leaderboard_parameters
from .controller import AbstractController
from .lqr import LQR, upright_lqr
from .mpc import mpc
from .published import PUBLISHED, Four
from .reference import Reference, load_reference
from .switch import Latching
from .tracking import RiccatiGains, tvlqr

BASELINES = ("lqr", "tvlqr", "ilqr-riccati", "ilqr-riccati-unregularised", "ilqr-mpc")
"""Names of the baselines: the LQR of the top, and those that follow the shipped swing-up and end in it."""


def baseline(name: str, robot: Robot | str) -> AbstractController[Any]:
    """A baseline for a robot.

    Raises:
        SwingupError: there is no such baseline or robot.
    """
    robot = get_robot(robot)
    if name not in BASELINES:
        raise SwingupError(f"unknown baseline {name!r}: use one of {', '.join(BASELINES)}")
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
    riccati = RiccatiGains(reference.dt, reference.states, reference.torque, gains, robot)
    return _ending(riccati, top, published.riccati_threshold)


def shipped_reference(robot: Robot | str) -> tuple[Reference, dict[str, Any]]:
    """The swing-up that the package ships for a robot, and its metadata.

    Raises:
        SwingupError: there is no such robot.
    """
    robot = get_robot(robot)
    with resources.as_file(resources.files("swingup") / "zoo" / f"{robot.name}-ilqr.npz") as path:
        return load_reference(path)


def _ending(first: AbstractController[Any], top: LQR, threshold: Four) -> Latching:
    return Latching(first, top, np.array(threshold), top.robot)
