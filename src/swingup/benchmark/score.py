"""The score of a recording by the rules of a board."""

from dataclasses import replace

import numpy as np

from ..common.errors import SwingupError
from ..loop.domain import load_domain
from ..plant.plant import LEADERBOARD, PlantLike, load_plant
from ..plant.robots import Robot, get_robot
from .board import AbstractBoard, Case, Setting
from .boards import BOARDS, get_board
from .judge import summed_up
from .plausibility import examine
from .recording import scorable_rows
from .result import Result
from .rollout import Scenario, Trajectory


def score(
    trajectory: Trajectory,
    robot: Robot | str,
    board: AbstractBoard | str = "performance",
    *,
    name: str = "recording",
    plant: PlantLike | None = None,
    force: bool = False,
) -> Result:
    """Score a recording from any source by the rules of a board, whoever pushed or threw the pendulum and when.

    Times count from 0, or from the first row where that is earlier. A span below 99 % of the duration is no
    success; in an uptime the missing time counts as down. What cannot be the physics of the plant gets no score.

    Args:
        trajectory: NumPy arrays in float64.
        robot: which joint is driven.
        board: a board that scores rows, or its name.
        name: name of the recording in the result.
        plant: the pendulum of the recording: a plant, its name or its file; None for that of the board's domain.
        force: score what cannot be the plant's physics as well, with a warning.

    Raises:
        SwingupError: there is no such robot, board or plant, the board scores no recordings, or the trajectory has
            fewer than 3 rows, rows of other shapes, values that are not finite, or times that do not increase or
            start far from 0; or a score above 0 is not that of the plant's physics on the board.
    """
    board, robot = get_board(board), get_robot(robot)
    if not board.keeps_rows:
        others = ", ".join(each.name for each in BOARDS.values() if each.keeps_rows)
        raise SwingupError(f"the board {board.name} is a grid of simulations: it scores no recording; use {others}")
    if plant is None:
        found = LEADERBOARD if board.domain is None else load_domain(board.domain).design
    else:
        found = load_plant(plant)
    rows, setting = scorable_rows(trajectory), Setting(robot, found)
    run = board.on(setting).score(Case(Scenario(setting.nominal)), rows)
    # The criteria of one run, also where the board itself shows those of many.
    result = summed_up(name, replace(board, domain=None, note=None), setting, (run,), ())
    findings = examine(trajectory, robot, board, found)
    # Nobody invents a score of 0.
    refusals = [each for each in findings if each.refuses and result.values["score"]]
    if refusals and not force:
        raise SwingupError(f"{name}: {refusals[0].text}; --force scores it all the same")
    warnings = tuple(f"{each.name}: {each.text}" for each in findings)
    return replace(result, trajectory=trajectory, rate=float(1 / np.median(np.diff(rows.time))), warnings=warnings)
