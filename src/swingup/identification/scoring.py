"""The fixed scoring of predictions: errors after 0.1, 0.25 and 0.5 s, over windows that no model can choose.

Windows of 0.5 s start every 0.1 s where a joint is faster than 1 rad/s. A prediction starts from the smoothed
measurement, never from an optimised start, and is compared with it. The error is the root mean square over windows
and joints, for ``identify`` as for ``predict_log``. After 1 s medians say more: where the motion is unstable, any
plant is lost by then.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import CubicHermiteSpline

from ..common.errors import SwingupError
from ..loop.domain import Domain
from ..loop.loop import LOOP_DT
from .fit import fit_start
from .prediction import (
    CHUNK,
    INDEX,
    LAG_MEMORY,
    MAXIMUM_ERROR,
    NAMES,
    Integration,
    in_loop,
    integration_of,
    predict,
    vector_of,
)
from .recording import Recording
from .segments import FIT_LENGTH, HISTORY, INTERVAL, REACH, Segments, cut_windows, join, smooth
from .unknowns import LATENCY, MAXIMUM_LAG, Problem

HORIZONS = (0.1, 0.25, 0.5)  # s
LENGTH = max(HORIZONS)
WHOLE_LOGS = 3  # from this number of logs on, one is held out whole
HELD_SHARE = 0.25  # share of the windows of each log that are held out, at its end, where there are fewer logs


@dataclass(frozen=True)
class ErrorRow:
    """Errors of some windows after one time."""

    windows: int
    angle: float | None  # root mean square over windows and joints (rad); None without windows
    velocity: float | None  # root mean square of the velocities' errors (rad/s)
    angle_median: float | None  # median over windows of the root mean square over joints (rad)
    velocity_median: float | None  # median over windows of the root mean square over joints (rad/s)


Errors = Mapping[str, ErrorRow]  # by horizon (s), as in "0.25"


def score_windows(recordings: Sequence[Recording]) -> Segments:
    """The windows of the fixed scoring."""
    return join([cut_windows(recording, LENGTH, log=log) for log, recording in enumerate(recordings)])


def prediction_errors(
    setting: Integration, models: Float[np.ndarray, "logs 15"], windows: Segments
) -> Float[np.ndarray, "windows outputs 4"]:
    """Predicted minus smoothed states; each log has its model."""
    errors = np.zeros_like(windows.states[:, 1:])
    for log in np.unique(windows.log):
        rows = windows.log == log
        errors[rows] = predict(setting, models[log], windows.take(rows)) - windows.states[rows, 1:]
    return np.clip(np.nan_to_num(errors, nan=MAXIMUM_ERROR), -MAXIMUM_ERROR, MAXIMUM_ERROR)


def summarise(errors: Float[np.ndarray, "windows outputs 4"], horizons: Sequence[float] = HORIZONS) -> Errors:
    """Errors by horizon."""
    return {f"{horizon:g}": error_row(errors[:, round(horizon / INTERVAL) - 1]) for horizon in horizons}


def error_row(errors: Float[np.ndarray, "windows 4"]) -> ErrorRow:
    """Summarise the errors of windows after one time: of both angles, and of both velocities."""
    if not len(errors):
        return ErrorRow(0, None, None, None, None)
    squares = np.stack([np.mean(errors[:, :2] ** 2, axis=1), np.mean(errors[:, 2:] ** 2, axis=1)])
    means, medians = np.sqrt(squares.mean(axis=1)), np.sqrt(np.median(squares, axis=1))
    return ErrorRow(len(errors), float(means[0]), float(means[1]), float(medians[0]), float(medians[1]))


def hold_out(
    everything: Segments, windows: Segments, sessions: Sequence[int], driven: Sequence[bool]
) -> tuple[Segments, Segments]:
    """Held-out windows of the scoring, and the windows of a fit that share no time with them.

    Sessions and whether torques act are those of the logs: the only log of a session, or its only one with torques,
    is not held out whole, since its loop is fitted to it.
    """
    judged = everything.take(_held_out(everything, np.asarray(sessions), np.asarray(driven)))
    free = np.ones(len(windows), bool)
    for log in np.unique(judged.log):
        held, starts = judged.start[judged.log == log], windows.start[:, None]
        # Windows overlap: one that shares any time with a judged one has seen its motion.
        apart = (starts + FIT_LENGTH <= held) | (starts >= held + LENGTH)
        free &= (windows.log != log) | apart.all(axis=1)
    return judged, windows.take(free)


def _held_out(
    windows: Segments, sessions: Int[np.ndarray, "logs"], driven: Bool[np.ndarray, "logs"]
) -> Bool[np.ndarray, "windows"]:
    logs, counts = np.unique(windows.log, return_counts=True)
    alike = sessions[logs] == sessions[logs][:, None]
    shared = np.sum(alike, axis=1) > 1
    shared &= ~driven[logs] | (np.sum(alike & driven[logs], axis=1) > 1)
    if len(logs) >= WHOLE_LOGS and shared.any():
        logs, counts = logs[shared], counts[shared]
        # A log with few windows, such as a swing-up, may be the last: the one with the median number is held out.
        middle = logs[np.argsort(counts, kind="stable")[len(logs) // 2]]
        return np.asarray(windows.log == middle)
    held = np.zeros(len(windows), bool)
    for log in logs:
        rows = np.flatnonzero(windows.log == log)
        held[rows[len(rows) - max(1, round(HELD_SHARE * len(rows))) :]] = True
    return held


def prediction_skill(
    recording: Recording, setting: Integration, start: Float[np.ndarray, "15"], values: Mapping[str, float]
) -> float:
    """Error of the angles after 0.25 s as a share of their motion (medians), by the better of two plants.

    128 of the log's windows count. The other plant has other base parameters than the starting one.
    """
    windows, output = score_windows([recording]), round(FIT_LENGTH / INTERVAL)
    if not len(windows):
        return np.inf
    # As many as one call of the compiled program predicts.
    windows = windows.take(np.linspace(0, len(windows) - 1, min(len(windows), CHUNK)).astype(int))
    other = start.copy()
    other[[INDEX[name] for name in values]] = list(values.values())
    moved = np.linalg.norm(windows.states[:, output, :2] - windows.states[:, 0, :2], axis=1)
    errors = [prediction_errors(setting, model[None], windows)[:, output - 1, :2] for model in (start, other)]
    return float(min(np.median(np.linalg.norm(each, axis=1)) for each in errors) / max(np.median(moved), 1e-9))


MAXIMUM_HORIZON = 1.0  # the longest horizon (s)
SPEED_HORIZON = 0.25  # horizon of the errors by speed (s)
SPEED_GROUPS = 4  # groups of equally many windows, from slow to fast
DRAWN_STEP = 0.01  # time between the states of a curve (s)
MAXIMUM_DRAWN = 1e3  # a larger state (rad, rad/s) has diverged: it is not drawn


@dataclass(frozen=True)
class SpeedRow:
    """Errors of the windows whose fastest joint is within a range of speeds."""

    slowest: float  # rad/s
    fastest: float  # rad/s
    errors: ErrorRow


@dataclass(frozen=True)
class OpenLoop:
    """A plant's predictions of a log, and their errors."""

    name: str  # name of the plant
    setting: Integration
    model: Float[np.ndarray, "15"]  # ``prediction.NAMES``
    fitted: tuple[str, ...]
    """Which of delay and lag were fitted to this log, because plant and domain have no value."""
    horizons: Errors
    speeds: Sequence[SpeedRow]

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "model": {name: float(value) for name, value in zip(NAMES, self.model, strict=True)},
            "fitted": list(self.fitted),
            "errors": {horizon: vars(row) for horizon, row in self.horizons.items()},
            "speeds": [{"from": row.slowest, "to": row.fastest, **vars(row.errors)} for row in self.speeds],
        }


