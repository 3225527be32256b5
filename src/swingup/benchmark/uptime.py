"""The global-policy score (ICRA 2025): the share of a minute that the tip is up although the pendulum is thrown."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any, NamedTuple

import jax
import numpy as np

from ..common.errors import SwingupError
from ..common.text import quoted
from ..common.version import __version__
from ..controllers.registry import has_estimator
from ..dynamics.integrate import stable_substeps
from ..loop.domain import Domain, load_domain
from ..loop.supervisors.throws import Throws
from ..plant.plant import LEADERBOARD, Plant, PlantLike, load_plant
from ..plant.robots import Robot, get_robot
from ..plant.units import scaled, scales_of
from .criteria import tip_is_up
from .interval import Interval, mean_interval
from .recording import recorded, stopped_at
from .robot_minute import recorded_share, robot_minute
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
    domain: Domain | None = None
    """What plants and loops were drawn from; None for the leaderboards' plant in a perfect loop."""
    stops: tuple[float | None, ...] = ()
    """When the robot's limits stopped a run (s), if they did, one a seed."""
    note: str | None = None
    """What the rules say of themselves."""

    plant: Plant = LEADERBOARD
    """What was thrown in a perfect loop, where there is no domain."""

    @property
    def best(self) -> float:
        """The best of the seeds."""
        return max(self.uptimes)

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
        head = {name: getattr(self, name) for name in names}
        if self.domain is None:
            head |= self.plant.summary(self.robot)
        else:
            head |= {"best": self.best, "domain": self.domain.as_dict()}
        if self.note is not None:
            head |= {"note": self.note}
        runs = zip(self.seeds, self.uptimes, self.faults, self.stops, strict=True)
        details = [
            {"seed": seed, "uptime": up}
            | ({"fault": why} if why else {})
            | ({} if stop is None else {"stop": stop})
            for seed, up, why, stop in runs
        ]
        return {**head, "seed": self.seeds[0], "details": details}


def uptime(
    controller: Any,
    robot: Robot | str,
    name: str = "controller",
    rules: UptimeRules | str = DEFAULT_UPTIME_RULES,
    seed: int = 0,
    seeds: int | None = None,
    progress: Progress | None = None,
    plant: PlantLike = LEADERBOARD,
    domain: Domain | str | None = None,
) -> Uptime:
    """Simulate a minute with random throws for each seed, in float64, and score it.

    Both joints have motors: a controller has to command 0 on its passive joint itself.

    Args:
        controller: a controller in JAX, an object with ``get_control_output(x, t)`` or a function of (x, t).
        robot: which joint the controller drives.
        name: name of the controller in the result.
        rules: rules of the global-policy board, or their name.
        seed: the first seed of the throws.
        seeds: number of seeds in a row; None for as many as the board has runs: 1 for the rules v3.
        progress: called with the number of finished simulations and of all.
        plant: what is thrown, by a PID in that pendulum's own units: a plant, its name or its file. Rules of a real
            robot draw theirs from a domain.
        domain: ranges of plants and loops for rules of a real robot; None for those of the rules.

    Raises:
        SwingupError: there is no such robot, plant or domain, there are no such rules, a seed is out of range, the
            controller is for the other robot, or rules without a domain got one, or the others a plant.
    """
    robot, rules = get_robot(robot), get_uptime_rules(rules)
    every = tuple(check_seeds(seed, rules.trials if seeds is None else seeds))
    found, drawn = load_plant(plant), minute_domain(rules, domain, plant)
    # What is known of a robot is the plant that its domain starts from.
    nominal = (found if drawn is None else drawn.design_plant).driven(robot)
    estimator, controller = has_estimator(controller), prepare(controller, robot, name, nominal)
    rules = scaled(rules, scales_of(found.driven(robot)))
    runs: list[_Run] = []
    first = None
    for group in in_groups(every, MINUTES_AT_ONCE):
        with jax.enable_x64(True):
            scenarios = [_scenario(rules, robot, nominal, drawn, each) for each in group]
        depth = 1 if drawn is None else drawn.depth
        batch = run_many(controller, stack(scenarios), rules.dt, rules.steps, depth, keep=True)
        rows: Any = batch.trajectory
        runs += map(_Run, batch.faults, *_judged(rows, scenarios, rules))
        first = first or _first(rows, rules)
        if progress is not None:
            progress(len(runs), len(every))
    assert first is not None
    return Uptime(
        robot=robot.name,
        controller=name,
        rules=rules.name,
        seeds=every,
        uptimes=tuple(0.0 if run.fault else run.uptime for run in runs),
        faults=tuple(run.fault for run in runs),
        trajectory=first,
        estimator=estimator,
        plant=found,
        domain=drawn,
        stops=tuple(run.stop for run in runs),
        note=rules.note,
    )


class _Run(NamedTuple):
    fault: str | None
    uptime: float
    stop: float | None


def minute_domain(rules: UptimeRules, domain: Domain | str | None, plant: PlantLike = LEADERBOARD) -> Domain | None:
    """What plants and loops are drawn from; None for rules that draw none.

    Raises:
        SwingupError: there is no such domain, or the rules take none, or no plant.
    """
    if rules.domain is None and domain is not None:
        name = domain.name if isinstance(domain, Domain) else domain
        raise SwingupError(f"the rules {rules.name} draw no plants: leave the domain {quoted(name)} out")
    if rules.domain is not None and load_plant(plant) != LEADERBOARD:
        raise SwingupError(f"the rules {rules.name} draw plants from a domain: give the plant as the domain")
    chosen = rules.domain if domain is None else domain
    return load_domain(chosen) if isinstance(chosen, str) else chosen


def _scenario(rules: UptimeRules, robot: Robot, plant: Plant, domain: Domain | None, seed: int) -> Scenario:
    if domain is not None:
        return robot_minute(rules, domain, robot, seed)
    limit = rules.thrower.limit
    parameters = dataclasses.replace(plant, tl1=limit, tl2=limit)
    return Scenario(parameters, throws=draw_throws(rules, seed), substeps=stable_substeps(parameters, rules.dt))


def _judged(
    rows: Trajectory, scenarios: Sequence[Scenario], rules: UptimeRules
) -> tuple[list[float], list[float | None]]:
    """The uptime of each run, and when it stopped, if it did."""
    plants = [scenario.parameters for scenario in scenarios]
    if rows.record is None:
        up = tip_is_up(np.asarray(rows.x), float(plants[0].l1), float(plants[0].l2), rules.height).mean(axis=1)
        return up.tolist(), [None] * len(plants)
    runs = [_run(rows, index) for index in range(len(plants))]
    records = [recorded(run, rules.duration) for run in runs]
    shares = [recorded_share(record, plant, rules) for record, plant in zip(records, plants, strict=True)]
    return shares, [stopped_at(run, rules.duration) for run in runs]


def _run(rows: Trajectory, index: int) -> Trajectory:
    run: Trajectory = jax.tree.map(lambda each: np.asarray(each)[index], rows)
    return run


def _first(rows: Trajectory, rules: UptimeRules) -> Trajectory:
    """Rows of the first run: as a robot records them where one was simulated."""
    first = _run(rows, 0)
    return first if first.record is None else recorded(first, rules.duration)


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
