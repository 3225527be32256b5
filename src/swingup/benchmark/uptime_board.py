"""Boards of the global policy: the share of time that the tip is up although the pendulum is thrown."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import jax
import numpy as np

from ..dynamics.integrate import stable_substeps
from ..loop.draw import draw
from ..loop.supervisors import (
    THROWER,
    AbstractSupervisor,
    Cell,
    CellSettings,
    Limits,
    Resets,
    Stop,
    Thrower,
    Throws,
    example_disturbances,
)
from ..plant.plant import Plant
from ..plant.units import TIME, scaled, scales_of
from .board import AbstractBoard, Case, Run, Setting, Summary, TipHistory, summed_scores
from .rollout import Scenario, Trajectory
from .swing_up_board import MIN_SPAN, tip_heights, tip_is_up

MAX_GAP = 0.1  # s: in a longer period anything may happen; recordings have up to 0.04


@dataclass(frozen=True, kw_only=True)
class UptimeBoard(AbstractBoard):
    """Minutes with throws by a PID on both joints, which both have motors, or with a cell's disturbances.

    A controller has to command 0 on its passive joint itself, or no more than the compensation of its friction.
    """

    duration: float = 60.0
    height: float = 0.9
    """Fraction of l1 + l2 above which the tip counts as up."""
    throws: int = 15
    first_throw: float = 3.75
    """Mean time of the first throw (s). The mean time of the last throw is as long before the end."""
    jitter: float = 1.0
    """Throws come at uniform random times within this of their mean times (s)."""
    throw_duration: Annotated[float, TIME] = 0.2
    """s"""
    thrower: Thrower = THROWER
    """The PID that throws."""
    limits: Limits | None = None
    """Beyond these the pendulum is thrown at once; None for planned throws alone."""
    clean_samples: int = 10
    """Samples in a row that have to be within these limits before a throw ends."""
    goals: int | None = None
    """Number of targets that are drawn, for throws by plan and at limits; None for one a planned throw."""
    stop: Limits | None = None
    """Beyond these the run stops; None for runs that nothing stops."""
    cell: CellSettings | None = None
    """Disturbances of a CloudPendulum cell, in place of throws; None for throws."""
    side_by_side: int = 64
    """The rows of one minute take 1.7 MB."""

    @property
    def columns(self) -> tuple[str, ...]:
        """The mean share of time; of several runs on a robot the best one as well."""
        return ("score",) if self.domain is None else ("best", "score")

    def is_random(self, setting: Setting) -> bool:
        """Throws depend on the seed."""
        return True

    def on(self, setting: Setting) -> "UptimeBoard":
        """The board with throws and limits in the pendulum's own units; those of a cell are its own already."""
        return scaled(self, scales_of(setting.nominal)) if self.cell is None else self

    def stop_limits(self) -> Limits | None:
        """The limits beyond which the robot stops."""
        return self.stop

    def cases(self, setting: Setting, seeds: Sequence[int]) -> list[Case]:
        """One minute a seed: throws on one plant, or a plant and a loop drawn from a domain."""
        return [Case(self._scenario(setting, seed), {"seed": seed}) for seed in seeds]

    def _scenario(self, setting: Setting, seed: int) -> Scenario:
        limit = self.thrower.limit
        if setting.domain is None:
            parameters = replace(setting.nominal, tl1=limit, tl2=limit)
            throws = draw_throws(self, parameters, seed)
            return Scenario(parameters, supervisor=throws, substeps=stable_substeps(parameters, self.dt))
        parameters, disturbance = draw(setting.domain, jax.random.key(seed), setting.robot)
        supervisor: AbstractSupervisor
        if self.cell is None:
            supervisor = draw_resets(self, setting.domain.plant, seed)
        else:
            supervisor = draw_cell(self, setting.domain.plant, seed)
            limit = max(float(parameters.tl1), float(parameters.tl2))
        parameters = replace(parameters, tl1=limit, tl2=limit)
        return Scenario(parameters, disturbance, supervisor=supervisor, substeps=setting.domain.substeps)

    def score(self, case: Case, rows: Trajectory, fault: str | None = None, stop: float | None = None) -> Run:
        """Time up over the duration of the board, time in throws as well; what a stop cuts off counts as down.

        Success is to be up at the end of a whole run.
        """
        time, x = np.asarray(rows.time), np.asarray(rows.x)
        # A recording may be longer than the board.
        within = time - time[0] <= self.duration * (1 + 1e-9)
        time, x = time[within], x[within]
        lengths = float(case.scenario.parameters.l1), float(case.scenario.parameters.l2)
        up = tip_is_up(x, *lengths, self.height)
        # Each row has the time since the one before it, but for what a gap leaves out.
        periods = np.minimum(np.diff(time, prepend=time[0]), MAX_GAP)
        share = 0.0 if fault else float(periods[up].sum()) / self.duration
        whole = time[-1] - time[0] >= MIN_SPAN * self.duration
        success = bool(whole and stop is None and fault is None and up[-1])
        tip = TipHistory(float(tip_heights(x, *lengths).max()), sum(lengths), None)
        return Run(case, success, share, fault, tip=tip, stop=stop)

    def summarise(self, runs: Sequence[Run], seeds: Sequence[int]) -> Summary:
        """The mean over the seeds, and its interval."""
        values, intervals = summed_scores(runs)
        return {name: values[name] for name in self.columns}, intervals


def draw_throws(board: UptimeBoard, model: Plant, seed: int) -> Throws:
    """Random throws: when they come, and where they aim. The PID compensates the model's gravity."""
    random = np.random.default_rng(seed)
    starts = _throw_times(board, random)
    target = random.uniform(-np.pi, np.pi, (board.throws, 2))
    # The benchmark's clock is a sum: its rounding decides whether a throw lasts one step more.
    time = np.concatenate([[0.0], np.cumsum(np.full(board.steps - 1, board.dt))])
    number = np.full(board.steps, -1)
    for index, start in enumerate(starts):
        if start > time[-1]:  # on a board that was made shorter
            continue
        first = int(np.searchsorted(time, start))
        number[(np.arange(board.steps) >= first) & (time - time[first] <= board.throw_duration)] = index
    return Throws(number, target, board.thrower, model)


def draw_resets(board: UptimeBoard, model: Plant, seed: int) -> Resets:
    """Random resets on a robot; the PID compensates the gravity of the nominal model, whatever the plant."""
    assert board.limits is not None
    assert board.stop is not None
    random = np.random.default_rng(seed)
    plan = _throw_times(board, random)
    target = random.uniform(-np.pi, np.pi, (board.goals or board.throws, 2))
    known = board.throw_duration, board.clean_samples, board.limits, board.thrower, model
    return Resets(plan, target, *known, Stop(board.stop))


def draw_cell(board: UptimeBoard, model: Plant, seed: int) -> Cell:
    """The disturbances of a CloudPendulum cell in a random order; moves compensate the nominal model's gravity."""
    assert board.cell is not None
    assert board.stop is not None
    return Cell(example_disturbances(np.random.default_rng(seed)), board.cell, model, Stop(board.stop))


def _throw_times(board: UptimeBoard, random: np.random.Generator) -> np.ndarray:
    mean_times = np.linspace(board.first_throw, board.duration - board.first_throw, board.throws)
    return mean_times + random.uniform(-board.jitter, board.jitter, board.throws)
