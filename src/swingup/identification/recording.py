"""Recordings of a double pendulum: logs such as RealAIGym's and CloudPendulum's, as arrays.

A log is read by the names of its columns. Periods may be uneven, and rows may repeat. Velocities and torques may be
missing. A log that no fit can use is refused here; faults that a fit can bear are warnings of the recording.
"""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from ..common.columns import MappedColumn, completed, find_goals, lone_torque, suggest_columns
from ..common.errors import SwingupError
from ..common.table import Table, read_table
from .log_checks import (
    MAXIMUM_PERIOD,
    MINIMUM_ROWS,
    check_fresh,
    check_motion,
    check_rate,
    check_stuck,
    check_time,
    continued,
    cut_episodes,
    find_turns,
    find_warnings,
    lone_zeros,
    longest_step,
    one_clock,
)

_POSITIONS = (("pos_meas1", "pos_meas2"), ("pos1", "pos2"))
_VELOCITIES = (("vel_meas1", "vel_meas2"), ("vel1", "vel2"), ())
_COMMANDS = (("tau_con1", "tau_con2"), ("tau1", "tau2"), ("tau_meas1", "tau_meas2"), ())
_PUSHES = (("tau_pert1", "tau_pert2"), ())
_MEASURED = (("tau_meas1", "tau_meas2"), ())
# An empty choice is always complete: what it stands for may be missing.
_GROUPS = ((("time",),), _POSITIONS, _VELOCITIES, _COMMANDS, _PUSHES, _MEASURED)

MEASURED_NOISE = 0.01
"""Peak of a measured torque (N m) below which it is the noise of a motor that drives nothing."""
DIFFERENCES = 1e-3
"""Median distance (rad/s) up to which recorded velocities are backward differences of the angles."""
MAXIMUM_FAULTS = 0.05  # largest share of rows whose time does not increase
LONGEST_PAUSE = 60.0  # A longer step of the time (s) is read as a pause: it may be from another epoch
NOTABLE_SHARE = 0.005  # share of rows without a torque that is worth a note
REPEAT_MOTION = 0.25
"""Motion between two rows, in steps of an encoder, from which equal angles count as a repeated measurement."""


@dataclass(frozen=True)
class Recording:
    """One log, with joints in columns: shoulder, elbow."""

    name: str
    """The file's name."""
    time: Float[np.ndarray, "rows"]
    """s, from 0, increasing; periods may be uneven."""
    q: Float[np.ndarray, "rows 2"]
    """Angles as measured (rad), without the jumps of encoders that wrap."""
    dq: Float[np.ndarray, "rows 2"]
    """Velocities as recorded (rad/s); differences of the angles where the log has none."""
    u: Float[np.ndarray, "rows 2"]
    """Commanded torques, pushes included, within the limits (N m); else measured ones."""
    fresh: Bool[np.ndarray, "rows"]
    """Rows with a new measurement: false where a row repeats the one before although the pendulum moves."""
    quantum: tuple[float, float]
    """Step of each encoder (rad); 0 where the angles have none."""
    period: float
    """Median time between rows (s)."""
    driven: tuple[bool, bool]
    """Joints on which a torque acts."""
    commanded: bool
    """Whether ``u`` was commanded; otherwise it was measured, or the log has no torques."""
    warnings: tuple[str, ...] = ()
    """Faults of this log that its user should know, one line each."""
    sources: Mapping[str, MappedColumn] = field(default_factory=dict)
    """Each column in terms of the file's columns."""
    pairs: tuple[tuple[str, ...], ...] = ()
    """Names of the columns of both joints that were read."""
    goals: "Recording | None" = None
    """Of a log with servos' goals in the place of torques, the same with goals minus angles (rad) as torques."""
    columns: tuple[str, ...] = ()
    """The words of --columns with which it was read."""
    turn: float | None = None
    """Where the angles wrap, in their unit: 2π, 360, an encoder's counts; None if they do not."""

    @property
    def duration(self) -> float:
        """Time from the first row to the last (s)."""
        return float(self.time[-1])

    @property
    def gaps(self) -> Bool[np.ndarray, "intervals"]:
        """Intervals between rows that are too long to predict across."""
        return np.diff(self.time) > longest_step(self.period)


