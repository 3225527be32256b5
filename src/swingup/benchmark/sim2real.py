"""Judging for the real robot: swing-ups on a plant and in a loop like its own, many times with other noise."""

from dataclasses import asdict, dataclass
from statistics import fmean
from typing import Any

import jax
import numpy as np

from ..physics.parameters import Robot, get_robot
from ..tasks.domain import Domain, load_domain
from ..version import __version__
from .criteria import Criteria, judge, tip_is_up
from .interval import Interval, share_interval
from .robustness import check_seeds
from .rollout import Scenario, Trajectory
from .rules import SIM2REAL_RULES, Sim2RealRules
from .runner import prepare, run_many, stack

AT_ONCE = 100
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
    """By the rules of the real robot's board; its own success asks for no limits."""
    fault: str | None = None
    """What was wrong with the controller's answers, if anything."""

    @property
    def score(self) -> float:
        """The RealAI score by the rules of the real robot's board, 0 without success."""
        return self.criteria.score if self.success else 0.0


@dataclass(frozen=True)
class Sim2Real:
    """How a controller does on plants and in loops like the real robot's."""

    robot: str
    controller: str
    domain: Domain
    runs: tuple[Sim2RealRun, ...]
    trajectory: Trajectory
    """Rows of the first seed; NumPy arrays in float64."""
    version: str = __version__

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
            "version": self.version,
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
) -> Sim2Real:
    """Simulate swing-ups from hanging at rest in float64, one a seed, and judge them.

    Args:
        controller: a controller in JAX, an object with ``get_control_output(x, t)`` or a function of (x, t).
        robot: which joint is driven.
        name: what to call the controller in the result.
        domain: what plants and loops are drawn from; in ``identified`` the seeds differ in nothing but their noise.
        seed: the first seed of everything that is drawn.
        seeds: number of seeds in a row.
        rules: what is asked for.

    Raises:
        SwingupError: there is no such robot or domain, a seed is out of range, or the controller is for the other
            robot.
    """
    robot, domain = get_robot(robot), load_domain(domain) if isinstance(domain, str) else domain
    controller = prepare(controller, robot, name)
    check_seeds(seed, seeds)
    every = list(range(seed, seed + seeds))
    runs: list[Sim2RealRun] = []
    first = None
    for start in range(0, seeds, AT_ONCE):
        group = every[start : start + AT_ONCE]
        with jax.enable_x64(True):
            scenarios = [Scenario(*domain.draw(jax.random.key(each), robot)) for each in group]
        batch = run_many(controller, stack(scenarios), rules.dt, rules.steps, domain.depth, keep=True)
        rows: Any = batch.trajectory
        for index, (each, fault) in enumerate(zip(group, batch.faults, strict=True)):
            one = Trajectory(rows.time[index], rows.x[index], rows.u[index])
            first = first or one
            runs.append(_judged(each, one, scenarios[index], rules, fault))
    assert first is not None
    return Sim2Real(robot.name, name, domain, tuple(runs), first)


def _judged(
    seed: int, rows: Trajectory, scenario: Scenario, rules: Sim2RealRules, fault: str | None
) -> Sim2RealRun:
    x, u, time = np.asarray(rows.x), np.asarray(rows.u), np.asarray(rows.time)
    l1, l2 = float(scenario.parameters.l1), float(scenario.parameters.l2)
    speed, angle = float(np.abs(x[:, 2:]).max()), float(np.abs(x[:, :2]).max())
    held = tip_is_up(x[time >= rules.duration - rules.hold], l1, l2, rules.performance.height).all()
    safe = speed <= rules.speed and angle <= rules.angle
    criteria = judge(time, x, u, l1, l2, rules.performance)
    return Sim2RealRun(seed, bool(held and safe and fault is None), speed, angle, criteria, fault)
