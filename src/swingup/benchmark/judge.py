"""The judge: simulate a controller's runs on a board, or take a recording; score each, and sum the scores up."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ..common import cores
from ..common.checks import check_seeds
from ..common.errors import SwingupError, naming, quoted
from ..controllers.check import announce, call_time, slow_call
from ..controllers.interface import AbstractController
from ..controllers.registry import has_estimator
from ..loop.domain import Domain
from ..loop.resolve import resolve
from ..plant.plant import LEADERBOARD, PlantLike, Robot, get_robot
from ..plant.units import TORQUE, scales_of
from .board import AbstractBoard, Case, Result, Run, Setting
from .boards import BOARDS, get_board
from .disturbances import DisturbanceSettings
from .plausibility import MAX_COMPENSATION, TORQUE_ERROR, examine, possible_runs
from .recording import load_trajectory, recorded, scorable_rows, stopped
from .rollout import Scenario, SimulatedBatch, Trajectory
from .runner import Progress, prepare, run_many, stack
from .swing_up_board import SwingUpBoard
from .uptime_board import UptimeBoard

PASSIVE_TORQUE = "passive_torque"  # Name of the warning of a controller that drives the passive joint


def judge(
    controller: Any,
    robot: Robot | str,
    board: AbstractBoard | str = "performance",
    seeds: int | None = None,
    *,
    seed: int = 0,
    name: str = "controller",
    plant: PlantLike | Domain | None = None,
    domain: Domain | str | None = None,
    disturbance: DisturbanceSettings | None = None,
    progress: Progress | None = None,
) -> Result:
    """Simulate a controller's runs in float64, and score them by the rules of a board.

    Args:
        controller: a controller in JAX (simulations run side by side), an object with
            ``get_control_output(x, t)`` or a function of (x, t); called at every step, whatever rate it was
            trained at.
        robot: which joint is driven.
        board: a board or its name, as ``performance``, ``robustness``, ``uptime``, ``sim2real`` or ``iros-real``.
        seeds: number of seeds in a row; None for as many as the board has runs.
        seed: the first seed of all that is drawn: noise, pushes, throws, plants and loops.
        name: name of the controller in the result.
        plant: what is simulated, with the board's disturbances in that pendulum's own units: a plant, its name or
            its file, or a domain; None for the leaderboards' plant, or for the domain's.
        domain: ranges of plants and loops, for boards that draw them; None for the board's. What the plant's file
            says of its loop has the last word (:func:`~swingup.loop.resolve.resolve`).
        disturbance: noise, delay, motor response and pushes, for boards in a perfect loop.
        progress: called with the number of finished simulations, and of all.

    Raises:
        SwingupError: there is no such robot, board, plant or domain, a value is out of range or does not go with
            the board, the controller is for the other robot, or it failed in every run: it raised an error, or its
            torque is not two finite numbers. A controller that fails in some runs loses those only.
    """
    board = get_board(board)
    setting = make_setting(robot, board, plant, domain, disturbance)
    every = check_seeds(seed, board.runs if seeds is None else seeds)
    every = every if board.is_random(setting) else every[:1]
    board = board.on(setting)
    estimator, controller = has_estimator(controller), prepare(controller, setting.robot, name, setting.nominal)
    with naming(f"controller {name!r}"):
        took = call_time(controller, board.dt) if isinstance(controller, AbstractController) else None
    steps, runs, passive = steps_of(board, setting), list[Run](), 0.0
    first = None
    for start in range(0, len(every), board.side_by_side):
        group = every[start : start + board.side_by_side]
        with jax.enable_x64(True):
            cases = board.cases(setting, group)
        before, total = len(runs), max(len(every), len(cases))
        if took is not None and not runs:
            seconds = took.median * steps * total / cores()
            announce(seconds, took.median, total, bound="up to ")

        def report_progress(done: int, _: int, before: int = before, total: int = total) -> None:
            if progress is not None:
                progress(before + done, total)

        with naming(f"controller {name!r}"):
            scenarios, depth = stack([case.scenario for case in cases]), _depth(setting, cases)
            batch = run_many(
                controller, scenarios, board.dt, steps, depth, board.keeps_rows, report_progress, board.duration
            )
        took, passive = took or batch.call_time, max(passive, _passive_torque(batch, setting.robot, board))
        for index, (case, fault) in enumerate(zip(cases, batch.faults, strict=True)):
            rows, stop = _counted(batch, index, board)
            runs.append(board.score(case, rows, fault, stop))
            first = first or (rows if board.keeps_rows else None)
    if all(run.fault is not None for run in runs):
        raise SwingupError(f"controller {name!r}: {runs[0].fault}")
    slow = slow_call(took, board.dt)
    warnings: tuple[str, ...] = () if slow is None else (slow,)
    if passive and passive > (allowed := scales_of(setting.nominal).scaled(MAX_COMPENSATION, TORQUE)) * (1 + 1e-9):
        warnings += (
            f"{PASSIVE_TORQUE}: it gives the passive joint {2 - setting.robot.joint} up to {passive:.3g} N m, "
            f"above the {allowed:.3g} N m of the rules' friction compensation: this is no entry",
        )
    result = summed_up(name, board, setting, runs, every)
    return replace(result, trajectory=first, estimator=estimator, call_time=took, warnings=warnings)


def score(
    trajectory: Trajectory | str | Path,
    robot: Robot | str,
    board: AbstractBoard | str = "performance",
    *,
    name: str = "recording",
    plant: PlantLike | Domain | None = None,
    force: bool = False,
) -> Result:
    """Score a recording from any source by the rules of a board, whoever pushed or threw the pendulum and when.

    Times count from 0, or from the first row where that is earlier. A span below 99 % of the duration is no
    success; in an uptime the missing time counts as down. Where the robot stops beyond limits, so does the scoring.
    What cannot be the physics of the plant gets no score.

    Args:
        trajectory: NumPy arrays in float64, or a recording's file, whose angles are those of the plant's encoders.
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
    if plant is None and board.domain is not None:
        found = resolve(domain=board.domain).design
    else:
        found = resolve(LEADERBOARD if plant is None else plant).facts
    if isinstance(trajectory, str | Path):
        trajectory = load_trajectory(trajectory, zeros=found.zeros)
    rows, setting = scorable_rows(trajectory), Setting(robot, found)
    case, judge_of = Case(Scenario(setting.nominal)), board.on(setting)
    # The criteria of one run, also where the board itself shows those of many.
    alone = replace(board, domain=None, note=None)
    limits = judge_of.stop_limits()

    def scored(each: Trajectory) -> Result:
        counted, stop = (each, None) if limits is None else stopped(each, limits, board.duration)
        return summed_up(name, alone, setting, (judge_of.score(case, counted, stop=stop),), ())

    result, *possible = map(scored, (rows, *possible_runs(rows, found)))
    findings = examine(trajectory, robot, board, found)
    # Nobody invents a score of 0.
    refusals = [each for each in findings if each.refuses and result.values["score"]]
    if refusals and not force:
        raise SwingupError(f"{name}: {refusals[0].text}; --force scores it all the same")
    warnings = [f"{each.name}: {each.text}" for each in findings]
    if band := [value for each in possible if (value := each.values["score"]) is not None]:
        cause = f"torques that are off by {TORQUE_ERROR:.0%}, and noise of the velocities"
        warnings.append(f"band: {min(band):.3f} to {max(band):.3f} is the score of its rows for {cause}")
    return replace(
        result, trajectory=trajectory, rate=float(1 / np.median(np.diff(rows.time))), warnings=tuple(warnings)
    )


