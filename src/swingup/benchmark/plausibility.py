"""What is odd about a recording: what cannot be physics, and what keeps its score from being the board's.

A finding that ``refuses`` leaves a recording without a score; the others warn. A real robot's recording has uneven
periods, noise, offsets, friction and the torques of its motors. The limits lie above everything found in 27
recordings of the real robot, and below what a log with invented times, positions, velocities or torques shows.

Sums over a window of 0.1 s stand for single rows where noise would hide the fault: noise cancels, a fault adds up.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float

from ..common.checks import LARGEST_NUMBER
from ..dynamics.dynamics import wrap_difference
from ..dynamics.integrate import rk4_steps, stable_substeps
from ..identification.log_checks import SLOPE_WINDOW, slopes_of
from ..plant.files import load_plant
from ..plant.plant import LEADERBOARD, Plant, Robot, lump
from ..plant.units import TIME, VELOCITY, Scales, scales_of
from .balance import rows_in, running, unexplained
from .board import AbstractBoard
from .criteria import SHARE
from .rollout import Trajectory
from .swing_up_board import SwingUpBoard
from .uptime_board import UptimeBoard

COMPENSATION = 0.5
"""Torque that the rules leave the passive joint's motor, for the compensation of its friction (N m)."""

PASSIVE = 0.25
"""Share of the torque limit above which the passive joint is driven; recordings with pushes have 0.13."""

HANGING = (0.2, 1.0)
"""A start within this of hanging at rest hangs (rad, and rad/s on C.1); recordings have 0.001 rad and 0.1 rad/s."""

LONGEST_PERIOD = 10.0
"""A period longer than this many median periods is not jitter; recordings have up to 5."""

GAP = 0.1
"""In a longer period (s) a swing-up goes unseen; recordings have up to 0.04 s."""

UNEVEN = (0.5, 0.1)
"""A period is uneven if it differs from the median by more than the first share of it.

More than the second share of uneven periods is a warning; recordings have a share of 0.01."""

RATE = 0.05
"""A rate this far from the rules', relatively, changes the smoothness noticeably."""

FACTOR, SLOWEST = 2.0, 30.0
"""Rates of a score: within this factor of the board's; a robot's own loop may be slower, down to this (Hz)."""

WINDOW = 0.1
"""Length of the windows in which faults add up (s)."""

SLIP = 0.1
"""Angles and velocities may part by this in a window (rad on C.1), and by :data:`SLIP_RATE` times the period."""
SLIP_RATE = 8.0
"""rad/s; coarse rows know less of the velocity between them: recordings at 33 Hz have 0.26 rad, at 400 Hz 0.03."""

STRETCH = (0.005, 0.02)
"""Share by which velocities may be too large or too small for the angles, before a warning and a refusal.

Recordings of C.1 and simulations have 0.0004, those of a CloudPendulum 0.003."""

CLEAN, MODERATE = (0.01, 200.0), (0.1, 10.0)
"""Where nine of ten rows of moderate speed (rad/s) explain the angles this well, the rows come from a simulation.

rad/s, and rad/s³ times the square of the period, for the trapezoidal rule."""

STEP = 2e-5
"""Finest step of an encoder (rad): nine of ten neighbouring angles are further apart; recordings have 4.8e-5."""

WORK = 0.2
"""Unexplained work, as a share of the energy from hanging to upright (7.6 J on C.1); recordings have 0.06."""

TORQUE = (0.5, 0.3)
"""Unexplained torque of the driven and the passive joint, as shares of gravity's on the level arm (3.8 N m on C.1).

Recordings have 0.21 and 0.14, simulated robots that spin up to 0.39 and 0.25."""

TRACE, DEFECT = 1e-3, 0.5
"""Unexplained change of velocity of a simulation in a window (rad/s) on C.1: a warning, and a refusal.

A simulation of one of the two plants has less than 1e-6, 0.002 by the midpoint rule, and 0.23 by Euler's."""

