"""What a log shows before any model is fitted.

Clocks that restart, encoders that wrap, resets and dropouts are repaired or cut. Joints that rest and times
that are not in seconds are refused; motors that saturate and gaps are warnings.
"""

import itertools
import re
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ..common.columns import UNITS, completed
from ..common.errors import SwingupError
from ..common.table import spread_evenly
from ..policy.guard import DEAD_TRAVEL

TURNS = (1.0, 2.0 * np.pi, 360.0, *(float(2**k) for k in range(8, 21)), 1000.0, 2000.0, 4000.0, 10000.0)
"""Angles at which encoders wrap, in the units of logs."""
FILLED_SHARE = 0.7  # share of a turn that angles must fill to count as wrapped

NEAR_ROWS, NEAR_TIME = 4, 0.02  # rows and time (s) to each side whose median slope predicts the next angle
MINIMUM_JUMP, ACCELERATION = 0.15, 400.0
"""Minimum jump (rad), and the acceleration (rad/s²) that explains more: smaller ones are noise or motion."""
UNLIKELY_DEVIATIONS = 20.0  # a larger jump, in median deviations, is not noise
MINIMUM_PIECE = 0.1  # a shorter piece between two jumps (s) is a dropout


def one_clock(
    time: Float[np.ndarray, "rows"], longest: float, pause: float
) -> tuple[Bool[np.ndarray, "rows"], Float[np.ndarray, "rows"], int, int]:
    """Times that increase, for episodes that each have their own clock, in which rows may come late or twice.

    A time between rows beyond ``longest`` (s) is a gap; ``pause`` (s) separates two episodes of the result: the
    rows to keep, their times, the number of restarts, and the number of rows whose times were spread.
    """
    steps = np.diff(time)
    restarts = np.flatnonzero(steps < -longest) + 1
    pieces, offset, spread = [], 0.0, 0
    keep = np.zeros(len(time), bool)
    for start, end in itertools.pairwise([0, *restarts.tolist(), len(time)]):
        own = time[start:end]
        cuts = np.flatnonzero(np.diff(own) > longest) + 1
        parts = [spread_evenly(part) for part in np.split(own, cuts)]
        spread += sum(len(part) for part in parts if part is not None)
        own = np.concatenate(
            [old if new is None else new for new, old in zip(parts, np.split(own, cuts), strict=True)]
        )
        own = own - own[0] + offset
        keep[start:end] = np.concatenate([[True], own[1:] > np.maximum.accumulate(own)[:-1]])
        pieces.append(own[keep[start:end]])
        offset = pieces[-1][-1] + pause
    return keep, np.concatenate(pieces), len(restarts), spread


def continued(angles: Float[np.ndarray, "rows 2"]) -> tuple[Float[np.ndarray, "rows 2"], float | None]:
    """Angles without the jumps of an encoder that wraps, and where it wraps; as they are, if they do not.

    Angles that wrap lie within one turn, which they nearly fill, and jump by more than half of it.
    """
    reach, steps = np.ptp(angles, axis=0), np.abs(np.diff(angles, axis=0)).max(axis=0)
    for turn in TURNS:
        wraps = (reach <= turn * (1 + 1e-6)) & (reach > FILLED_SHARE * turn) & (steps > FILLED_SHARE * turn)
        if np.any(wraps):
            # The other joint wraps at the same angle, where it does; a difference of two such angles jumps as well.
            also = (reach <= turn * (1 + 1e-6)) | (steps > FILLED_SHARE * turn)
            return np.where(also, np.unwrap(angles, period=turn, axis=0), angles), turn
    return angles, None


def lone_zeros(angles: Float[np.ndarray, "rows 2"]) -> Bool[np.ndarray, "rows"]:
    """Rows of exact zeros between rows far from them, with which some loops fill a lost sample."""
    far = np.abs(angles).max(axis=1) > MINIMUM_JUMP
    between = np.append(False, far[:-1]) & np.append(far[1:], False)
    return np.asarray((angles == 0.0).all(axis=1) & between)


