"""The score of a recording by the rules of a board."""

from dataclasses import replace

import numpy as np

from ..common.errors import SwingupError
from ..plant.plant import LEADERBOARD, PlantLike, load_plant
from ..plant.robots import Robot, get_robot
from .board import AbstractBoard, Case, Setting
from .boards import get_board
from .plausibility import examine
from .recording import checked_rows
from .result import Result
from .rollout import Scenario, Trajectory


def score(
    trajectory: Trajectory,
    robot: Robot | str,
    board: AbstractBoard | str = "performance",
    *,
    name: str = "recording",
    plant: PlantLike = LEADERBOARD,
) -> Result:
    """Score a recording from any source by the rules of a board, whoever pushed or threw the pendulum and when.

    Times count from 0, or from the first row where that is earlier. A span below 99 % of the duration is no
    success; in an uptime the missing time counts as down.

    Args:
        trajectory: NumPy arrays in float64.
        robot: which joint is driven.
        board: a board that scores rows, or its name.
        name: name of the recording in the result.
        plant: the pendulum of the recording: a plant, its name or its file.

    Raises:
        SwingupError: there is no such robot, board or plant, the board scores no recordings, or the trajectory has
            fewer than 3 rows, rows of other shapes, values that are not finite, or times that do not increase or
            start far from 0.
    """
    board, robot, found = get_board(board), get_robot(robot), load_plant(plant)
    if not board.keeps_rows:
        raise SwingupError(f"the board {board.name} is a grid of simulations: it scores no recording")
    time, x, u = checked_rows(trajectory)
    setting = Setting(robot, found)
    run = board.on(setting).score(Case(Scenario(setting.nominal)), Trajectory(time, x, u))
    return Result(
        robot=robot.name,
        controller=name,
        board=board.name,
        # The criteria of one run, also where the board itself shows those of many.
        values=replace(board, domain=None).summarise((run,), ())[0],
        intervals={},
        runs=(run,),
        trajectory=trajectory,
        plant=found,
        rate=float(1 / np.median(np.diff(time))),
        warnings=tuple(f"{each.name}: {each.text}" for each in examine(trajectory, robot, board, found)),
    )