COARSEST = 0.05
"""Longer periods are not simulated in one step (s): explicit steps would not be accurate."""

MOST_SUBSTEPS = 16
"""Steps of RK4 from a row to the next that are compiled, where friction is stiff."""

CHUNK = 5_000
"""Rows that are simulated at a time, so that recordings of any length share one compiled program."""

_steps = jax.jit(jax.vmap(rk4_steps, in_axes=(None, 0, 0, 0, None)), static_argnums=4)


@dataclass(frozen=True)
class Finding:
    """One thing that is odd about a recording."""

    name: str
    """For programs."""
    text: str
    """For readers, with the figure and the remedy."""
    refuses: bool = False
    """The recording gets no score; otherwise this is a warning."""


def examine(
    trajectory: Trajectory, robot: Robot, board: AbstractBoard, plant: Plant = LEADERBOARD
) -> list[Finding]:
    """Look at a trajectory that :func:`~swingup.benchmark.judge.score` accepts.

    The plant is the recording's, with or without its friction; the leaderboards' has that of design C.1.
    """
    # A simulated recording has the frictionless plant, a robot's has friction.
    ideal, real = (plant, load_plant("C.1")) if plant == LEADERBOARD else (plant.frictionless(), plant)
    plants = ideal.driven(robot), real
    scored = isinstance(board, SwingUpBoard)
    anywhere = isinstance(board, UptimeBoard) and board.cell is not None
    time, x, u = (np.asarray(rows, np.float64) for rows in (trajectory.time, trajectory.x, trajectory.u))
    period, scales = np.diff(time), scales_of(plants[1])
    with np.errstate(all="ignore"):  # absurd values overflow and become findings
        # What the velocities of two rows do not explain of the angles between (rad), by the trapezoidal rule.
        slip = wrap_difference(np.diff(x[:, :2], axis=0) - 0.5 * period[:, None] * (x[:-1, 2:] + x[1:, 2:]))
        simulated = _is_simulated(period, x, slip)
        # A simulation's velocities are those of its angles, and finer at high speeds.
        window = scales.scaled(SLOPE_WINDOW, TIME)
        rates = x[:, 2:] if simulated else slopes_of(time, np.unwrap(x[:, :2], axis=0), window)
        return [
            *_short_span(time, board.duration, "it scores 0" if scored else "the rest counts as down"),
            *_periods(period, board.dt, simulated, scored),
            *_start(x[0], scales.scaled(HANGING[1], VELOCITY), refuses=not anywhere),
            *_torques(u, robot, float(max(plants[0].tl1, plants[0].tl2)), thrown=not scored),
            *_positions(period, slip, scales),
            *_stretch(period, x),
            *_balances(time, x[:, :2], rates, u, plants, robot),
            *(
                _defect(period, x, u, plants, board.domain is not None)
                if simulated
                else _noise(x[:, :2], board.perfect)
            ),
        ]


_Found = Iterator[Finding]
_Plants = tuple[Plant, Plant]
"""Without friction, and with it."""


def _short_span(time: np.ndarray, duration: float, consequence: str) -> _Found:
    span = time[-1] - time[0]
    if span < SHARE * duration:
        yield Finding("short_span", f"it spans {span:.4g} s of {duration:g} s: below {SHARE:.0%} {consequence}")


