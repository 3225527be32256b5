"""Judging on the simulated robot: swing-ups on a plant and in a loop like the real one's, each with other noise."""

from dataclasses import asdict, dataclass
from statistics import fmean
from typing import Any

import jax
import numpy as np

from ..common.version import __version__
from ..controllers.registry import has_estimator
from ..loop.domain import Domain
from ..loop.draw import draw
from ..loop.on_plant import loop_around
from ..plant.plant import PlantLike
from ..plant.robots import Robot, get_robot
from ..plant.units import scaled, scales_of
from .criteria import Criteria, judge, tip_is_up
from .interval import Interval, share_interval
from .robot_rules import SIM2REAL_RULES, Sim2RealRules
from .rollout import Scenario, Trajectory
from .runner import Progress, prepare, run_many, stack
from .seeds import check_seeds, in_groups

SWINGUPS_AT_ONCE = 100
"""Seeds that are simulated side by side."""


@dataclass(frozen=True)
class Sim2RealRun:
    """One swing-up."""

    seed: int
    success: bool
    """It was up at the end, and never too fast or turned too far."""
    speed: float
    """Largest speed of a joint (rad/s)."""
    angle: float
    """Largest angle of a joint (rad)."""
    criteria: Criteria
    """By the rules of the real robot's board; its own success has no limits of speed and angle."""
    fault: str | None = None
    """What was wrong with the controller's answers, if anything."""

    @property
    def score(self) -> float:
        """The RealAI score by the rules of the real robot's board, 0 without success."""
        return self.criteria.score if self.success else 0.0


@dataclass(frozen=True)
class Sim2Real:
    """A controller's swing-ups on plants and in loops like the real robot's."""

    robot: str
    controller: str
    domain: Domain
    runs: tuple[Sim2RealRun, ...]
    trajectory: Trajectory
    """Rows of the first seed; NumPy arrays in float64."""
    version: str = __version__
    estimator: bool = False
    """Whether a state estimator stood before the controller."""

    @property
    def successes(self) -> int:
        """Runs with success."""
        return sum(run.success for run in self.runs)

    @property
    def score(self) -> float:
        """Mean score."""
        return fmean(run.score for run in self.runs)

    @property
    def interval(self) -> Interval:
        """95 % interval of the share of successes."""
        return share_interval(self.successes, len(self.runs))

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "robot": self.robot,
            "controller": self.controller,
            "estimator": self.estimator,
            "version": self.version,
            **({} if self.domain.plant is None else self.domain.plant.summary(self.robot)),
            "domain": self.domain.as_dict(),
            "successes": self.successes,
            "interval": self.interval,
            "score": self.score,
            "seed": self.runs[0].seed,
            "details": [asdict(run) | {"score": run.score} for run in self.runs],
        }


def sim2real(
    controller: Any,
    robot: Robot | str,
    name: str = "controller",
    domain: Domain | str = "identified",
    seed: int = 0,
    seeds: int = 1,
    rules: Sim2RealRules = SIM2REAL_RULES,
    progress: Progress | None = None,
    plant: PlantLike | None = None,
) -> Sim2Real:
    """Simulate swing-ups from hanging at rest in float64, one a seed, and judge them.

    Args:
        controller: a controller in JAX, an object with ``get_control_output(x, t)`` or a function of (x, t).
        robot: which joint is driven.
        name: name of the controller in the result.
        domain: ranges of plants and loops; in ``identified`` seeds differ only in their noise.
        seed: the first seed of everything that is drawn.
        seeds: number of seeds in a row.
        rules: what counts as success.
        progress: called with the number of finished simulations and of all.
        plant: a plant, its name or its file, around which the domain's loop is put, in that
            pendulum's own units; None for the domain's.

    Raises:
        SwingupError: there is no such robot, domain or plant, a seed is out of range, or the controller is for the
            other robot.
    """
    robot, domain = get_robot(robot), loop_around(plant, domain)
    every, known = check_seeds(seed, seeds), domain.known_plant(robot)
    if known is not None:
        rules = scaled(rules, scales_of(known))
    estimator, controller = has_estimator(controller), prepare(controller, robot, name, known)
    runs: list[Sim2RealRun] = []
    first = None
    for group in in_groups(every, SWINGUPS_AT_ONCE):
        with jax.enable_x64(True):
            # A key for each seed: its plant is the same however many seeds are judged.
            scenarios = [
                Scenario(*draw(domain, jax.random.key(each), robot), substeps=domain.substeps) for each in group
            ]
        batch = run_many(controller, stack(scenarios), rules.dt, rules.steps, domain.depth, keep=True)
        rows: Any = batch.trajectory
        for index, (each, fault) in enumerate(zip(group, batch.faults, strict=True)):
            one = Trajectory(rows.time[index], rows.x[index], rows.u[index])
            first = first or one
            runs.append(_judged(each, one, scenarios[index], rules, fault))
        if progress is not None:
            progress(len(runs), len(every))
    assert first is not None
    return Sim2Real(robot.name, name, domain, tuple(runs), first, estimator=estimator)


def _judged(
    seed: int, rows: Trajectory, scenario: Scenario, rules: Sim2RealRules, fault: str | None
) -> Sim2RealRun:
    # Late periods take a run beyond its duration: those rows do not count.
    counted = np.asarray(rows.time) < rules.duration
    x, u, time = (np.asarray(each)[counted] for each in (rows.x, rows.u, rows.time))
    l1, l2 = float(scenario.parameters.l1), float(scenario.parameters.l2)
    speed, angle = float(np.abs(x[:, 2:]).max()), float(np.abs(x[:, :2]).max())
    held = tip_is_up(x[time >= rules.duration - rules.hold], l1, l2, rules.performance.height).all()
    safe = speed <= rules.speed and angle <= rules.angle
    criteria = judge(time, x, u, l1, l2, rules.performance)
    return Sim2RealRun(seed, bool(held and safe and fault is None), speed, angle, criteria, fault)
