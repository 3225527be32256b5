"""A rehearsal: an exported folder drives the simulated robot, from a process of its own, perhaps in real time."""

import dataclasses
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ..benchmark.criteria import Criteria, TipHistory, follow_tip, judge
from ..benchmark.rollout import Scenario, Trajectory
from ..benchmark.rules import PERFORMANCE_RULES, SIM2REAL_RULES, PerformanceRules
from ..benchmark.runner import run_one
from ..checks import positive_number, whole_number
from ..control.python_controller import PythonController
from ..errors import SwingupError
from ..physics.parameters import Robot, get_robot
from ..plants.domain import Domain
from ..plants.plant import PlantLike
from ..tasks.draw import draw
from .folder import Folder, find_folder
from .loop import FolderController, PacedController, Timing
from .process import CALLING, FolderProcess
from .simulated import RECORDED, simulated_robot

LONGEST = 600.0
"""Longest rehearsal (s)."""


@dataclass(frozen=True)
class Rehearsal:
    """What one rehearsal showed."""

    folder: Folder
    robot: str
    domain: Domain
    """What plant and loop were drawn from."""
    seed: int
    real_time: bool
    criteria: Criteria
    tip: TipHistory
    limits: tuple[float, float]
    """Largest angle (rad) and speed (rad/s) of a joint; the robot stops beyond them."""
    timing: Timing
    facts: dict[str, Any]
    """What the folder says of itself: its packages, and when and why its guard stopped it."""
    trajectory: Trajectory

    @property
    def angle(self) -> float:
        """Largest angle of a joint (rad)."""
        return float(np.abs(self.trajectory.x[:, :2]).max())

    @property
    def speed(self) -> float:
        """Largest speed of a joint (rad/s)."""
        return float(np.abs(self.trajectory.x[:, 2:]).max())

    @property
    def violation(self) -> float | None:
        """When a joint first passed a limit (s); None for never."""
        most = np.repeat(self.limits, 2)
        beyond = (np.abs(self.trajectory.x) > most).any(axis=1)
        return float(self.trajectory.time[beyond.argmax()]) if beyond.any() else None

    @property
    def success(self) -> bool:
        """It swung up and stayed there, within the robot's limits."""
        return self.criteria.success and self.violation is None

    @property
    def score(self) -> float:
        """The RealAI score, 0 without success."""
        return self.criteria.score if self.success else 0.0

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON; times in s."""
        return {
            "folder": str(self.folder.entry.parent),
            "form": self.folder.form,
            "robot": self.robot,
            "domain": {"name": self.domain.name} | self.domain.as_dict(),
            "seed": self.seed,
            "success": self.success,
            **{name: value for name, value in asdict(self.criteria).items() if name not in ("success", "score")},
            "score": self.score,
            **self.tip.as_dict(),
            "speed": self.speed,
            "angle": self.angle,
            "violation": self.violation,
            "limits": {"angle": self.limits[0], "speed": self.limits[1]},
            "guard": self.facts["guard"],
            "stopped": self.facts["stopped"],
            "packages": self.facts["packages"],
            "calls": spread(self.timing.calls),
            "real_time": self.real_time,
            "periods": spread(self.timing.periods) if self.real_time else None,
            "missed": self.timing.missed if self.real_time else None,
            "late": self.timing.late if self.real_time else None,
        }


def spread(seconds: Sequence[float]) -> dict[str, float]:
    """Median, 99th percentile and longest of measured times (s)."""
    if not seconds:
        return {}
    middle, most = np.percentile(seconds, [50, 99]).tolist()
    return {"p50": middle, "p99": most, "longest": max(seconds)}


def rehearse(
    folder: str | Path,
    plant: PlantLike | None = None,
    domain: Domain | str | None = RECORDED,
    robot: Robot | str | None = None,
    rules: PerformanceRules = PERFORMANCE_RULES["hardware"],
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
        rules: how the run is scored.
        duration: length of the run (s); None for that of the rules.
        seed: seed of everything that is drawn.
        real_time: one step a period, with the periods measured.
        calling: longest time of a call (s).

    Raises:
        SwingupError: there is no such folder, plant, domain or robot; or the folder cannot be imported, or a call
            fails, hangs, prints, or gives no two finite torques.
    """
    if duration is not None:
        rules = dataclasses.replace(rules, duration=positive_number("duration", duration, LONGEST, "s"))
    seed, found = whole_number("seed", seed, 0, 2**32 - 1), find_folder(folder)
    with FolderProcess(found, simulated_clock=not real_time, calling=calling) as process:
        driven = _robot(robot, process.facts["robot"], found)
        around = simulated_robot(plant, domain, driven)
        with jax.enable_x64(True):
            scenario = Scenario(*draw(around, jax.random.key(seed), driven), substeps=around.substeps)
        controller = FolderController(process)
        paced = PacedController(controller, process, rules.dt) if real_time else controller
        if real_time:
            # Compiled before the clock runs.
            run_one(PythonController(_no_torque), scenario, rules.dt, 2, around.depth)
        rows = run_one(PythonController(paced), scenario, rules.dt, rules.steps, around.depth)
        facts = process.facts | process.guard_report()
    time, x, u = (np.asarray(values) for values in (rows.time, rows.x, rows.u))
    lengths = float(scenario.parameters.l1), float(scenario.parameters.l2)
    return Rehearsal(
        folder=found,
        robot=driven.name,
        domain=around,
        seed=seed,
        real_time=real_time,
        criteria=judge(time, x, u, *lengths, rules),
        tip=follow_tip(time, x, *lengths, rules),
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


def _limits(facts: dict[str, Any]) -> tuple[float, float]:
    """Largest angle (rad) and speed (rad/s): of the folder's guard, or where the loop on the robot stops."""
    given = facts["limits"]
    return (SIM2REAL_RULES.angle, SIM2REAL_RULES.speed) if given is None else (given["angle"], given["speed"])


def _no_torque(x: np.ndarray, t: float) -> np.ndarray:
    return np.zeros(2)