def summed_up(
    name: str, board: AbstractBoard, setting: Setting, runs: Sequence[Run], seeds: Sequence[int]
) -> Result:
    """The result of runs on a board that is in the pendulum's units."""
    values, intervals = board.summarise(runs, seeds)
    return Result(
        robot=setting.robot.name,
        controller=name,
        board=board.name,
        values=values,
        intervals=intervals,
        runs=tuple(runs),
        trajectory=None,
        plant=setting.plant,
        seeds=tuple(seeds) if board.is_random(setting) else (),
        domain=setting.domain,
        note=board.note,
    )


def make_setting(
    robot: Robot | str,
    board: AbstractBoard,
    plant: PlantLike | Domain | None = None,
    domain: Domain | str | None = None,
    disturbance: DisturbanceSettings | None = None,
) -> Setting:
    """What a controller is judged on; arguments as of :func:`judge`."""
    robot = get_robot(robot)
    if disturbance is not None and (board.domain is not None or not isinstance(board, SwingUpBoard)):
        raise SwingupError(f"the board {board.name} has disturbances of its own: leave yours out")
    if board.domain is None:
        if domain is not None:
            given = domain.name if isinstance(domain, Domain) else domain
            raise SwingupError(f"the board {board.name} draws no plants: leave the domain {quoted(given)} out")
        facts = resolve(LEADERBOARD if plant is None else plant).facts
        facts.needs_motor(robot)
        return Setting(robot, facts, None, disturbance)
    if isinstance(board, UptimeBoard) and plant is not None:
        raise SwingupError(f"the board {board.name} draws plants from a domain: give the plant as the domain")
    ranges = resolve(plant, board.domain if domain is None else domain)
    ranges.high.plant.needs_motor(robot)
    return Setting(robot, ranges.design, ranges)


def steps_of(board: AbstractBoard, setting: Setting) -> int:
    """Steps of a run in the setting's loop: as many as the board has, or more where the loop may be faster."""
    if setting.domain is None:
        return board.steps
    return math.ceil(board.duration / min(board.dt, setting.domain.low.value("period")) * (1 - 1e-9))


def _passive_torque(batch: SimulatedBatch, robot: Robot, board: AbstractBoard) -> float:
    """The largest torque that a controller asks of the passive joint where a supervisor watches (N m)."""
    if (rows := batch.trajectory) is None or rows.record is None:
        return 0.0
    own = (rows.time < board.duration) & rows.record.alone & ~rows.record.over
    return float(np.nanmax(np.abs(rows.record.u[own, 1 - robot.joint]), initial=0.0))


def _depth(setting: Setting, cases: Sequence[Case]) -> int:
    """States that the loop remembers: one more than the largest delay, the present one."""
    if setting.domain is not None:
        return setting.domain.depth
    disturbances = [case.scenario.disturbance for case in cases]
    return 1 + max(0 if each is None else int(each.delay_steps) for each in disturbances)


def _counted(batch: SimulatedBatch, index: int, board: AbstractBoard) -> tuple[Trajectory, float | None]:
    """What a board scores of one simulation, and when the robot stopped it (s), if it did."""
    if batch.trajectory is None:
        return Trajectory(np.array([board.duration]), batch.final[index][None], np.zeros((1, 2))), None
    rows = jax.tree.map(lambda each: np.asarray(each)[index], batch.trajectory)
    return recorded(rows, board.duration)