def read_recording(path: str | Path, columns: Sequence[str] = (), force: bool = False) -> Recording:
    """Read a log by its columns.

    Args:
        path: a file with ``time``, ``pos_meas1``, ``pos_meas2`` (or ``pos1``, ``pos2``), and as far as known
            ``vel_meas*``, ``tau_con*``, ``tau_pert*`` and ``tau_meas*``, in SI units or with units in the titles,
            as ``common.table.read_table`` reads it.
        columns: words that map the file's columns, as in ``q1=theta1:deg``.
        force: whether columns that look like torques may stay unread.

    Raises:
        SwingupError: the file cannot be read, lacks a column, or holds what no pendulum's log can.
    """
    columns = _with_both_torques(path, columns)
    table, name = read_table(path, _GROUPS, columns=columns, gaps=True), Path(path).name
    pairs = dict.fromkeys(
        names for group in _GROUPS[1:] for names in group if names and set(names) <= set(table.values)
    )
    has_torques = any(names in pairs for names in _COMMANDS if names)
    goals = None if has_torques else _with_goals(path, table, columns)
    if not (has_torques or goals or force):
        _check_torques(name, table, columns)
    rows, time, notes = _clean(name, table)
    check_time(name, time, table.sources["time"].word("time"), columns)
    values = {each: column[rows] for each, column in table.values.items()}
    angles = _pair(values, _POSITIONS)
    assert angles is not None  # the reader refuses a log without angles
    quantum = (_quantum(angles[:, 0]), _quantum(angles[:, 1]))
    q, turn = continued(angles)
    notes += find_turns(angles[0]) if turn is None else []
    fresh = _fresh_rows(q, quantum, time, values)
    check_fresh(name, fresh, q)
    check_rate(name, float(np.median(np.diff(time[fresh]))))
    check_motion(name, q[fresh])
    kept, time, found = cut_episodes(time, q, fresh, longest_step(float(np.median(np.diff(time)))))
    time, q, fresh = time[kept], q[kept], fresh[kept]
    check_fresh(f"{name}, without rows whose angles jump away and back,", fresh, q)
    if not force:
        check_stuck(name, time, q)
    values = {each: column[kept] for each, column in values.items()}
    dq, slopes = _pair(values, _VELOCITIES), _differences(time, q)
    u, commanded, lacking = _torques(time, values)
    driven = np.abs(u).max(axis=0) > (0.0 if commanded else MEASURED_NOISE)
    notes += [*found, *lacking, *find_warnings(time, u, _pair(values, _MEASURED) if commanded else None, fresh)]
    return Recording(
        name=name,
        time=time,
        q=q,
        dq=slopes if dq is None else np.where(np.isfinite(dq), dq, slopes),
        u=u,
        fresh=fresh,
        quantum=quantum,
        period=float(np.median(np.diff(time))),
        driven=(bool(driven[0]), bool(driven[1])),
        commanded=commanded,
        warnings=tuple(f"{name}: {note}" for note in notes),
        sources=table.sources,
        pairs=tuple(pairs),
        columns=tuple(columns),
        turn=turn,
        goals=goals,
    )


def _with_both_torques(path: str | Path, columns: Sequence[str]) -> Sequence[str]:
    """The words; where they map one torque alone, the other is that of the log, or 0 if it has no other column."""
    torques = [word for word in columns if word.startswith(("u1=", "u2="))]
    if len(torques) != 1:
        return columns
    (word,) = torques
    joint, rest = int(word[1]), [each for each in columns if each != word]
    table = read_table(path, _GROUPS, columns=rest, gaps=True)
    # The pair that the word is of first.
    pairs = sorted(filter(None, _COMMANDS), key=lambda pair: pair[joint - 1] not in word)
    # Measured torques count as commands where the word itself is of one.
    pairs = [pair for pair in pairs if pair[joint - 1] in word or pair not in _MEASURED]
    there = [pair[2 - joint] for pair in pairs if pair[2 - joint] in {*table.values, *table.unread}]
    others = suggest_columns([title for title in table.unread if title not in word], _COMMANDS[0])
    if not there and any(each.startswith(f"u{3 - joint}=") for each in others):
        return columns  # the reader asks for it
    return [*columns, f"u{3 - joint}={there[0] if there else '0'}"]


def _with_goals(path: str | Path, table: Table, columns: Sequence[str]) -> Recording | None:
    """The log with the differences of servos' goals and angles (rad) as torques, where it has goals."""
    angles = [table.sources[each].expression for each in _names(table.values, _POSITIONS)]
    goals = find_goals(table.unread)
    if goals is None or not all(len(each.terms) == 1 and each.is_plain for each in angles):
        return None
    # A servo compares what it measures, whatever sign and zero its user gives it.
    pairs = zip(goals, (each.titles[0] for each in angles), strict=True)
    words = [f"u{joint}={goal}-{angle}" for joint, (goal, angle) in enumerate(pairs, start=1)]
    with contextlib.suppress(SwingupError):
        return read_recording(path, [*columns, *words])
    return None


