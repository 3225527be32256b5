"""Boards of single swing-ups from hanging at rest, and their criteria: in a perfect loop or on the simulated robot.

Sums run over the rows k = 0 .. N-2 with Δt_k = t_{k+1} - t_k, standard deviations over the population.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import fmean
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common.errors import SwingupError
from ..dynamics.integrate import stable_substeps
from ..loop.disturbance import Pushes, disturbance_as_dict
from ..loop.draw import draw
from ..loop.supervisors import Limits, Stop
from ..plant.plant import Robot
from ..plant.units import scaled, scales_of
from ..plant.upright import upright_needs
from .board import AbstractBoard, Case, Criteria, Run, Setting, Summary, TipHistory, summed_scores
from .disturbances import PushRules, draw_pushes
from .rollout import Scenario, Trajectory
from .values import PERFORMANCE

LARGEST_LEAN = 0.05  # rad: a strong motor catches more, where no law is linear
LEAN_SEED = 2026  # The leans are the same for every controller
PUSH_SEED = 2024  # The pushes are the same for every controller and every seed of the plants

CAUGHT = 0.5  # A tip that is up for less (s) only passes the top
MIN_SPAN = 0.99  # Part of the duration that a run must span to score, as the benchmark's own script has it


@dataclass(frozen=True)
class Normalisers:
    """The divisor of each criterion in the RealAI score, in the units of :class:`~.board.Criteria`."""

    swingup_time: float
    energy: float
    torque_cost: float
    torque_smoothness: float
    velocity_cost: float


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
    lean: float | None = None
    """Runs begin upright at rest, stretched, with a lean of up to this share of what the motor catches, and up to
    0.05 rad; None for hanging."""
    pushes: Mapping[str, PushRules] = field(default_factory=dict)
    """Pushes on both joints by the robot's name, with as many profiles as trials; none for calm runs."""

    @property
    def columns(self) -> tuple[str, ...]:
        """The criteria of one swing-up in a perfect loop; successes and scores of several on a robot."""
        return PERFORMANCE if self.domain is None else ("swingups", "best", "score")

    def is_random(self, setting: Setting) -> bool:
        """A perfect loop has nothing random but a lean."""
        return self.lean is not None or setting.domain is not None or setting.disturbance is not None

    def on(self, setting: Setting) -> "SwingUpBoard":
        """The board with the robot's normalisers, and limits and pushes in the pendulum's own units."""
        normalisers = self.for_robots.get(setting.robot.name, self.normalisers)
        board = replace(self, normalisers=normalisers, for_robots={})
        if self.domain is None:
            return board
        scales = scales_of(setting.nominal)
        pushes = {name: scaled(each, scales) for name, each in board.pushes.items()}
        return replace(scaled(board, scales), pushes=pushes)

    def cases(self, setting: Setting, seeds: Sequence[int]) -> list[Case]:
        """One swing-up a seed."""
        if self.lean is not None:
            return [self._leaning(case, setting, self.lean) for case in self._hanging(setting, seeds)]
        return self._hanging(setting, seeds)

    def _leaning(self, case: Case, setting: Setting, share: float) -> Case:
        """The case with a start near upright, by its seed."""
        needs = upright_needs(setting.nominal, setting.robot)
        if needs is None:
            raise SwingupError(f"gravity does not pull both links down: the board {self.name} has no upright")
        seed = case.settings["seed"]
        lean = min(share * needs.tilt, LARGEST_LEAN) * np.random.default_rng([LEAN_SEED, seed]).uniform(-1.0, 1.0)
        scenario = replace(case.scenario, start=jnp.array([np.pi + lean, 0.0, 0.0, 0.0]))
        return replace(case, scenario=scenario, settings={**case.settings, "lean": lean})

    def _hanging(self, setting: Setting, seeds: Sequence[int]) -> list[Case]:
        if setting.domain is None:
            calm = Scenario(setting.nominal, substeps=stable_substeps(setting.nominal, self.dt))
            if setting.disturbance is None:
                return [Case(calm, {"seed": seed}) for seed in seeds] if self.is_random(setting) else [Case(calm)]
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
            limits = self.stop_limits()
            stop = None if limits is None else Stop(limits)
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
        tip = follow_tip(time, x, *lengths, self)
        if stop is not None:
            tip = replace(tip, failure=f"the robot stops it at t = {stop:.3f} s", cause="stopped")
        success = tip.failure is None and fault is None
        if not success:
            criteria = replace(criteria, success=False, swingup_time=None, score=0.0)
        speed, angle = float(np.abs(x[:, 2:]).max()), float(np.abs(x[:, :2]).max())
        return Run(case, success, criteria.score, fault, criteria, tip, speed, angle, stop)

    def stop_limits(self) -> Limits | None:
        """The limits where the robot stops beyond them."""
        return self.limits if self.stops else None

    def summarise(self, runs: Sequence[Run], seeds: Sequence[int]) -> Summary:
        """Means over the runs; a swing-up time is that of the successes."""
        values, intervals = summed_scores(runs)
        if self.domain is not None:
            return {"swingups": 100.0 * sum(run.success for run in runs) / len(runs), **values}, intervals
        columns = {name: [getattr(run.criteria, name) for run in runs] for name in PERFORMANCE}
        known = {name: [each for each in column if each is not None] for name, column in columns.items()}
        return {name: fmean(column) if column else None for name, column in known.items()}, intervals