def cut_episodes(
    time: Float[np.ndarray, "rows"], q: Float[np.ndarray, "rows 2"], fresh: Bool[np.ndarray, "rows"], longest: float
) -> tuple[Bool[np.ndarray, "rows"], Float[np.ndarray, "rows"], list[str]]:
    """Cut a log where its angles jump: rows to keep, times with a gap at each cut, and notes.

    Fresh rows have a measurement of their own. A time between rows beyond ``longest`` (s) is a gap.
    """
    keep, dropped = np.ones(len(time), bool), 0
    rows = np.flatnonzero(fresh)
    for _ in range(3):  # a dropout hides the jumps beside it
        jumps = _jumps(time[rows], q[rows], longest)
        bounds = [0, *(jumps + 1).tolist(), len(rows)]
        dropouts = [
            np.arange(start, end)
            for start, end in itertools.pairwise(bounds)
            if len(bounds) > 2 and time[rows[end - 1]] - time[rows[start]] < MINIMUM_PIECE
        ]
        if not dropouts:
            break
        out = np.concatenate(dropouts)
        keep[rows[out]] = False
        dropped += len(out)
        rows = np.delete(rows, out)
    jumps = _jumps(time[rows], q[rows], longest)
    shifted = time.copy()
    for jump in jumps:
        # More than the longest step between rows, so that all that follows takes it for a gap.
        shifted[rows[jump] + 1 :] += 1.5 * longest
    notes = []
    if dropped:
        notes.append(f"{dropped} rows are dropouts, whose angles jump away and back: they are left out")
    if len(jumps):
        first = ", ".join(f"{time[rows[jump + 1]]:.3g}" for jump in jumps[:3])
        notes.append(
            f"the angles jump {len(jumps)} times (at {first}{' ...' if len(jumps) > 3 else ''} s): cut there"
        )
    return keep, shifted, notes