def _check_torques(name: str, table: Table, columns: Sequence[str]) -> None:
    """Refuse a log whose torques have other names, or are those of one joint alone."""
    wanted = _COMMANDS[0]
    single = next((title for title in table.unread for names in _COMMANDS if title in names), None)
    if single is not None:
        other = single[:-1] + ("2" if single.endswith("1") else "1")
        if (first := single[:-1] + "0") in table.unread and single.endswith("1"):
            words = completed([f"u1={first}", f"u2={single}"], columns)
            raise SwingupError(
                f"{name} has {first} and {single}, which count joints from 0: write --columns {words}"
            )
        words = completed([f"u{single[-1]}={single}", f"u{other[-1]}=0"], columns)
        raise SwingupError(
            f"{name} has {single} and lacks {other}: name its column, or write --columns {words} if joint "
            f"{other[-1]} has no torque"
        )
    if (lone := lone_torque(table.unread)) is not None:
        elbow, shoulder = (completed(each, columns) for each in (["u1=0", f"u2={lone}"], [f"u1={lone}", "u2=0"]))
        raise SwingupError(
            f"{name} has {lone} and no torque of each joint: write --columns {elbow} where it drives the elbow, "
            f"--columns {shoulder} where the shoulder, with its unit or a factor"
        )
    if likely := suggest_columns(table.unread, wanted):
        words = completed(likely, columns)
        raise SwingupError(
            f"{name} lacks {', '.join(wanted)}: write --columns {words}, if these are torques, or u1=0 u2=0 for a "
            "free fall"
        )


def _clean(name: str, table: Table) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Rows with a time and both angles, and their times from 0 on one clock."""
    time = table.values["time"]
    angles = _pair(table.values, _POSITIONS)
    assert angles is not None
    whole, zeros = np.isfinite(time) & np.isfinite(angles).all(axis=1), lone_zeros(angles)
    rows = np.flatnonzero(whole & ~zeros)
    if len(rows) < MINIMUM_ROWS:
        raise SwingupError(
            f"{name} has {len(rows)} rows with a time and both angles: at least {MINIMUM_ROWS} are needed"
        )
    notes = []
    if lacking := np.count_nonzero(~whole):
        notes.append(f"{lacking} rows lack a time or an angle: they are left out")
    if lost := np.count_nonzero(zeros):
        notes.append(f"{lost} rows between others have zeros for both angles: they are left out")
    time = time[rows]
    steps = np.diff(time)
    period = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    longest = longest_step(period) if period < MAXIMUM_PERIOD else 20 * period
    if (idle := steps > max(LONGEST_PAUSE, 2 * longest)).any():
        notes.append(f"the time jumps by {steps.max():.3g} s: read as a pause")
        steps = np.clip(steps, -2 * longest, np.where(idle, 2 * longest, np.inf))
        time = time[0] + np.append(0.0, np.cumsum(steps))
    keep, clock, restarts, spread = one_clock(time, longest, 2 * longest)
    if np.count_nonzero(~keep) > MAXIMUM_FAULTS * len(time):
        cells = np.nan_to_num(np.column_stack(list(table.values.values()))[rows])
        twice = np.append(False, np.all(np.diff(cells, axis=0) == 0, axis=1))
        if twice.any():
            notes.append(f"{np.count_nonzero(twice)} rows repeat the one before and its time: they are left out")
        rows, time = rows[~twice], time[~twice]
        keep, clock, restarts, spread = one_clock(time, longest, 2 * longest)
        steps = np.diff(time)
    faults = int(np.count_nonzero(~keep))
    if faults > MAXIMUM_FAULTS * len(time):
        worst = int(np.flatnonzero(steps <= 0)[0])
        again = f"{name}: time {time[worst + 1]:g} comes after {time[worst]:g}, and so in {faults} rows"
        if steps.min() >= 0:
            raise SwingupError(f"{again}: give each row its own, with enough digits of the time")
        raise SwingupError(f"{again}: keep rows in order, with enough digits of the time")
    if restarts:
        notes.append(f"the time restarts {restarts} times: read as {restarts + 1} episodes")
    if spread:
        notes.append(f"{spread} rows have rounded times that several share: spread evenly")
    if faults:
        notes.append(f"{faults} rows repeat the time before, or come late: they are left out")
    return rows[keep], clock, notes


def _torques(time: np.ndarray, values: Mapping[str, np.ndarray]) -> tuple[np.ndarray, bool, list[str]]:
    """Torques of all rows, whether they are commands, and a note where some are missing."""
    commands = _pair(values, _COMMANDS)
    if commands is None:
        return np.zeros((len(time), 2)), False, []
    # The last torque holds, but not across a gap, where the motors rest.
    longest = longest_step(float(np.median(np.diff(time))))
    known = np.isfinite(commands)
    last = np.maximum.accumulate(np.where(known, np.arange(len(time))[:, None], -1), axis=0)
    recent = (last >= 0) & (time[:, None] - time[last] <= longest)
    u = np.where(recent, np.take_along_axis(commands, last, axis=0), 0.0)
    # Measured torques stand in for commands that a log lacks. Pushes come on top of commands alone.
    commanded = "tau_meas1" not in _names(values, _COMMANDS)
    pushes = _pair(values, _PUSHES) if commanded else None
    # A joint without any torque has no motor.
    lacking = float(np.mean(~known[:, known.any(axis=0)].all(axis=1)))
    note = f"torques are missing in {lacking:.0%} of the rows: the last one holds for at most {longest:.2g} s"
    return u if pushes is None else u + np.nan_to_num(pushes), commanded, [note] * (lacking > NOTABLE_SHARE)


def sensors(recordings: Sequence[Recording]) -> dict[str, float | str]:
    """A domain's entries for the sensors: the coarsest quanta, and whether velocities are differences of angles."""
    quanta = np.max([recording.quantum for recording in recordings], axis=0)
    slack = np.median([np.median(np.abs(each.dq - _differences(each.time, each.q))) for each in recordings])
    source = "differences" if slack < DIFFERENCES else "driver"
    return {"quantum1": float(quanta[0]), "quantum2": float(quanta[1]), "velocities": source}


