"""Boards of single swing-ups from hanging at rest: in a perfect loop, or on the simulated robot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import fmean

import jax
import numpy as np

from ..dynamics.integrate import stable_substeps
from ..loop.disturbance import Pushes, disturbance_as_dict
from ..loop.draw import draw
from ..loop.supervisors import Limits, Stop
from ..plant.plant import Robot
from ..plant.units import scaled, scales_of
from .board import AbstractBoard, Case, Run, Setting, Summary, summed_scores
from .columns import PERFORMANCE
from .criteria import SHARE, compute_criteria, follow_tip
from .disturbances import draw_pushes
from .rollout import Scenario, Trajectory
from .rules import Normalisers, PushRules

PUSH_SEED = 2024
"""The pushes are the same for every controller and every seed of the plants."""


@dataclass(frozen=True, kw_only=True)
class SwingUpBoard(AbstractBoard):
    """Swing-ups scored by five criteria: those of what the robot records where it stops beyond limits."""

    normalisers: Normalisers
    for_robots: Mapping[str, Normalisers] = field(default_factory=dict)
    """Normalisers of single robots, by the robot's name, where they are others."""
    height: float = 0.9
    """Fraction of l1 + l2 above which the tip counts as up."""
    limits: Limits | None = None
    """A run whose joints exceed them fails; None for runs without limits."""
    stops: bool = False
    """Whether the robot stops beyond the limits and its record is scored; else the true states are."""
    hold: float | None = None
    """Success: the tip is up in this last part of the run (s); None for being up at the end."""
    pushes: Mapping[str, PushRules] = field(default_factory=dict)
    """Pushes on both joints by the robot's name, with as many profiles as trials; none for calm runs."""

    @property
    def columns(self) -> tuple[str, ...]:
        """The criteria of one swing-up in a perfect loop; successes and scores of several on a robot."""
        return PERFORMANCE if self.domain is None else ("swingups", "best", "score")

    def is_random(self, setting: Setting) -> bool:
        """A perfect loop has nothing random."""
        return setting.domain is not None or setting.disturbance is not None

    def on(self, setting: Setting) -> "SwingUpBoard":
        """The board with the robot's normalisers, and limits and pushes in the pendulum's own units."""
        normalisers = self.for_robots.get(setting.robot.name, self.normalisers)
        board = replace(self, normalisers=normalisers, for_robots={})
        if setting.domain is None:
            return board
        scales = scales_of(setting.nominal)
        pushes = {name: scaled(each, scales) for name, each in board.pushes.items()}
        return replace(scaled(board, scales), pushes=pushes)

    def cases(self, setting: Setting, seeds: Sequence[int]) -> list[Case]:
        """One swing-up a seed."""
        if setting.domain is None:
            calm = Scenario(setting.nominal, substeps=stable_substeps(setting.nominal, self.dt))
            if setting.disturbance is None:
                return [Case(calm)]
            drawn = [(seed, setting.disturbance.draw(self.dt, self.duration, seed)) for seed in seeds]
            return [
                Case(replace(calm, disturbance=each), {"seed": seed, "disturbance": disturbance_as_dict(each)})
                for seed, each in drawn
            ]
        cases = []
        for seed in seeds:
            # A key for each seed: its plant is the same however many seeds are judged.
            parameters, disturbance = draw(setting.domain, jax.random.key(seed), setting.robot)
            if self.pushes:
                disturbance = replace(disturbance, pushes=self.trial_pushes(setting.robot, seed))
            stop = Stop(self.limits) if self.stops and self.limits else None
            scenario = Scenario(parameters, disturbance, supervisor=stop, substeps=setting.domain.substeps)
            cases.append(Case(scenario, {"seed": seed}))
        return cases

    def trial_pushes(self, robot: Robot, trial: int) -> Pushes:
        """The pushes of a trial on both joints: there are as many sets as profiles, and they come in turn."""
        rules = self.pushes[robot.name]
        return draw_pushes(np.random.default_rng([PUSH_SEED, trial % rules.profiles]), rules, self.duration)

    def score(self, case: Case, rows: Trajectory, fault: str | None = None, stop: float | None = None) -> Run:
        """The criteria, and whether the run kept within the limits.

        Times count from 0, or from the first row where that is earlier. A span below 99 % of the duration fails.
        """
        lengths = float(case.scenario.parameters.l1), float(case.scenario.parameters.l2)
        time, x, u = (np.asarray(part) for part in (rows.time, rows.x, rows.u))
        time = time - min(0.0, time[0])  # no negative swing-up times
        criteria = compute_criteria(time, x, u, *lengths, self)
        if stop is not None or fault is not None or time[-1] - time[0] < SHARE * self.duration:
            criteria = replace(criteria, success=False, swingup_time=None, score=0.0)
        tip = follow_tip(time, x, *lengths, self)
        if stop is not None:
            tip = replace(tip, failure=f"the robot stops it at t = {stop:.3f} s", cause="stopped")
        success = tip.failure is None and fault is None
        speed, angle = float(np.abs(x[:, 2:]).max()), float(np.abs(x[:, :2]).max())
        return Run(case, success, criteria.score if success else 0.0, fault, criteria, tip, speed, angle, stop)

    def summarise(self, runs: Sequence[Run], seeds: Sequence[int]) -> Summary:
        """Means over the runs; a swing-up time is that of the successes."""
        values, intervals = summed_scores(runs)
        if self.domain is not None:
            return {"swingups": 100.0 * sum(run.success for run in runs) / len(runs), **values}, intervals
        columns = {name: [getattr(run.criteria, name) for run in runs] for name in PERFORMANCE}
        known = {name: [each for each in column if each is not None] for name, column in columns.items()}
        return {name: fmean(column) if column else None for name, column in known.items()}, intervals
