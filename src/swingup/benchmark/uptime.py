"""The global-policy score (ICRA 2025): the share of a minute that the tip is up although the pendulum is thrown."""

import dataclasses
from dataclasses import dataclass
from statistics import fmean
from typing import Any

import numpy as np

from ..control.registry import has_estimator
from ..physics.integrate import stable_substeps
from ..physics.parameters import Robot, get_robot
from ..plants.plant import Plant, PlantLike, find_plant, plant_as_dict, robot_parameters
from ..tasks.throws import Throws
from ..version import __version__
from .criteria import tip_is_up
from .interval import Interval, mean_interval
from .own_units import uptime_in_own_units
from .rollout import Scenario, Trajectory
from .rules import DEFAULT_UPTIME_RULES, UptimeRules, get_uptime_rules
from .runner import Progress, prepare, run_many, stack
from .seeds import check_seeds, in_groups

MINUTES_AT_ONCE = 64
"""Seeds that are simulated side by side: the rows of a minute take 1.7 MB each."""


@dataclass(frozen=True)
class Uptime:
    """A controller's global-policy score on a robot."""

    robot: str
    controller: str
    rules: str
    seeds: tuple[int, ...]
    """Seeds of the throws."""
    uptimes: tuple[float, ...]
    """Share of the time that the tip was up, one a seed; 0 where the controller failed to answer."""
    faults: tuple[str | None, ...]
    """What was wrong with the controller's answers, if anything, one a seed."""
    trajectory: Trajectory = dataclasses.field(repr=False)
    """Rows of the first seed; NumPy arrays in float64."""
    version: str = __version__
    estimator: bool = False
    """Whether a state estimator stood before the controller."""
    plant: Plant | None = None
    """None is the leaderboards' plant."""

    @property
    def uptime(self) -> float:
        """Mean over the seeds."""
        return fmean(self.uptimes)

    @property
    def interval(self) -> Interval | None:
        """95 % interval of the mean, with two seeds or more."""
        return mean_interval(self.uptimes, 0.0, 1.0) if len(self.uptimes) > 1 else None

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        names = ("robot", "controller", "estimator", "rules", "version", "uptime", "interval")
        head = {name: getattr(self, name) for name in names} | plant_as_dict(self.plant, self.robot)
        runs = zip(self.seeds, self.uptimes, self.faults, strict=True)
        details = [{"seed": seed, "uptime": up} | ({"fault": why} if why else {}) for seed, up, why in runs]
        return {**head, "seed": self.seeds[0], "details": details}


def uptime(
    controller: Any,
    robot: Robot | str,
    name: str = "controller",
    rules: UptimeRules | str = DEFAULT_UPTIME_RULES,
    seed: int = 0,
    seeds: int = 1,
    progress: Progress | None = None,
    plant: PlantLike | None = None,
) -> Uptime:
    """Simulate a minute with random throws for each seed, in float64, and score it.

    Both joints have motors: a controller has to command 0 on its passive joint itself.

    Args:
        controller: a controller in JAX, an object with ``get_control_output(x, t)`` or a function of (x, t).
        robot: which joint the controller drives.
        name: name of the controller in the result.
        rules: rules of the global-policy board, or their name.
        seed: the first seed of the throws.
        seeds: number of seeds in a row.
        progress: called with the number of finished simulations and of all.
        plant: what is thrown, by a PID in that pendulum's own units: a plant, its parameters, its name or its file;
            None for the leaderboards'.

    Raises:
        SwingupError: there is no such robot or plant, there are no such rules, a seed is out of range, or the
            controller is for the other robot.
    """
    robot, rules = get_robot(robot), get_uptime_rules(rules)
    every, found = tuple(check_seeds(seed, seeds)), find_plant(plant)
    nominal = robot_parameters(found, robot)
    estimator, controller = has_estimator(controller), prepare(controller, robot, name, nominal)
    rules = uptime_in_own_units(rules, robot, found)
    limit = rules.thrower.limit
    parameters = dataclasses.replace(nominal, tl1=limit, tl2=limit)
    substeps = stable_substeps(parameters, rules.dt)
    uptimes: list[float] = []
    faults: list[str | None] = []
    first = None
    for group in in_groups(every, MINUTES_AT_ONCE):
        thrown = [Scenario(parameters, throws=draw_throws(rules, each), substeps=substeps) for each in group]
        scenarios = stack(thrown)
        batch = run_many(controller, scenarios, rules.dt, rules.steps, keep=True)
        rows: Any = batch.trajectory
        up = tip_is_up(rows.x, float(parameters.l1), float(parameters.l2), rules.height).mean(axis=1)
        uptimes += [0.0 if fault else float(share) for share, fault in zip(up, batch.faults, strict=True)]
        faults += batch.faults
        first = first or Trajectory(rows.time[0], rows.x[0], rows.u[0])
        if progress is not None:
            progress(len(uptimes), len(every))
    assert first is not None
    head = robot.name, name, rules.name, every
    return Uptime(*head, tuple(uptimes), tuple(faults), first, estimator=estimator, plant=found)


def draw_throws(rules: UptimeRules, seed: int) -> Throws:
    """Random throws: when they come, and where they aim."""
    random = np.random.default_rng(seed)
    mean_times = np.linspace(rules.first, rules.duration - rules.first, rules.throws)
    starts = mean_times + random.uniform(-rules.jitter, rules.jitter, rules.throws)
    target = random.uniform(-np.pi, np.pi, (rules.throws, 2))
    # The benchmark's clock is a sum: its rounding decides whether a throw lasts one step more.
    time = np.concatenate([[0.0], np.cumsum(np.full(rules.steps - 1, rules.dt))])
    number = np.full(rules.steps, -1)
    for index, start in enumerate(starts):
        first = int(np.searchsorted(time, start))
        number[(np.arange(rules.steps) >= first) & (time - time[first] <= rules.throw_duration)] = index
    return Throws(number, target, rules.thrower)