def _names(columns: Mapping[str, np.ndarray], group: tuple[tuple[str, ...], ...]) -> tuple[str, ...]:
    """The first complete choice of a group."""
    return next((names for names in group if set(names) <= set(columns)), ())


def _pair(columns: Mapping[str, np.ndarray], group: tuple[tuple[str, ...], ...]) -> np.ndarray | None:
    names = _names(columns, group)
    return np.column_stack([columns[name] for name in names]) if names else None


def _quantum(angle: np.ndarray) -> float:
    """The encoder's step (rad): the smallest change of which most changes are multiples; otherwise 0."""
    changes = np.abs(np.diff(angle))
    # Single precision leaves differences of 1e-7 between equal angles of several turns.
    changes = changes[changes > 2e-6]
    if changes.size == 0:
        return 0.0
    smallest = float(changes.min())
    step = float(np.median(changes[changes < 1.5 * smallest]))
    small = changes[changes < 20 * step]
    steps = small / step
    return step if np.mean(np.abs(steps - np.round(steps)) < 0.05) > 0.9 else 0.0


def _fresh_rows(
    q: np.ndarray, quantum: tuple[float, float], time: np.ndarray, values: Mapping[str, np.ndarray]
) -> np.ndarray:
    """False where a row repeats all measurements although the pendulum moves."""
    parts = [part for part in (q, _pair(values, _VELOCITIES), _pair(values, _MEASURED)) if part is not None]
    same = np.all([np.all(np.diff(part, axis=0) == 0, axis=1) for part in parts], axis=0)
    # The mean speed from five rows before the equal ones to five rows after: these alone would show none.
    first, last = np.flatnonzero(np.append(True, ~same)), np.flatnonzero(np.append(~same, True))
    before, after = np.maximum(first - 5, 0), np.minimum(last + 5, len(time) - 1)
    speed = np.abs(q[after] - q[before]) / (time[after] - time[before])[:, None]
    speed = np.repeat(speed, last - first + 1, axis=0)
    moved = speed[1:] * np.diff(time)[:, None] > REPEAT_MOTION * np.maximum(np.asarray(quantum), 1e-6)
    return np.concatenate([[True], ~(same & moved.any(axis=1))])


def _differences(time: np.ndarray, q: np.ndarray) -> np.ndarray:
    backward = np.diff(q, axis=0) / np.diff(time)[:, None]
    return np.concatenate([backward[:1], backward])