def _periods(period: np.ndarray, dt: float, simulated: bool, scored: bool) -> _Found:
    usual, longest = float(np.median(period)), float(period.max())
    uneven = float(np.mean(np.abs(period - usual) > UNEVEN[0] * usual))
    if longest > LONGEST_PERIOD * usual or uneven > UNEVEN[1]:
        yield Finding(
            "irregular_periods",
            f"its periods reach {longest:.4g} s, their median is {usual:.4g} s, and {uneven:.0%} are far from it: "
            f"record all rows, at most {GAP:g} s apart",
            refuses=scored and longest > GAP,
        )
    slowest, fastest = 1 / (FACTOR * dt) if simulated else SLOWEST, FACTOR / dt
    # The margins are for rounding.
    if not slowest * (1 - 1e-6) <= 1 / usual <= fastest * (1 + 1e-6):
        yield Finding(
            "rate",
            f"it has {1 / usual:.4g} Hz; a score needs {slowest:g} to {fastest:g} Hz: record it at {1 / dt:g} Hz",
            refuses=True,
        )
    # The uptime compares no row with the next.
    elif scored and abs(dt / usual - 1) > RATE:
        yield Finding(
            "rate",
            f"it has {1 / usual:.4g} Hz, where the board has {1 / dt:g} Hz: the torque smoothness, which "
            "compares one row with the next, is not the board's",
        )


def _start(x: Float[np.ndarray, "4"], fastest: float, refuses: bool) -> _Found:
    angle, speed = float(np.abs(wrap_difference(x[:2])).max()), float(np.abs(x[2:]).max())
    # Negated, here and below: a NaN from overflow must count as a finding.
    if not (angle <= HANGING[0] and speed <= fastest):
        text = f"it starts {angle:.3g} rad off hanging, at {speed:.3g} rad/s: record from hanging at rest"
        yield Finding("not_hanging", text, refuses)


def _torques(u: Float[np.ndarray, "rows 2"], robot: Robot, limit: float, thrown: bool) -> _Found:
    largest = np.abs(u).max(axis=0)
    driven, passive = float(largest[robot.joint]), float(largest[1 - robot.joint])
    allowed = limit if thrown else COMPENSATION
    what = "the limit of its motor" if thrown else "the rules' friction compensation"
    # The margin is for rounding.
    if driven > limit * (1 + 1e-9):
        yield Finding("torque_limit", f"its torque reaches {driven:.4g} N m, above the limit of {limit:g} N m")
    if passive > allowed * (1 + 1e-9):
        yield Finding(
            "passive_torque",
            f"the passive joint {2 - robot.joint} has up to {passive:.4g} N m, above the {allowed:g} N m of {what}",
            refuses=not thrown and passive > PASSIVE * limit,
        )


def _is_simulated(period: np.ndarray, x: np.ndarray, slip: Float[np.ndarray, "steps 2"]) -> bool:
    """Whether velocities and angles agree as a simulation's do: no encoder's steps, and no noise."""
    speed = np.abs(x[1:, 2:]).max(axis=1)
    moving = (speed > MODERATE[0]) & (speed < MODERATE[1])
    error = np.abs(slip / period[:, None]).max(axis=1) / (CLEAN[0] + CLEAN[1] * period**2)
    return not moving.any() or bool(np.quantile(error[moving], 0.9) < 1)


def _positions(period: np.ndarray, slip: Float[np.ndarray, "steps 2"], scales: Scales) -> _Found:
    largest = float(np.abs(_in_windows(slip, period)).max())
    allowed = SLIP + SLIP_RATE * min(float(np.median(period)), COARSEST)
    if not largest <= scales.scaled(allowed, VELOCITY):
        yield Finding(
            "positions_against_velocities",
            f"its positions move by {largest:.3g} rad within {WINDOW:g} s beside what its velocities say: give rad "
            "and rad/s of one run",
            refuses=True,
        )


def _stretch(period: np.ndarray, x: Float[np.ndarray, "rows 4"]) -> _Found:
    moved = _in_windows(wrap_difference(np.diff(x[:, :2], axis=0)), period)
    # Velocities are those at a row, or differences to the row before or after it.
    after, before = (_in_windows(period[:, None] * rates, period) for rates in (x[1:, 2:], x[:-1, 2:]))
    squares = max(float(np.sum(moved**2)), 1 / LARGEST_NUMBER)
    ratios = [float(np.sum(moved * told)) / squares for told in (after, before, 0.5 * (after + before))]
    ratio = min(ratios, key=lambda each: abs(each - 1)) if moved.any() else 1.0
    if abs(ratio - 1) > STRETCH[0]:
        yield Finding(
            "stretched_velocities",
            f"its velocities are {ratio:.3g} times those of its angles: give both of one run",
            refuses=abs(ratio - 1) > STRETCH[1],
        )


