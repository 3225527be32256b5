"""A rehearsal: an exported folder drives the simulated robot, from a process of its own, perhaps in real time."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax

from ..benchmark.board import Case, Result, Run, Setting
from ..benchmark.boards import SIM2REAL
from ..benchmark.judge import make_setting, steps_of, summed_up
from ..benchmark.recording import recorded
from ..benchmark.rollout import Trajectory
from ..benchmark.runner import Progress, run_one
from ..benchmark.swing_up_board import SwingUpBoard
from ..common.checks import check_seeds, finite_number, positive_number
from ..common.errors import SwingupError
from ..controllers.check import spread
from ..controllers.interface import PythonController
from ..loop.domain import Domain
from ..loop.loop import LOOP_DT
from ..loop.resolve import NO_LOOP
from ..loop.supervisors import Limits
from ..plant.plant import PlantLike, Robot, get_robot
from ..policy.feedback import load_robot_policy
from ..policy.pendulum import PendulumPolicy, plant_difference
from .process import CALLING_TIME, Folder, FolderController, FolderProcess, Timing, find_folder


@dataclass(frozen=True)
class Rehearsal:
    """What the runs of one folder showed."""

    folder: Folder
    result: Result
    """The judge's result."""
    stops: tuple[dict[str, Any] | None, ...]
    """When (s) and why the folder's guard stopped each run."""
    difference: str | None
    """How the plant differs from the one that the policy was made for; None if it differs little."""
    limits: tuple[float, float] | None
    """Largest angle (rad) and speed (rad/s) of a joint; None where neither guard nor board has limits."""
    real_time: bool
    timing: Timing
    """What was measured of all runs."""
    facts: dict[str, Any]
    """What the folder says of itself."""

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON: the judge's result, and what a folder adds; times in s."""
        return self.result.as_dict() | {
            "folder": str(self.folder.entry.parent),
            "form": self.folder.form,
            "difference": self.difference,
            "limits": self.limits and dict(zip(("angle", "speed"), self.limits, strict=True)),
            "guard": self.facts["guard"],
            "stops": list(self.stops),
            "packages": self.facts["packages"],
            "calls": _summary(self.timing.calls),
            "real_time": self.real_time,
            "periods": _summary(self.timing.periods) if self.real_time else None,
            "missed_deadlines": self.timing.missed_deadlines if self.real_time else None,
            "late_periods": self.timing.late_periods if self.real_time else None,
        }


def _summary(seconds: Sequence[float]) -> dict[str, float]:
    """Median, 99th percentile and maximum of measured times (s)."""
    return dict(zip(("p50", "p99", "maximum"), spread(seconds), strict=True)) if seconds else {}


SEEDS = 10  # Runs of a rehearsal; in real time and in a perfect loop it is one
MAX_DURATION = 600.0  # Maximum duration of a run (s)