def compute_criteria(
    time: np.ndarray, x: np.ndarray, u: np.ndarray, l1: float, l2: float, rules: SwingUpBoard
) -> Criteria:
    """The criteria and the score of rows of time (s), states before each step and torques (N m) of links (m)."""
    dt = np.diff(time)
    # The benchmark looks neither at the first row nor at the last.
    up, times = tip_is_up(x, l1, l2, rules.height)[1:-1], time[1:-1]
    start = int(np.max(np.flatnonzero(~up), initial=-1)) + 1
    costs = {
        # Absolute values: the benchmark counts braking as work, too.
        "energy": float(np.sum(np.abs(np.diff(x[:, :2], axis=0) * u[:-1]))),
        "torque_cost": float(np.sum(np.sum(u[:-1] ** 2, axis=1) * dt)),
        "torque_smoothness": float(np.sum(np.std(np.diff(u, axis=0), axis=0))),
        "velocity_cost": float(np.sum(np.sum(x[:-1, 2:] ** 2, axis=1) * dt)),
    }
    # It compares the last time. The boards test the span as well.
    if start == up.size or time[-1] < MIN_SPAN * rules.duration:
        return Criteria(success=False, swingup_time=None, **costs, score=0.0)
    swingup_time = float(times[start])
    score = realai_score({"swingup_time": swingup_time, **costs}, rules.normalisers)
    return Criteria(success=True, swingup_time=swingup_time, **costs, score=score)


def follow_tip(time: np.ndarray, x: np.ndarray, l1: float, l2: float, rules: SwingUpBoard) -> TipHistory:
    """How high the tip came, and why the run failed, if it did: also at limits, unless the robot stops there."""
    reach, hold, failure, cause = l1 + l2, rules.hold, None, None
    highest, every = float(tip_heights(x, l1, l2).max()), tip_is_up(x, l1, l2, rules.height)
    # The benchmark looks neither at the first row nor at the last.
    up, times = every[1:-1], time[1:-1]
    if rules.limits and not rules.stops and (passed := _limit_passed(time, x, every, rules.limits)):
        failure, cause = passed, "beyond a limit"
    elif not up.any():
        cause = "no swing-up"
        failure = f"never up: the tip reached {highest:.3f} m and must pass {rules.height * reach:g} m"
    elif not up[-1]:
        edges = np.flatnonzero(np.diff(np.concatenate([[False], up])))
        stretches = np.diff(times[edges])[::2]
        longest, last = int(np.argmax(stretches)), int(np.flatnonzero(up)[-1])
        begun, ended = times[edges[2 * longest]], times[edges[2 * longest + 1]]
        cause, failure = "fell", f"up at t = {begun:.3f} s, fell at t = {ended:.3f} s"
        # What was never caught did not fall.
        if stretches[longest] < CAUGHT:
            cause = "no swing-up"
            times_up, most = len(stretches), stretches[longest]
            failure = f"never caught: the tip passes the top {times_up} times, for {most:.2f} s at most"
        elif times[last + 1] > ended:
            failure += f", last up at t = {times[last]:.3f} s"
    # Both the benchmark's limit on the last time and ours on the span.
    elif min(time[-1], time[-1] - time[0]) < MIN_SPAN * rules.duration:
        failure = f"it spans {time[-1] - time[0]:g} s, below {MIN_SPAN:.0%} of {rules.duration:g} s"
        cause = "stopped"
    elif hold is not None and not every[time >= rules.duration - hold].all():
        since = time[min(int(np.flatnonzero(~every)[-1]) + 1, len(time) - 1)]
        failure, cause = f"up for good at t = {since:.3f} s only, not for the last {hold:g} s", "up late"
    return TipHistory(highest, reach, failure, cause)


def _limit_passed(time: np.ndarray, x: np.ndarray, up: np.ndarray, limits: Limits) -> str | None:
    """Which joint first passed which limit, when and in which phase."""
    bounds = limits.bounds
    # Negated, so that a state that has diverged is beyond them.
    beyond = ~(np.abs(x) <= bounds)
    if not beyond.any():
        return None
    row = int(np.argmax(beyond.any(axis=1)))
    place = int(np.argmax(beyond[row]))
    phase = "at the top" if up[:row].any() else "swinging up"
    limit = f"{bounds[place]:.4g} {'rad' if place < 2 else 'rad/s'}"
    joint = ("shoulder", "elbow")[place % 2]
    return f"{phase}, the {joint} passes {limit} at t = {time[row]:.3f} s"


def realai_score(costs: Mapping[str, Any], normalisers: Normalisers, tanh: Callable[..., Any] = math.tanh) -> Any:
    """1 - (1/5) Σ_i tanh(π c_i / n_i) of a successful run; names are those of :class:`Normalisers`."""
    penalties = [tanh(math.pi * costs[name] / normaliser) for name, normaliser in vars(normalisers).items()]
    return 1.0 - sum(penalties) / len(penalties)


def tip_is_up(x: np.ndarray, l1: float, l2: float, fraction: float) -> np.ndarray:
    """Whether the tip is strictly above a fraction of l1 + l2, for states of shape (..., 4); lengths in m."""
    return tip_heights(x, l1, l2) > fraction * (l1 + l2)


def tip_heights(x: np.ndarray, l1: float, l2: float) -> np.ndarray:
    """Height of the tip above the shoulder (m), for states of shape (..., 4); lengths in m."""
    height: np.ndarray = -l1 * np.cos(x[..., 0]) - l2 * np.cos(x[..., 0] + x[..., 1])
    return height