def _jumps(time: np.ndarray, q: np.ndarray, longest: float) -> np.ndarray:
    """Numbers of the rows after which an angle jumps, as no motion does; gaps in time do not count."""
    if len(time) < 4 * NEAR_ROWS:
        return np.zeros(0, int)
    steps = np.diff(time)
    near = int(np.clip(NEAR_TIME / np.median(steps), 1, NEAR_ROWS))
    slopes = np.diff(q, axis=0) / steps[:, None]
    padded = np.pad(slopes, ((near, near), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * near + 1, axis=0)
    # Medians, since one bad angle makes two slopes beside it wrong.
    before, after = np.median(windows[..., :near], axis=-1), np.median(windows[..., near + 1 :], axis=-1)
    jumps = np.abs(slopes - 0.5 * (before + after)) * steps[:, None]
    threshold = np.maximum(
        MINIMUM_JUMP + ACCELERATION * steps[:, None] ** 2, UNLIKELY_DEVIATIONS * 1.48 * np.median(jumps, axis=0)
    )
    # Where the pendulum turns quickly, slopes differ from one side to the other.
    far = jumps > threshold + 2.0 * np.abs(before - after) * steps[:, None]
    return np.flatnonzero(far.any(axis=1) & (steps <= longest))


MINIMUM_DURATION = 0.8  # minimum duration of a log (s): a window of prediction lasts 0.5 s
MINIMUM_ROWS = 6  # rows with a measurement of their own that a smoother needs: its cubic has four coefficients
MINIMUM_POSITIONS = 20
"""Different pairs of angles that a log needs, for nine base parameters and four of the loop."""
MAXIMUM_PERIOD = 0.1  # maximum median period (s): a pendulum moves too far between rows
SLOW_PERIOD = 0.0315  # Median period (s) from which parameters are biased: those of C.1 by a quarter at 20 Hz
USUAL_PERIODS = (2e-4, 0.06)  # range of the loops' periods (s), which tells the unit of a time
FASTEST = 100.0  # rad/s; CloudPendulum stops at 50, RealAIGym's robots at 20
MINIMUM_MOTION = 2e-3  # minimum range of an angle (rad)
SATURATED_SHARE = 0.25  # share of rows at the largest torque from which a motor counts as saturated
GAP, GAP_PERIODS = 0.06, 20.0
"""A longer time between rows, in s and in median periods, is a gap that no prediction crosses."""
SLOPE_WINDOW = 0.02  # time over which angles give velocities (s)


def check_time(name: str, time: Float[np.ndarray, "rows"], title: str, columns: Sequence[str] = ()) -> None:
    """Refuse a time that is not in seconds, and a log that is too short or too slow.

    The title is the word of ``--columns`` for the time, without a unit; ``columns`` are the words given.
    """
    steps = np.diff(time)
    period = float(np.median(steps))
    if not steps.all():  # rows after a huge time have the same one, to rounding
        raise SwingupError(
            f"{name} has a time of {time[-1]:.3g} s after its start, too large for a period: remove that row"
        )
    # A time in other units shows as a period that no loop has.
    low, high = USUAL_PERIODS
    unit = next((each for each, size in UNITS["time"].items() if low <= period * size <= high), "s")
    given = any(re.fullmatch(r"time=[-+.\deE]+", word) for word in columns)  # a period, in seconds
    if period > MAXIMUM_PERIOD and unit != "s" and not given:
        words = completed([f"{title}:{unit}"], columns)
        counter = "; if it counts rows, write time=PERIOD (s) instead" if np.all(steps == 1.0) else ""
        raise SwingupError(
            f"{name}: rows are {period:g} s apart (median): the time looks like {unit}; read it with "
            f"--columns {words}{counter}"
        )
    check_rate(name, period)
    if time[-1] < MINIMUM_DURATION:
        raise SwingupError(
            f"{name} lasts {time[-1]:g} s: at least {MINIMUM_DURATION:g} s are needed, with time in seconds"
        )


def check_rate(name: str, period: float) -> None:
    """Refuse measurements whose median period (s) is too long."""
    if period > MAXIMUM_PERIOD:
        raise SwingupError(
            f"{name}: rows are {period:g} s apart (median), too slow for a pendulum: record at 33 Hz or faster"
        )


def check_fresh(name: str, fresh: Bool[np.ndarray, "rows"], q: Float[np.ndarray, "rows 2"]) -> None:
    """Refuse a log with too few measurements, or too few positions."""
    count = int(np.count_nonzero(fresh))
    if count < MINIMUM_ROWS:
        raise SwingupError(
            f"{name} has {count} different rows, the others repeat the one before: use {MINIMUM_ROWS} or more"
        )
    # Rounded angles repeat, and repeated equations add no information.
    positions = len(np.unique(q, axis=0))
    if positions < MINIMUM_POSITIONS:
        raise SwingupError(
            f"{name} has only {positions} different pairs of angles in {len(q)} rows: record a motion, with all "
            "digits of the angles"
        )


def check_motion(name: str, q: Float[np.ndarray, "rows 2"]) -> None:
    """Refuse a joint that never moves."""
    for joint, reach in enumerate(np.ptp(q, axis=0), start=1):
        if reach < MINIMUM_MOTION:
            raise SwingupError(
                f"{name}: joint {joint} never moves (its angle stays within {reach:.2g} rad): check the encoder, "
                "or leave this log out"
            )


def check_stuck(name: str, time: Float[np.ndarray, "rows"], q: Float[np.ndarray, "rows 2"]) -> None:
    """Refuse an encoder that keeps its value while the other joint goes far: its coupling would move this one."""
    steps = np.diff(time)
    apart = steps > longest_step(float(np.median(steps)))
    for joint in (0, 1):
        ends = [0, *(np.flatnonzero(apart | (np.diff(q[:, joint]) != 0)) + 1).tolist(), len(q)]
        for start, end in itertools.pairwise(ends):
            if end - start < 3:
                continue
            travel = float(np.ptp(q[start:end, 1 - joint]))
            # A joint that seems faster has angles in another unit, which is named later.
            if DEAD_TRAVEL < travel < FASTEST * float(time[end - 1] - time[start]):
                raise SwingupError(
                    f"{name}: angle {joint + 1} stays at {q[start, joint]:.4g} rad from {time[start]:.3g} to "
                    f"{time[end - 1]:.3g} s, while joint {2 - joint} moves by {travel:.3g} rad: is its encoder "
                    "stuck? Leave these rows out"
                )


def find_turns(first: Float[np.ndarray, "2"]) -> list[str]:
    """Notes on encoders whose first angles are whole turns from 0."""
    return [
        f"angle {joint} begins {turns:g} turns from 0: set its encoder to 0 there before a run, since the safety "
        "guard counts turns"
        for joint, (angle, turns) in enumerate(zip(first, np.round(first / (2 * np.pi)), strict=True), start=1)
        if turns and abs(angle - 2 * np.pi * turns) < np.pi / 2  # not where it begins upright
    ]


def find_warnings(
    time: Float[np.ndarray, "rows"],
    u: Float[np.ndarray, "rows 2"],
    measured: Float[np.ndarray, "rows 2"] | None,
    fresh: Bool[np.ndarray, "rows"],
) -> list[str]:
    """Warnings about a log that can be used, one line for each fault."""
    found = []
    periods = np.diff(time)
    period, longest = float(np.median(periods)), float(periods.max())
    if longest > longest_step(period):
        at = float(time[int(np.argmax(periods))])
        found.append(f"time jumps by {longest:.3g} s at {at:.3g} s: no prediction crosses the gap")
    if (apart := float(np.median(np.diff(time[fresh])))) > SLOW_PERIOD:
        found.append(
            f"angles are {apart:.3g} s apart: below 33 Hz parameters come out wrong, by a quarter at 20 Hz"
        )
    if not np.any(u):
        found.append("the torques are all zero: it counts as a free fall")
    for joint in (0, 1):
        peak = float(np.abs(u[:, joint]).max())
        # A torque that stands at its limit excites nothing while it stands.
        share = float(np.mean(np.abs(u[:, joint]) > 0.995 * peak)) if peak > 0 else 0.0
        if peak > 0 and np.ptp(u[:, joint]) == 0:
            found.append(f"torque {joint + 1} is {u[0, joint]:.3g} N m in every row: check its column")
        elif share > SATURATED_SHARE:
            found.append(f"torque {joint + 1} stands at ±{peak:.3g} N m in {share:.0%} of the rows: saturated")
        if measured is not None and peak > 0:
            delivered = float(np.nanmax(np.abs(measured[:, joint]), initial=0.0))
            at_most = float(np.mean(np.abs(measured[:, joint]) > 0.98 * delivered))
            # A motor that saturates stands at its peak; one that is slow passes through it.
            if delivered < 0.8 * peak and at_most > 0.05:
                shown = f"{delivered:.3g} of {peak:.3g} N m"
                found.append(f"motor {joint + 1} delivers at most {shown}: clip the log's commands to that")
    if (repeated := float(np.mean(~fresh))) > 0.05:
        found.append(f"{repeated:.0%} of the rows repeat the one before: they are left out")
    return found


def longest_step(period: float) -> float:
    """The longest time between rows that does not count as a gap (s), for a median ``period`` (s)."""
    return max(GAP, GAP_PERIODS * period)


def slopes_of(time: np.ndarray, q: np.ndarray, window: float = SLOPE_WINDOW) -> Float[np.ndarray, "rows 2"]:
    """Mean velocities (rad/s) over a window (s) about each row."""
    reach = max(1, round(0.5 * window / float(np.median(np.diff(time)))))
    rows = np.arange(len(time))
    after, before = np.minimum(rows + reach, len(time) - 1), np.maximum(rows - reach, 0)
    return (q[after] - q[before]) / (time[after] - time[before])[:, None]