def rehearse(
    folder: str | Path,
    plant: PlantLike | None = None,
    domain: Domain | str | None = None,
    robot: Robot | str | None = None,
    board: SwingUpBoard = SIM2REAL,
    duration: float | None = None,
    seeds: int | None = None,
    seed: int = 0,
    real_time: bool = False,
    calling: float = CALLING_TIME,
    progress: Progress | None = None,
) -> Rehearsal:
    """Run an exported folder in processes of its own against simulated robots, from hanging at rest.

    Args:
        folder: a folder of ``swingup export --to realaigym`` or ``--to cloudpendulum``, or its Python file.
        plant: the plant, with the loop that its file has; None for the domain's.
        domain: the loop that the plant's file lacks, and the plant where none is given: a domain, its name or file,
            or "none" for a perfect loop; None for that of the board ``sim2real``.
        robot: which joint is driven; None where the folder says it.
        board: how the runs are scored. Limits of the folder's guard replace the board's.
        duration: length of a run (s); None for that of the board.
        seeds: number of seeds in a row, with a process each; None for 10, or for 1 in real time or a perfect loop.
        seed: first seed of plants, loops and noise; the judge draws the same from it.
        real_time: one step a period, with the periods measured.
        calling: maximum time of a call (s).
        progress: called with the number of finished runs, and of all.

    Raises:
        SwingupError: there is no such folder, plant, domain or robot; or the folder cannot be imported, or a call
            fails, hangs, prints, or gives no two finite torques.
    """
    if duration is not None:
        board = dataclasses.replace(board, duration=finite_number("duration", duration, 0.1, MAX_DURATION, "s"))
    calling = positive_number("calling", calling, MAX_DURATION, "s")
    single = real_time or domain == NO_LOOP
    every = check_seeds(seed, (1 if single else SEEDS) if seeds is None else seeds)
    found = find_folder(folder)
    with FolderProcess(found, simulated_clock=not real_time, calling=calling) as process:
        # What the folder says decides the setting, and a fault in it shows before anything is compiled.
        facts = process.facts
    board = dataclasses.replace(board, domain=board.domain or SIM2REAL.domain)
    setting = make_setting(_robot(robot, facts["robot"], found), board, plant, domain)
    board = board.on(setting)
    if facts["limits"] is not None:
        limits = Limits(facts["limits"]["angle"], facts["limits"]["speed"])
        board = dataclasses.replace(board, limits=limits)
    # As the judge draws them.
    with jax.enable_x64(True):
        cases = board.cases(setting, every)
    runs, timing, stops, first = list[Run](), Timing(), list[dict[str, Any] | None](), None
    for case in cases:
        with FolderProcess(found, simulated_clock=not real_time, calling=calling) as process:
            # The loop's own nominal period, as it was drawn: every rehearsal draws a loop.
            assert case.scenario.disturbance is not None
            period = board.dt * float(case.scenario.disturbance.loop.period) / LOOP_DT
            folder_controller = FolderController(process, period if real_time else None, timing)
            rows = _rows(folder_controller, board, setting, case)
            stop = process.stop()
        counted, end = recorded(rows, board.duration)
        run = board.score(case, counted, None, end)
        # The board has the guard's limits: it found a motion beyond one by itself.
        if stop is not None and run.tip is not None and run.tip.cause != "beyond a limit":
            tip = dataclasses.replace(run.tip, failure=stop["why"], cause="stopped")
            lost = run.criteria and dataclasses.replace(run.criteria, success=False, swingup_time=None, score=0.0)
            run = dataclasses.replace(run, success=False, score=0.0, criteria=lost, tip=tip)
        runs.append(run)
        stops.append(stop)
        first = first or counted
        if progress is not None:
            progress(len(runs), len(cases))
    result = summed_up(found.entry.name, board, setting, runs, every)
    return Rehearsal(
        folder=found,
        result=dataclasses.replace(result, trajectory=first),
        stops=tuple(stops),
        difference=_difference(found, setting),
        limits=None if board.limits is None else (float(board.limits.angle), float(board.limits.speed)),
        real_time=real_time,
        timing=timing,
        facts=facts,
    )


def _rows(controller: FolderController, board: SwingUpBoard, setting: Setting, case: Case) -> Trajectory:
    assert setting.domain is not None  # every rehearsal draws from one
    loop = case.scenario, board.dt
    # Two steps first, in which the simulation is compiled: the controller's clock does not run yet.
    run_one(PythonController(lambda x, t: (0.0, 0.0)), *loop, 2, setting.domain.depth)
    steps, depth = steps_of(board, setting), setting.domain.depth
    rows = run_one(PythonController(controller), *loop, steps, depth, board.duration)
    if controller.fault is not None:  # on a sample of NaN, after which the simulation went on
        raise controller.fault
    return rows


def _robot(given: Robot | str | None, said: Any, folder: Folder) -> Robot:
    if given is None and not isinstance(said, str):
        raise SwingupError(f"{folder.entry.name} does not say its robot: name acrobot or pendubot")
    robot = get_robot(said if given is None else given)
    if isinstance(said, str) and said != robot.name:
        raise SwingupError(f"{folder.entry.name} is for the {said}, not the {robot.name}: export one for it")
    return robot


def _difference(folder: Folder, setting: Setting) -> str | None:
    """How the middle of the domain's plants differs from the policy's plant."""
    if setting.domain is None or folder.policy is None:
        return None
    policy = load_robot_policy(folder.policy)
    seen = policy.network.plant_stage if isinstance(policy, PendulumPolicy) and policy.identifier else None
    return plant_difference(policy.plant, setting.domain.nominal_plant, setting.robot, seen)
