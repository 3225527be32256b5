"""Trials on the simulated robot by the rules of a real one's board: swing-ups whose records are scored."""

import dataclasses
from dataclasses import asdict, dataclass
from statistics import fmean
from typing import Any

import jax
import numpy as np

from ..common.version import __version__
from ..controllers.registry import has_estimator
from ..loop.disturbance import Pushes
from ..loop.domain import Domain, load_domain
from ..loop.draw import draw
from ..loop.supervisors.limits import Stop
from ..plant.plant import Plant
from ..plant.robots import Robot, get_robot
from .criteria import Criteria, failed, judge
from .grid import draw_pushes
from .interval import Interval, mean_interval, share_interval
from .recording import recorded, stopped_at
from .robot_rules import DEFAULT_TRIAL_RULES, TrialRules, get_trial_rules
from .rollout import Scenario, Trajectory
from .runner import Progress, prepare, run_many, stack
from .seeds import check_seeds, in_groups

TRIALS_AT_ONCE = 100
"""Trials that are simulated side by side."""

PUSH_SEED = 2024
"""The pushes are the same for every controller and every seed of the plants."""


@dataclass(frozen=True)
class Trial:
    """One swing-up, as the robot recorded it."""

    seed: int
    criteria: Criteria
    speed: float
    """Largest measured speed of a joint (rad/s)."""
    angle: float
    """Largest measured angle of a joint (rad)."""
    stop: float | None
    """When the robot stopped the run (s), if it did."""
    fault: str | None = None
    """What was wrong with the controller's answers, if anything."""

    @property
    def score(self) -> float:
        """The RealAI score, 0 without success."""
        return 0.0 if self.fault else self.criteria.score

    @property
    def success(self) -> bool:
        """Up at the end of a whole run."""
        return self.criteria.success and self.fault is None

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return asdict(self) | {"success": self.success, "score": self.score}


@dataclass(frozen=True)
class Trials:
    """A controller's trials on plants and in loops like the real robot's."""

    robot: str
    controller: str
    rules: str
    domain: Domain
    runs: tuple[Trial, ...]
    trajectory: Trajectory = dataclasses.field(repr=False)
    """The record of the first trial, until it stopped; NumPy arrays in float64."""
    version: str = __version__
    estimator: bool = False
    """Whether a state estimator stood before the controller."""

    @property
    def score(self) -> float:
        """Mean score."""
        return fmean(run.score for run in self.runs)

    @property
    def interval(self) -> Interval | None:
        """95 % interval of the mean score, with two trials or more."""
        return mean_interval([run.score for run in self.runs], 0.0, 1.0) if len(self.runs) > 1 else None

    @property
    def best(self) -> float:
        """Best score."""
        return max(run.score for run in self.runs)

    @property
    def successes(self) -> int:
        """Trials with success."""
        return sum(run.success for run in self.runs)

    @property
    def success_interval(self) -> Interval:
        """95 % interval of the share of successes."""
        return share_interval(self.successes, len(self.runs))

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        names = ("robot", "controller", "estimator", "rules", "version")
        scores = ("successes", "success_interval", "best", "score", "interval")
        return {
            **{name: getattr(self, name) for name in names},
            **({} if self.domain.plant is None else self.domain.plant.summary(self.robot)),
            "domain": self.domain.as_dict(),
            **{name: getattr(self, name) for name in scores},
            "seed": self.runs[0].seed,
            "details": [run.as_dict() for run in self.runs],
        }


def trials(
    controller: Any,
    robot: Robot | str,
    name: str = "controller",
    rules: TrialRules | str = DEFAULT_TRIAL_RULES,
    domain: Domain | str | None = None,
    seed: int = 0,
    seeds: int | None = None,
    progress: Progress | None = None,
) -> Trials:
    """Simulate swing-ups from hanging at rest in float64, one a seed, and score what the robot records.

    Args:
        controller: a controller in JAX, an object with ``get_control_output(x, t)`` or a function of (x, t).
        robot: which joint is driven.
        name: name of the controller in the result.
        rules: rules of a real robot's board, or their name.
        domain: ranges of plants and loops; None for those of the rules.
        seed: the first seed of the plants, loops and noise. The pushes do not depend on it.
        seeds: number of seeds in a row; None for as many as the board has trials.
        progress: called with the number of finished simulations and of all.

    Raises:
        SwingupError: there is no such robot or domain, there are no such rules, a seed is out of range, or the
            controller is for the other robot.
    """
    robot, rules = get_robot(robot), get_trial_rules(rules)
    every = check_seeds(seed, rules.trials if seeds is None else seeds)
    chosen = rules.domain if domain is None else domain
    ranges = load_domain(chosen) if isinstance(chosen, str) else chosen
    estimator, controller = has_estimator(controller), prepare(controller, robot, name, ranges.known_plant(robot))
    runs: list[Trial] = []
    first = None
    for group in in_groups(every, TRIALS_AT_ONCE):
        with jax.enable_x64(True):
            scenarios = [trial_scenario(rules, ranges, robot, each) for each in group]
        batch = run_many(controller, stack(scenarios), rules.dt, rules.steps, ranges.depth, keep=True)
        for index, (each, fault) in enumerate(zip(group, batch.faults, strict=True)):
            one = jax.tree.map(lambda rows, index=index: np.asarray(rows)[index], batch.trajectory)
            first = first or recorded(one, rules.duration)
            runs.append(_judged(each, one, scenarios[index].parameters, rules, fault))
        if progress is not None:
            progress(len(runs), len(every))
    assert first is not None
    return Trials(robot.name, name, rules.name, ranges, tuple(runs), first, estimator=estimator)


def trial_scenario(rules: TrialRules, domain: Domain, robot: Robot, seed: int) -> Scenario:
    """A plant and a loop drawn from the domain, with the pushes of this trial; call it in 64-bit mode."""
    parameters, disturbance = draw(domain, jax.random.key(seed), robot)
    if rules.pushes:
        disturbance = dataclasses.replace(disturbance, pushes=trial_pushes(rules, robot, seed))
    return Scenario(parameters, disturbance, supervisor=Stop(rules.stop), substeps=domain.substeps)


def trial_pushes(rules: TrialRules, robot: Robot, trial: int) -> Pushes:
    """The pushes of a trial on both joints: there are as many sets as profiles, and they come in turn."""
    pushes = rules.pushes[robot.name]
    return draw_pushes(np.random.default_rng([PUSH_SEED, trial % pushes.profiles]), pushes, rules.duration)


def _judged(seed: int, rows: Trajectory, plant: Plant, rules: TrialRules, fault: str | None) -> Trial:
    record: Any = recorded(rows, rules.duration)
    stop = stopped_at(rows, rules.duration)
    criteria = judge(record.time, record.x, record.u, float(plant.l1), float(plant.l2), rules.performance)
    speed, angle = float(np.abs(record.x[:, 2:]).max()), float(np.abs(record.x[:, :2]).max())
    return Trial(seed, criteria if stop is None else failed(criteria), speed, angle, stop, fault)