def predict_log(recording: Recording, domain: Domain, name: str) -> OpenLoop:
    """Predict a log with a plant, in the middle of the domain's ranges, and compare.

    Delay and lag that the domain does not say are those that predict the log best. The result gives the plant this
    ``name``.
    """
    plant = domain.nominal_plant
    setting, start = integration_of(plant), _start(domain, vector_of(plant))
    # Values of the domain are judged as they are. What it leaves open must not count as an error of the plant.
    said = {"lag", *domain.names} if "response" in domain.names else {*domain.names}
    known = {each: float(start[INDEX[each]]) for each in LATENCY if each in said}
    for each, longest in (("delay", HISTORY - LAG_MEMORY), ("lag", MAXIMUM_LAG)):
        if known.get(each, 0.0) > longest:
            raise SwingupError(f"{name} has a {each} of {known[each]:g} s: a comparison takes up to {longest:g} s")
    # Without torques nothing is late.
    fitted = tuple(each for each in LATENCY if each not in known) if any(recording.driven) else ()
    problem = Problem(setting, start, [recording], [0], known)
    model = fit_start(problem, cut_windows(recording, FIT_LENGTH))[0] if fitted else start
    short, long = score_windows([recording]), cut_windows(recording, MAXIMUM_HORIZON)
    near, far = (prediction_errors(setting, model[None], windows) for windows in (short, long))
    errors = {**summarise(near), **summarise(far, [MAXIMUM_HORIZON])}
    return OpenLoop(name, setting, model, fitted, errors, by_speed(short, near))


