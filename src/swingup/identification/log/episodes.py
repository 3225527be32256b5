"""Jumps: turns of an encoder that wraps, measurements that drop out, resets and clocks that restart."""

import itertools

import numpy as np
from jaxtyping import Bool, Float

from ...common.table import spread_evenly

TURNS = (1.0, 2.0 * np.pi, 360.0, *(float(2**k) for k in range(8, 21)), 1000.0, 2000.0, 4000.0, 10000.0)
"""What an angle may wrap at, in units that logs have."""
FILLED_SHARE = 0.7
"""Share of a turn that angles which wrap reach."""

NEAR_ROWS, NEAR_TIME = 4, 0.02
"""Rows and time (s) to each side whose median slope predicts the next angle."""
LEAST_JUMP, ACCELERATION = 0.15, 400.0
"""Least jump (rad), and acceleration (rad/s²) that makes none: smaller jumps are noise, or the pendulum's own."""
UNLIKELY_DEVIATIONS = 20.0
"""A jump beyond so many median deviations is not noise."""
SHORTEST_PIECE = 0.1
"""A piece between two jumps that is shorter (s) is a dropout."""


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


def cut_episodes(
    time: Float[np.ndarray, "rows"], q: Float[np.ndarray, "rows 2"], fresh: Bool[np.ndarray, "rows"], longest: float
) -> tuple[Bool[np.ndarray, "rows"], Float[np.ndarray, "rows"], list[str]]:
    """Cut a log where its angles jump: rows to keep, times with a gap at each cut, and notes.

    Fresh rows have a measurement of their own. A time between rows beyond ``longest`` (s) is a gap.
    """
    keep, dropped = np.ones(len(time), bool), 0
    rows = np.flatnonzero(fresh)
    for _ in range(3):  # a dropout hides what is beside it
        jumps = _jumps(time[rows], q[rows], longest)
        bounds = [0, *(jumps + 1).tolist(), len(rows)]
        lost = [
            np.arange(start, end)
            for start, end in itertools.pairwise(bounds)
            if len(bounds) > 2 and time[rows[end - 1]] - time[rows[start]] < SHORTEST_PIECE
        ]
        if not lost:
            break
        out = np.concatenate(lost)
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
    # Medians, since one bad angle spoils two slopes beside it.
    before, after = np.median(windows[..., :near], axis=-1), np.median(windows[..., near + 1 :], axis=-1)
    jumps = np.abs(slopes - 0.5 * (before + after)) * steps[:, None]
    least = np.maximum(
        LEAST_JUMP + ACCELERATION * steps[:, None] ** 2, UNLIKELY_DEVIATIONS * 1.48 * np.median(jumps, axis=0)
    )
    # Where the pendulum turns quickly, slopes differ from one side to the other.
    far = jumps > least + 2.0 * np.abs(before - after) * steps[:, None]
    return np.flatnonzero(far.any(axis=1) & (steps <= longest))
