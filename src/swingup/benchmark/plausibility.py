"""Warnings about a recording: what this pendulum cannot do, and what keeps its score from being the board's.

The warnings do not change the score: a real robot's recording has uneven periods, noise, offsets, friction and the
torques of its motors. The limits lie above everything found in 27 recordings of the real robot, and below what a
log with invented times, positions, velocities or torques shows.

Sums over a window of 0.1 s stand for single rows where noise would hide the fault: noise cancels, a fault adds up.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float

from ..common.checks import LARGEST
from ..dynamics.integrate import rk4_steps, stable_substeps
from ..plant.plant import LEADERBOARD, Plant, load_plant
from ..plant.robots import Robot
from ..plant.units import scales_of
from .board import AbstractBoard
from .criteria import SHARE
from .rollout import Trajectory
from .swing_up_board import SwingUpBoard

COMPENSATION = 0.5
"""Torque that the rules leave the passive joint's motor, for the compensation of its friction (N m)."""

HANGING = (0.2, 1.0)
"""A start within this of hanging at rest hangs (rad, and rad/s on C.1); recordings have 0.001 rad and 0.1 rad/s."""

LONGEST_PERIOD = 10.0
"""A period longer than this many median periods is no jitter; recordings have up to 5."""

UNEVEN = (0.5, 0.1)
"""A period is uneven if it differs from the median by more than the first share of it.

More than the second share of uneven periods is a warning; recordings have a share of 0.01."""

RATE = 0.05
"""A rate this far from the rules', relatively, changes the smoothness noticeably."""

WINDOW = 0.1
"""Length of the windows in which faults add up (s)."""

SLIP = 0.1
"""Positions and velocities may part by this in a window (rad), and by :data:`SLIP_RATE` times the period."""
SLIP_RATE = 8.0
"""rad/s; coarse rows know less of the velocity between them: recordings at 33 Hz have 0.26 rad, at 400 Hz 0.03."""

CLEAN = 0.01
"""Positions and velocities that agree this well in nine of ten rows (rad/s) come from a simulation."""
DEFECT = {True: 1.0, False: 3.0}
"""Unexplained change of velocity in a window (rad/s) on C.1: the largest of a simulation, the RMS of a recording.

A simulation of one of the two plants has less than 1e-6; recordings have an RMS of up to 1.7."""

COARSEST = 0.05
"""Longer periods are not simulated in one step (s): explicit steps would not be accurate."""

MOST_SUBSTEPS = 16
"""Steps of RK4 from a row to the next that are compiled, where friction is stiff."""

_steps = jax.jit(jax.vmap(rk4_steps, in_axes=(None, 0, 0, 0, None)), static_argnums=4)


@dataclass(frozen=True)
class Finding:
    """One thing that is odd about a recording: a warning."""

    name: str
    """For programs."""
    text: str
    """For readers, with the figure."""


def examine(
    trajectory: Trajectory, robot: Robot, board: AbstractBoard, plant: Plant = LEADERBOARD
) -> list[Finding]:
    """Look at a trajectory that :func:`~swingup.benchmark.score.score` accepts.

    Args:
        trajectory: NumPy arrays in float64.
        robot: which joint is driven.
        board: a board that scores rows.
        plant: the recording's pendulum, with or without its friction; the leaderboards' has that of design C.1.
    """
    plants = _possible_plants(plant, robot)
    scored = isinstance(board, SwingUpBoard)
    time, x, u = (np.asarray(rows, np.float64) for rows in (trajectory.time, trajectory.x, trajectory.u))
    period = np.diff(time)
    with np.errstate(all="ignore"):  # absurd values overflow and become findings
        slip = _slip(period, x)
        found = [
            *_short_span(time, board.duration, "it scores 0" if scored else "the rest counts as down"),
            *_periods(period),
            # The uptime compares no row with the next, and its throws drive both joints.
            *(_rate(period, board.dt) if scored else ()),
            *_start(x[0], HANGING[1] * scales_of(plants[1]).velocity),
            *_torques(u, robot, float(max(plants[0].tl1, plants[0].tl2)), thrown=not scored),
            *_positions(period, slip),
            *_defect(period, x, u, slip, plants),
        ]
    return [Finding(name, text) for name, text in found]


_Found = Iterator[tuple[str, str]]


def _possible_plants(found: Plant, robot: Robot) -> tuple[Plant, Plant]:
    """A simulated recording has the frictionless plant, a robot's has friction."""
    if found == LEADERBOARD:
        return found.driven(robot), load_plant("C.1")
    return found.frictionless().driven(robot), found


def _short_span(time: np.ndarray, duration: float, consequence: str) -> _Found:
    span = time[-1] - time[0]
    if span < SHARE * duration:
        yield "short_span", f"it spans {span:.4g} s of {duration:g} s: below {SHARE:.0%} {consequence}"