def by_speed(windows: Segments, errors: Float[np.ndarray, "windows outputs 4"]) -> list[SpeedRow]:
    """Errors after 0.25 s of equally many slow and fast windows."""
    output = round(SPEED_HORIZON / INTERVAL) - 1
    speeds = fastest_speeds(windows, output + 1)
    if not len(speeds):
        return []
    groups = np.array_split(np.argsort(speeds, kind="stable"), min(SPEED_GROUPS, len(speeds)))
    return [
        SpeedRow(float(speeds[rows].min()), float(speeds[rows].max()), error_row(errors[rows, output]))
        for rows in groups
    ]


def fastest_speeds(windows: Segments, outputs: int) -> Float[np.ndarray, "windows"]:
    """The largest speed of a joint in each window up to an output (rad/s)."""
    return np.abs(windows.states[:, : outputs + 1, 2:]).max(axis=(1, 2), initial=0.0)


def predicted_curves(setting: Integration, model: Float[np.ndarray, "15"], windows: Segments) -> Segments:
    """Predictions over windows as smooth curves: cubics between the states, with their velocities as slopes."""
    offsets = DRAWN_STEP * np.arange(round(windows.offsets[-1] / DRAWN_STEP) + 1)
    states = np.concatenate([windows.states[:, :1], predict(setting, model, windows)], axis=1)
    # A spline refuses NaN.
    states = np.nan_to_num(states, nan=1e9, posinf=1e9, neginf=-1e9)
    curve = CubicHermiteSpline(windows.offsets, states[..., :2], states[..., 2:], axis=1)
    found = np.concatenate([curve(offsets), curve.derivative()(offsets)], axis=-1)
    return replace(windows, offsets=offsets, states=np.where(np.abs(found) < MAXIMUM_DRAWN, found, np.nan))


def smoothed(recording: Recording, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and smoothed states of a log at even periods, to draw or to compare with."""
    times = np.arange(REACH, recording.duration - REACH, period)
    return times, smooth(recording, times)


def _start(domain: Domain, vector: Float[np.ndarray, "15"]) -> Float[np.ndarray, "15"]:
    """The model's vector with the domain's values of the loop."""
    values = {name: domain.nominal.value(name) for name in domain.names}
    if "response" in values:
        # ``response`` is the share of a change of torque that a first-order lag makes within a step of the loop.
        values.setdefault("lag", -LOOP_DT / np.log1p(-min(values["response"], 0.999)))
    return in_loop(vector, values)