def _balances(
    time: np.ndarray, angles: np.ndarray, rates: np.ndarray, u: np.ndarray, plants: _Plants, robot: Robot
) -> _Found:
    """Energy and momentum on the better plant."""
    level = lump(plants[1]).gravity1 + lump(plants[1]).gravity2
    most_work = WORK * 2 * level
    most_torques = level * np.roll(TORQUE, robot.joint)
    # A robot's torque acts from the next row on.
    late = np.concatenate([u[:1], u[:-1]])
    left = [unexplained(time, angles, rates, torques, plant) for plant in plants for torques in (u, late)]
    work, torques = min(left, key=lambda each: max(each.work / most_work, *(each.torques / most_torques)))
    remedy = "record the torques that acted, in N m, and name the plant"
    if not work <= most_work:
        text = f"its energy rises by {work:.3g} J more than its torques' work: {remedy}"
        yield Finding("unexplained_work", text, refuses=True)
    for joint in np.flatnonzero(~(torques <= most_torques)):
        text = f"joint {joint + 1} needs {torques[joint]:.3g} N m beside gravity and its torque: {remedy}"
        yield Finding("unexplained_torque", text, refuses=True)


def _noise(angles: np.ndarray, perfect: bool) -> _Found:
    gaps = [np.diff(np.unique(column)) for column in angles.T]
    if any(np.quantile(each, 0.1) < STEP for each in gaps if each.size):
        text = "its velocities have noise, its angles no encoder's steps: record true states, or those of a robot"
        yield Finding("noise", text)
    elif perfect:
        yield Finding(
            "measured", "its rows have noise, where the board is simulated: compare it on --board hardware"
        )


def _defect(
    period: np.ndarray, x: Float[np.ndarray, "rows 4"], u: Float[np.ndarray, "rows 2"], plants: _Plants, drawn: bool
) -> _Found:
    """Simulate every row of a simulation to the next, and keep the better plant."""
    # Longer periods are cut short and then ignored: every row stays, and the batch keeps its shape.
    step = np.minimum(period, COARSEST)
    scales, least = scales_of(plants[1]), LARGEST_NUMBER
    chunks = -(-len(step) // CHUNK)
    rows = [np.resize(each, (chunks, CHUNK, *each.shape[1:])) for each in (x[:-1], u[:-1], step)]
    for parameters in plants:
        with jax.enable_x64(True):
            # C.1 keeps one step, with friction as well.
            number = 1 if scales.time == 1 else stable_substeps(parameters, float(np.median(step)))
            steps = min(number, MOST_SUBSTEPS)
            after = np.concatenate([_steps(parameters, *chunk, steps) for chunk in zip(*rows, strict=True)])
        after = after[: len(step)]
        defect = np.where((period <= COARSEST)[:, None], x[1:, 2:] - after[:, 2:], 0.0)
        found = float(np.abs(_in_windows(defect, period)).max())
        least = min(least, found if math.isfinite(found) else LARGEST_NUMBER)
    if least > scales.scaled(DEFECT if drawn else TRACE, VELOCITY):
        yield Finding(
            "one_step_defect",
            f"its velocities change by {least:.3g} rad/s within {WINDOW:g} s beside what gravity and its torques "
            "explain: record the torques that acted, and name the plant",
            refuses=not drawn and least > scales.scaled(DEFECT, VELOCITY),
        )


def _in_windows(steps: Float[np.ndarray, "steps n"], period: np.ndarray) -> Float[np.ndarray, "windows n"]:
    """Sums over all windows of as many rows as usually take :data:`WINDOW`."""
    total, count = running(steps), rows_in(WINDOW, period)
    return total[count:] - total[:-count]
