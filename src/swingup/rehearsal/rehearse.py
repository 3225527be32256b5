"""A rehearsal: an exported folder drives the simulated robot, from a process of its own, perhaps in real time."""

import dataclasses
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ..benchmark.boards import HARDWARE, ROBOT_LIMITS
from ..benchmark.criteria import compute_criteria, follow_tip
from ..benchmark.rollout import Scenario
from ..benchmark.runner import run_one
from ..benchmark.swing_up_board import SwingUpBoard
from ..common.checks import positive_number, whole_number
from ..common.errors import SwingupError
from ..controllers.interface.python_controller import PythonController
from ..loop.domain import Domain
from ..loop.draw import draw
from ..loop.on_plant import loop_around
from ..plant.plant import PlantLike
from ..plant.robots import Robot, get_robot
from ..policy.plant_facts import plant_difference
from ..policy.shipped import load_policy
from .folder import Folder, find_folder
from .loop import FolderController, PacedController
from .process import CALLING, FolderProcess
from .result import Rehearsal

RECORDED = "recorded"
"""The domain of a rehearsal that names none: design C.1 in its loop, as recordings show them."""
LONGEST_REHEARSAL = 600.0
"""Longest rehearsal (s)."""


def rehearse(
    folder: str | Path,
    plant: PlantLike | None = None,
    domain: Domain | str | None = RECORDED,
    robot: Robot | str | None = None,
    board: SwingUpBoard = HARDWARE,
    duration: float | None = None,
    seed: int = 0,
    real_time: bool = False,
    calling: float = CALLING,
) -> Rehearsal:
    """Run an exported folder in a process of its own against the simulated robot, from hanging at rest.

    Args:
        folder: a folder of ``swingup export --to realaigym`` or ``--to cloudpendulum``, or its Python file.
        plant: the plant, with the loop that its file has; None for the domain's.
        domain: the loop that the plant's file lacks, and the plant if none is given; None for a perfect loop.
        robot: which joint is driven; None where the folder says it.
        board: how the run is scored.
        duration: length of the run (s); None for that of the board.
        seed: seed of everything that is drawn.
        real_time: one step a period, with the periods measured.
        calling: longest time of a call (s).

    Raises:
        SwingupError: there is no such folder, plant, domain or robot; or the folder cannot be imported, or a call
            fails, hangs, prints, or gives no two finite torques.
    """
    if duration is not None:
        board = dataclasses.replace(board, duration=positive_number("duration", duration, LONGEST_REHEARSAL, "s"))
    seed, found = whole_number("seed", seed, 0, 2**32 - 1), find_folder(folder)
    with FolderProcess(found, simulated_clock=not real_time, calling=calling) as process:
        driven = _robot(robot, process.facts["robot"], found)
        around = loop_around(plant, domain)
        with jax.enable_x64(True):
            scenario = Scenario(*draw(around, jax.random.key(seed), driven), substeps=around.substeps)
        controller = FolderController(process)
        paced = PacedController(controller, process, board.dt) if real_time else controller
        if real_time:
            # Compiled before the clock runs.
            run_one(PythonController(_no_torque), scenario, board.dt, 2, around.depth)
        rows = run_one(PythonController(paced), scenario, board.dt, board.steps, around.depth)
        facts = process.facts | process.guard_report()
    time, x, u = (np.asarray(values) for values in (rows.time, rows.x, rows.u))
    lengths = float(scenario.parameters.l1), float(scenario.parameters.l2)
    return Rehearsal(
        folder=found,
        robot=driven.name,
        domain=around,
        seed=seed,
        real_time=real_time,
        criteria=compute_criteria(time, x, u, *lengths, board),
        tip=follow_tip(time, x, *lengths, board),
        difference=_difference(found, around, driven),
        limits=_limits(facts),
        timing=controller.timing,
        facts=facts,
        trajectory=rows,
    )


def _robot(given: Robot | str | None, said: Any, folder: Folder) -> Robot:
    if given is None and not isinstance(said, str):
        raise SwingupError(f"{folder.entry.name} does not say its robot: name acrobot or pendubot")
    robot = get_robot(said if given is None else given)
    if isinstance(said, str) and said != robot.name:
        raise SwingupError(f"{folder.entry.name} is for the {said}, not the {robot.name}: export one for it")
    return robot


def _difference(folder: Folder, domain: Domain, robot: Robot) -> str | None:
    """How the middle of the domain's plants differs from the policy's plant."""
    if folder.policy is None:
        return None
    policy = load_policy(folder.policy)
    seen = None if policy.identifier is None else policy.network.plant_stage
    return plant_difference(policy.plant, domain.nominal_plant, robot, seen)


def _limits(facts: dict[str, Any]) -> tuple[float, float]:
    """Largest angle (rad) and speed (rad/s): of the folder's guard, or where the loop on the robot stops."""
    given = facts["limits"]
    return (
        (float(ROBOT_LIMITS.angle), float(ROBOT_LIMITS.speed))
        if given is None
        else (given["angle"], given["speed"])
    )


def _no_torque(x: np.ndarray, t: float) -> np.ndarray:
    return np.zeros(2)
