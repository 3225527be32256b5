"""What is odd about a recording: what keeps its score from being the board's, and what no torque explains.

One balance decides what is physics. From each row the plant is simulated to the next. What is left of the velocity,
times the mass matrix, is an impulse that gravity, friction and the recorded torque do not explain. Noise cancels in
sums of impulses, an invented motion adds up to a mean torque over a window, or to energy from nowhere.

A finding that ``refuses`` leaves a recording without a score; the others warn. A real robot's recording has uneven
periods, noise, offsets, friction and the torques of its motors: the limits lie above all of 27 such recordings.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float

from ..common.checks import LARGEST_NUMBER
from ..dynamics.dynamics import UPRIGHT, wrap_difference
from ..dynamics.integrate import rk4_steps, stable_substeps
from ..identification.log_checks import SLOPE_WINDOW, slopes_of
from ..plant.equations import mass_entries
from ..plant.files import load_plant
from ..plant.plant import LEADERBOARD, Plant, Robot, lump
from ..plant.units import TIME, TORQUE, VELOCITY, scales_of
from .board import AbstractBoard
from .rollout import Trajectory
from .swing_up_board import MIN_SPAN, SwingUpBoard
from .uptime_board import MAX_GAP, UptimeBoard

TORQUE_ERROR = 0.1  # Share by which a robot's torques may be off: constants of motors are known no better
MAX_COMPENSATION = 0.5  # N m for the passive joint's friction, by the rules; recordings have 0.13
HANGING_TOLERANCE = (0.2, 1.0)
"""A start within this of hanging at rest hangs (rad, and rad/s on C.1); recordings have 0.001 rad and 0.1 rad/s."""

# Limits, and after the semicolon what the recordings have.
_MAX_GAP_RATIO = 10.0  # medians: a longer period is not jitter; 5
_UNEVEN_PERIODS = (0.5, 0.1)  # share of the median by which a period is uneven, and share of uneven periods; 0.01
_MIN_RATE = 30.0  # Hz, of a robot
_RATE_FACTOR, _RATE_SHARE = 2.0, 0.05  # factor and share by which the rate may differ from the board's
_PASSIVE_SHARE = 0.25  # of the torque limit
_SLIP, _SLIP_RATE, _MAX_STEP = 0.1, 8.0, 0.05  # rad in a window, and rad/s times a period (s) up to the third; half
_STRETCH = (0.005, 0.02)  # velocities too large or too small: a warning, a refusal; 0.0004, a CloudPendulum 0.003
_CLEAN_ERROR, _CLEAN_SPEEDS = (0.01, 200.0), (0.1, 10.0)  # rad/s, and rad/s³ times period²; at speeds (rad/s)
_ANGLE_STEP = 2e-5  # rad: nine of ten neighbouring angles of an encoder are further apart; 4.8e-5
_WINDOW, _LONG_WINDOW = 0.1, 0.5  # s in which faults add up; a push adds 0.4 N m to the longer one's mean
# Unexplained torque of the driven and the passive joint, as shares of gravity's on the level arm (3.8 N m on C.1):
# of clean rows, a warning (RK4: 2e-15, midpoint: 3e-4) and a refusal; of noisy rows, a refusal; 0.21 and 0.14.
_TRACE, _DEFECT, _NOISY_TORQUE = np.full(2, 1e-4), np.full(2, 0.019), np.array([0.5, 0.3])
_MAX_WORK = 0.2  # unexplained share of the energy from hanging to upright (7.6 J on C.1); 0.06
_SUBSTEPS, _CHUNK = 16, 5_000  # steps of RK4 to the next row; rows at a time, so that all lengths share one program

_steps = jax.jit(jax.vmap(rk4_steps, in_axes=(None, 0, 0, 0, None)), static_argnums=4)


@dataclass(frozen=True)
class Finding:
    """One thing that is odd about a recording: a name for programs, a text with the figure and the remedy."""

    name: str
    text: str
    refuses: bool = False  # The recording gets no score; otherwise this is a warning


def examine(
    trajectory: Trajectory, robot: Robot, board: AbstractBoard, plant: Plant = LEADERBOARD
) -> list[Finding]:
    """Look at a trajectory that :func:`~swingup.benchmark.judge.score` accepts.

    The plant is the recording's, with or without its friction; the leaderboards' has that of design C.1.
    """
    plants = plant.frictionless().driven(robot), load_plant("C.1") if plant == LEADERBOARD else plant
    time, x, u = (np.asarray(rows, np.float64) for rows in (trajectory.time, trajectory.x, trajectory.u))
    with np.errstate(all="ignore"):  # absurd values overflow and become findings
        period, clean = np.diff(time), _is_clean(np.diff(time), x)
        found = [*_periods(time, period, board, clean), *_limits(x[0], u, robot, board, plants)]
        found += _velocities(period, x, scales_of(plants[1]).scaled(1.0, VELOCITY))
        if not clean:
            found += _noise(x[:, :2], board.perfect)
            # Noise on a robot's velocities would hide a fault.
            x = _smooth(time, x, plant)
        return [*found, *_balance(period, x, u, plants, robot, clean, drawn=board.domain is not None)]


def possible_runs(trajectory: Trajectory, plant: Plant) -> list[Trajectory]:
    """Runs that a recording with noise may be of: the torques off by 10 %, the velocities measured or smoothed.

    A recording without noise is of one run: the list is then empty.
    """
    time, x, u = (np.asarray(rows, np.float64) for rows in (trajectory.time, trajectory.x, trajectory.u))
    with np.errstate(all="ignore"):
        if _is_clean(np.diff(time), x):
            return []
        states = x, _smooth(time, x, plant)
    factors = 1 - TORQUE_ERROR, 1.0, 1 + TORQUE_ERROR
    return [Trajectory(time, each, factor * u) for each in states for factor in factors]


def _smooth(time: np.ndarray, x: Float[np.ndarray, "rows 4"], plant: Plant) -> Float[np.ndarray, "rows 4"]:
    """The states with the slopes of their angles as velocities."""
    window = scales_of(plant).scaled(SLOPE_WINDOW, TIME)
    return np.column_stack([x[:, :2], slopes_of(time, np.unwrap(x[:, :2], axis=0), window)])


def _is_clean(period: np.ndarray, x: Float[np.ndarray, "rows 4"]) -> bool:
    """Whether velocities and angles agree as a simulation's do: no encoder's steps, and no noise."""
    speed = np.abs(x[1:, 2:]).max(axis=1)
    moving = (speed > _CLEAN_SPEEDS[0]) & (speed < _CLEAN_SPEEDS[1])
    error = np.abs(_slip(period, x) / period[:, None]).max(axis=1) / (_CLEAN_ERROR[0] + _CLEAN_ERROR[1] * period**2)
    return not moving.any() or bool(np.quantile(error[moving], 0.9) < 1)


def _periods(time: np.ndarray, period: np.ndarray, board: AbstractBoard, clean: bool) -> Iterator[Finding]:
    scored = isinstance(board, SwingUpBoard)
    span, usual, longest = float(time[-1] - time[0]), float(np.median(period)), float(period.max())
    if span < MIN_SPAN * board.duration:
        text = f"it spans {span:.4g} s of {board.duration:g} s: below {MIN_SPAN:.0%} "
        yield Finding("short_span", text + ("it scores 0" if scored else "the rest counts as down"))
    elif scored and span > (2.0 - MIN_SPAN) * board.duration:
        text = f"it spans {span:.4g} s of {board.duration:g} s, and all of it is scored: keep the board's time"
        yield Finding("long_span", text)
    uneven = float(np.mean(np.abs(period - usual) > _UNEVEN_PERIODS[0] * usual))
    if longest > _MAX_GAP_RATIO * usual or uneven > _UNEVEN_PERIODS[1]:
        text = f"its periods reach {longest:.4g} s, their median is {usual:.4g} s, {uneven:.0%} are far from it: "
        text += f"record all rows, at most {MAX_GAP:g} s apart"
        yield Finding("irregular_periods", text, refuses=scored and longest > MAX_GAP)
    rate = 1 / board.dt
    slowest, fastest = rate / _RATE_FACTOR if clean else _MIN_RATE, rate * _RATE_FACTOR
    # The margins are for rounding.
    if not slowest * (1 - 1e-6) <= 1 / usual <= fastest * (1 + 1e-6):
        text = f"it has {1 / usual:.4g} Hz; a score needs {slowest:g} to {fastest:g} Hz: record it at {rate:g} Hz"
        yield Finding("rate", text, refuses=True)
    elif scored and abs(board.dt / usual - 1) > _RATE_SHARE:  # the uptime compares no row with the next
        text = f"it has {1 / usual:.4g} Hz, where the board has {rate:g} Hz: the torque smoothness, which compares "
        yield Finding("rate", text + "one row with the next, is not the board's")


def _limits(
    start: np.ndarray, u: np.ndarray, robot: Robot, board: AbstractBoard, plants: tuple[Plant, Plant]
) -> Iterator[Finding]:
    """How a run begins, and what its motors can do."""
    place = "hanging"
    if isinstance(board, SwingUpBoard) and board.lean is not None:
        start, place = start - UPRIGHT, "upright"
    anywhere = isinstance(board, UptimeBoard) and board.cell is not None
    angle, speed = float(np.abs(wrap_difference(start[:2])).max()), float(np.abs(start[2:]).max())
    # Negated, here and below: a NaN from overflow must count as a finding.
    if not (angle <= HANGING_TOLERANCE[0] and speed <= scales_of(plants[1]).scaled(HANGING_TOLERANCE[1], VELOCITY)):
        text = f"it starts {angle:.3g} rad off {place}, at {speed:.3g} rad/s: record from {place} at rest"
        yield Finding("not_hanging", text, refuses=not anywhere)
    driven, passive = np.roll(np.abs(u).max(axis=0) / (1 + 1e-9), -robot.joint)  # the margin is for rounding
    limit, scored = float(max(plants[0].tl1, plants[0].tl2)), isinstance(board, SwingUpBoard)
    if driven > limit:
        yield Finding("torque_limit", f"its torque reaches {driven:.4g} N m, above the limit of {limit:g} N m")
    allowed = scales_of(plants[1]).scaled(MAX_COMPENSATION, TORQUE) if scored else limit
    if passive > allowed:
        refuses = scored and bool(passive > _PASSIVE_SHARE * limit)
        most = f"{allowed:g} N m of the rules' friction compensation" if scored else f"{allowed:g} N m of its motor"
        text = f"the passive joint {2 - robot.joint} has up to {passive:.4g} N m, above the {most}"
        yield Finding("passive_torque", text + ("; is it the other robot's run?" if refuses else ""), refuses)


def _velocities(period: np.ndarray, x: Float[np.ndarray, "rows 4"], scale: float) -> Iterator[Finding]:
    largest = float(np.abs(_sums(_slip(period, x), period, _WINDOW)).max())
    if not largest <= scale * (_SLIP + _SLIP_RATE * min(float(np.median(period)), _MAX_STEP)):
        text = f"its positions move by {largest:.3g} rad within {_WINDOW:g} s beside what its velocities say"
        yield Finding("positions_against_velocities", f"{text}: give rad and rad/s of one run", refuses=True)
    # Velocities are those at a row, or differences to the row before or after it.
    moved = _sums(wrap_difference(np.diff(x[:, :2], axis=0)), period, _WINDOW)
    after, before = (_sums(period[:, None] * rates, period, _WINDOW) for rates in (x[1:, 2:], x[:-1, 2:]))
    squares = max(float(np.sum(moved**2)), 1 / LARGEST_NUMBER)
    ratios = [float(np.sum(moved * each)) / squares for each in (after, before, 0.5 * (after + before))]
    ratio = min(ratios, key=lambda each: abs(each - 1)) if moved.any() else 1.0
    if abs(ratio - 1) > _STRETCH[0]:
        text = f"its velocities are {ratio:.3g} times those of its angles: give both of one run"
        yield Finding("stretched_velocities", text, refuses=abs(ratio - 1) > _STRETCH[1])


def _noise(angles: Float[np.ndarray, "rows 2"], perfect: bool) -> Iterator[Finding]:
    gaps = [np.diff(np.unique(column)) for column in angles.T]
    if any(np.quantile(each, 0.1) < _ANGLE_STEP for each in gaps if each.size):
        text = "its velocities have noise, its angles no encoder's steps: record true states, or those of a robot"
        yield Finding("noise", text)
    elif perfect:
        text = "its rows have noise, where the board is simulated: compare it on --board hardware"
        yield Finding("measured", text)


def _balance(
    period: np.ndarray,
    x: np.ndarray,
    u: np.ndarray,
    plants: tuple[Plant, Plant],
    robot: Robot,
    clean: bool,
    drawn: bool,
) -> Iterator[Finding]:
    """What no torque explains, on the plant without friction or with it, whichever leaves less."""
    warning, refusal = (_TRACE, _DEFECT) if clean else (_NOISY_TORQUE, _NOISY_TORQUE)
    if clean and drawn:  # which plant was drawn is not known
        warning, refusal = _DEFECT, _NOISY_TORQUE
    warning, refusal = (np.roll(each, robot.joint) for each in (warning, refusal))
    level = lump(plants[1]).gravity1 + lump(plants[1]).gravity2
    # A robot's torque acts from the next row on.
    torques = [u] if clean else [u, np.concatenate([u[:1], u[:-1]])]
    window = _WINDOW if clean and not drawn else _LONG_WINDOW
    shares = [_unexplained(period, x, each, plant, window) / level for plant in plants for each in torques]
    work, *joints = min(shares, key=lambda each: max(0.5 * each[0] / _MAX_WORK, *each[1:] / warning))
    remedy = "record the torques that acted, in N m, and name the plant"
    if not 0.5 * work <= _MAX_WORK:
        text = f"its energy rises by {work * level:.3g} J more than its torques' work: {remedy}"
        yield Finding("unexplained_work", text, refuses=True)
    for joint, share in enumerate(joints):
        if not share <= warning[joint]:
            text = f"joint {joint + 1} needs {share * level:.3g} N m beside gravity and its torque: {remedy}"
            yield Finding("unexplained_torque", text, refuses=bool(share > refusal[joint]))


def _unexplained(
    period: np.ndarray, x: np.ndarray, u: np.ndarray, plant: Plant, window: float
) -> Float[np.ndarray, "3"]:
    """Largest unexplained rise of the energy since the start (J), and each joint's largest torque (N m)."""
    # Longer periods are cut short and then ignored: every row stays, and the batch keeps its shape.
    step, chunks = np.minimum(period, _MAX_STEP), -(-len(period) // _CHUNK)
    rows = [np.resize(each, (chunks, _CHUNK, *each.shape[1:])) for each in (x[:-1], u[:-1], step)]
    with jax.enable_x64(True):
        # C.1 keeps one step, with friction as well.
        number = 1 if scales_of(plant).time == 1 else min(_SUBSTEPS, stable_substeps(plant, float(np.median(step))))
        after = np.concatenate([_steps(plant, *chunk, number) for chunk in zip(*rows, strict=True)])[: len(step)]
    left = np.where((period <= _MAX_STEP)[:, None], x[1:, 2:] - after[:, 2:], 0.0)
    p, (q1, q2) = lump(plant), x[:, :2].T
    m11, m12, m22 = np.broadcast_arrays(*mass_entries(p, np.cos(q2)))
    masses = np.stack([m11, m12, m12, m22], axis=-1).reshape(-1, 2, 2)
    impulse = np.einsum("kij,kj->ki", masses[1:], left)
    # Friction may take energy, whatever its size: what counts is the rise beyond the torques' work.
    kinetic = 0.5 * np.einsum("ki,kij,kj->k", x[:, 2:], masses, x[:, 2:])
    energy = kinetic - p.gravity1 * np.cos(q1) - p.gravity2 * np.cos(q1 + q2)
    energy[1:] -= np.cumsum(np.sum(u[:-1] * wrap_difference(np.diff(x[:, :2], axis=0)), axis=1))
    found = np.array([energy.max() - energy[0], *np.abs(_sums(impulse, period, window)).max(axis=0) / window])
    return np.where(np.isfinite(found), found, LARGEST_NUMBER)


def _slip(period: np.ndarray, x: Float[np.ndarray, "rows 4"]) -> Float[np.ndarray, "steps 2"]:
    """What the velocities of two rows do not explain of the angles between (rad), by the trapezoidal rule."""
    return wrap_difference(np.diff(x[:, :2], axis=0) - 0.5 * period[:, None] * (x[:-1, 2:] + x[1:, 2:]))


def _sums(steps: Float[np.ndarray, "steps n"], period: np.ndarray, window: float) -> Float[np.ndarray, "windows n"]:
    """Over all windows of as many rows as usually take a time (s)."""
    total = np.concatenate([np.zeros_like(steps[:1]), np.cumsum(steps, axis=0)])
    count = min(len(period), max(1, round(window / float(np.median(period)))))
    return total[count:] - total[:-count]