def _periods(period: np.ndarray) -> _Found:
    usual, longest = float(np.median(period)), float(period.max())
    uneven = float(np.mean(np.abs(period - usual) > UNEVEN[0] * usual))
    if longest > LONGEST_PERIOD * usual or uneven > UNEVEN[1]:
        yield (
            "irregular_periods",
            f"its periods reach {longest:.4g} s, their median is {usual:.4g} s, and {uneven:.0%} are far from that",
        )


def _rate(period: np.ndarray, dt: float) -> _Found:
    usual = float(np.median(period))
    if abs(dt / usual - 1) > RATE:
        yield (
            "rate",
            f"it has {1 / usual:.4g} Hz, where the board has {1 / dt:g} Hz: the torque smoothness, which "
            "compares one row with the next, is not the board's",
        )


def _start(x: Float[np.ndarray, "4"], fastest: float) -> _Found:
    angle, speed = float(np.abs(_wrapped(x[:2])).max()), float(np.abs(x[2:]).max())
    # Negated, here and below: a NaN from overflow must count as a finding.
    if not (angle <= HANGING[0] and speed <= fastest):
        yield "not_hanging", f"it starts {angle:.3g} rad off hanging, at {speed:.3g} rad/s"


def _torques(u: Float[np.ndarray, "rows 2"], robot: Robot, limit: float, thrown: bool) -> _Found:
    largest = np.abs(u).max(axis=0)
    driven, passive = float(largest[robot.joint]), float(largest[1 - robot.joint])
    allowed = limit if thrown else COMPENSATION
    what = "the limit of its motor" if thrown else "the rules' friction compensation"
    # The margin is for rounding.
    if driven > limit * (1 + 1e-9):
        yield "torque_limit", f"its torque reaches {driven:.4g} N m, above the limit of {limit:g} N m"
    if passive > allowed * (1 + 1e-9):
        yield (
            "passive_torque",
            f"the passive joint {2 - robot.joint} has up to {passive:.4g} N m, above the {allowed:g} N m of {what}",
        )


def _slip(period: np.ndarray, x: Float[np.ndarray, "rows 4"]) -> Float[np.ndarray, "steps 2"]:
    """Change of the angles that the velocities of its two rows do not explain (rad), by the trapezoidal rule."""
    return _wrapped(np.diff(x[:, :2], axis=0) - 0.5 * period[:, None] * (x[:-1, 2:] + x[1:, 2:]))


def _positions(period: np.ndarray, slip: Float[np.ndarray, "steps 2"]) -> _Found:
    usual = float(np.median(period))
    largest = _largest(_in_windows(slip, period))
    if not largest <= SLIP + SLIP_RATE * min(usual, COARSEST):
        yield (
            "positions_against_velocities",
            f"its positions move by {largest:.3g} rad within {WINDOW:g} s beside what its velocities say",
        )


def _defect(
    period: np.ndarray,
    x: Float[np.ndarray, "rows 4"],
    u: Float[np.ndarray, "rows 2"],
    slip: Float[np.ndarray, "steps 2"],
    plants: tuple[Plant, Plant],
) -> _Found:
    """Simulate every row to the next, without friction and with it, and keep the better plant."""
    clean = bool(np.quantile(np.abs(slip / period[:, None]).max(axis=1), 0.9) < CLEAN)
    # Longer periods are cut short and then ignored: every row stays, and the batch keeps its shape.
    step = np.minimum(period, COARSEST)
    speed, least = scales_of(plants[1]).velocity, LARGEST
    for parameters in plants:
        with jax.enable_x64(True):
            # C.1 keeps one step, with friction as well.
            number = 1 if speed == 1 else stable_substeps(parameters, float(np.median(step)))
            after = np.asarray(_steps(parameters, x[:-1], u[:-1], step, min(number, MOST_SUBSTEPS)))
        defect = np.where((period <= COARSEST)[:, None], x[1:, 2:] - after[:, 2:], 0.0)
        sums = _in_windows(defect, period)
        found = _largest(sums) if clean else float(np.sqrt(np.mean(sums**2)))
        least = min(least, found if math.isfinite(found) else LARGEST)
    if least > DEFECT[clean] * speed:
        size = f"{least:.3g} rad/s{'' if clean else ' (RMS)'}"
        yield (
            "one_step_defect",
            f"its velocities change by {size} within {WINDOW:g} s beside what gravity and its torques explain",
        )


def _in_windows(steps: Float[np.ndarray, "steps n"], period: np.ndarray) -> Float[np.ndarray, "windows n"]:
    """Sums over all windows of as many rows as usually take :data:`WINDOW`."""
    count = min(len(steps), max(1, round(WINDOW / float(np.median(period)))))
    total = np.concatenate([np.zeros_like(steps[:1]), np.cumsum(steps, axis=0)])
    return total[count:] - total[:-count]


def _largest(values: np.ndarray) -> float:
    return float(np.abs(values).max())


def _wrapped(angle: np.ndarray) -> np.ndarray:
    """Angles in [-π, π): logs may wrap theirs."""
    return (angle + math.pi) % (2 * math.pi) - math.pi
