"""A plant's open-loop predictions of a log: errors by horizon and by speed, and stretches to look at.

Up to 0.5 s the windows are those of the fixed scoring, so that the errors are those that ``identify`` reports.
After 1 s an error says less: where the motion is unstable any plant is lost by then, and medians say more.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ..loop.domain import Domain
from ..loop.loop import LOOP_DT
from .fit.estimate import LATENCY, Problem, fit_start
from .fit.prediction import INDEX, LEAST_LAG, NAMES, Setting, predict, setting_of, vector_of
from .fit.scoring import HORIZONS, prediction_errors, score_windows
from .log.recording import Recording
from .log.smoothing import REACH, smooth
from .log.windows import FIT_LENGTH, INTERVAL, Windows, cut_windows

LONGEST_HORIZON = 1.0
"""The longest horizon (s)."""
SPEED_HORIZON = 0.25
"""Horizon of the errors by speed (s)."""
SPEED_GROUPS = 4
"""Groups of equally many windows, from slow to fast."""


@dataclass(frozen=True)
class ErrorRow:
    """Errors of some windows after one time."""

    windows: int
    angle: float | None
    """Root mean square over windows and joints (rad); None without windows."""
    velocity: float | None
    """Likewise (rad/s)."""
    angle_median: float | None
    """Median over windows of the root mean square over joints (rad)."""
    velocity_median: float | None
    """Likewise (rad/s)."""


@dataclass(frozen=True)
class SpeedRow:
    """Errors of the windows whose fastest joint is within a range of speeds."""

    slowest: float
    """rad/s"""
    fastest: float
    """rad/s"""
    errors: ErrorRow


@dataclass(frozen=True)
class OpenLoop:
    """What a plant predicts of a log."""

    name: str
    """Of the plant."""
    setting: Setting
    model: Float[np.ndarray, "15"]
    """``prediction.NAMES``"""
    fitted: tuple[str, ...]
    """Of delay and lag, those that were fitted to this log, since plant and domain do not say them."""
    horizons: Mapping[str, ErrorRow]
    """By horizon (s), as in "0.25"."""
    speeds: Sequence[SpeedRow]

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "model": {name: float(value) for name, value in zip(NAMES, self.model, strict=True)},
            "fitted": list(self.fitted),
            "errors": {horizon: vars(row) for horizon, row in self.horizons.items()},
            "speeds": [{"from": row.slowest, "to": row.fastest, **vars(row.errors)} for row in self.speeds],
        }


@dataclass(frozen=True)
class Stretches:
    """Predictions one after another, each from the smoothed measurement."""

    time: Float[np.ndarray, "stretches rows"]
    """s"""
    x: Float[np.ndarray, "stretches rows 4"]


def predict_log(recording: Recording, domain: Domain, name: str) -> OpenLoop:
    """Predict a log with a plant, in the middle of the domain's ranges, and compare.

    Delay and lag that the domain does not say are those that predict the log best.

    Args:
        recording: the log.
        domain: plant and loop.
        name: of the plant in the result.
    """
    plant = domain.nominal_plant
    setting, start = setting_of(plant), _start(domain, vector_of(plant))
    known = {each: float(start[INDEX[each]]) for each in LATENCY if _says(domain, each)}
    fitted = tuple(each for each in LATENCY if each not in known) if any(recording.driven) else ()
    problem = Problem(setting, start, [recording], [0], known)
    model = fit_start(problem, cut_windows(recording, FIT_LENGTH))[0] if fitted else start
    short, long = score_windows([recording]), cut_windows(recording, LONGEST_HORIZON)
    models, rows = model[None], {}
    near, far = prediction_errors(setting, models, short), prediction_errors(setting, models, long)
    for horizon in (*HORIZONS, LONGEST_HORIZON):
        errors = far if horizon == LONGEST_HORIZON else near
        rows[f"{horizon:g}"] = error_row(errors[:, round(horizon / INTERVAL) - 1])
    return OpenLoop(name, setting, model, fitted, rows, by_speed(short, near))


def error_row(errors: Float[np.ndarray, "windows 4"]) -> ErrorRow:
    """Summarise the errors of windows after one time: of both angles, and of both velocities."""
    if not len(errors):
        return ErrorRow(0, None, None, None, None)
    squares = np.stack([np.mean(errors[:, :2] ** 2, axis=1), np.mean(errors[:, 2:] ** 2, axis=1)])
    means, medians = np.sqrt(squares.mean(axis=1)), np.sqrt(np.median(squares, axis=1))
    return ErrorRow(len(errors), float(means[0]), float(means[1]), float(medians[0]), float(medians[1]))


def by_speed(windows: Windows, errors: Float[np.ndarray, "windows outputs 4"]) -> list[SpeedRow]:
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


def fastest_speeds(windows: Windows, outputs: int) -> Float[np.ndarray, "windows"]:
    """The largest speed of a joint in each window up to an output (rad/s)."""
    states = np.concatenate([windows.start[:, None], windows.reference[:, :outputs]], axis=1)
    speeds: np.ndarray = np.abs(states[..., 2:]).max(axis=(1, 2), initial=0.0)
    return speeds


def stretches(recording: Recording, setting: Setting, model: Float[np.ndarray, "15"], length: float) -> Stretches:
    """Predictions of ``length`` (s) over a whole log, one after another, as smooth curves."""
    return predicted_stretches(setting, model, cut_windows(recording, length, stride=length, least_speed=0.0))


def predicted_stretches(setting: Setting, model: Float[np.ndarray, "15"], windows: Windows) -> Stretches:
    """Predictions over windows as smooth curves."""
    if not len(windows):
        return Stretches(np.zeros((0, 1)), np.zeros((0, 1, 4)))
    states = np.concatenate([windows.start[:, None], predict(setting, model, windows)], axis=1)
    part = np.arange(0, states.shape[1] - 1 + 1e-9, 0.2)
    return Stretches(windows.time[:, None] + INTERVAL * part, _interpolate(states, part))


def smoothed(recording: Recording, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and smoothed states of a log at even periods, to draw or to compare with."""
    times = np.arange(REACH, recording.duration - REACH, period)
    return times, smooth(recording, times)


def _interpolate(states: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Cubics between states 50 ms apart, with their velocities as slopes; NaN where the prediction diverged."""
    before = np.minimum(part.astype(int), states.shape[1] - 2)
    s = (part - before)[:, None]
    x0, x1 = states[:, before], states[:, before + 1]
    q0, q1, v0, v1 = x0[..., :2], x1[..., :2], INTERVAL * x0[..., 2:], INTERVAL * x1[..., 2:]
    q = q0 + s * v0 + s**2 * (3 * (q1 - q0) - 2 * v0 - v1) + s**3 * (2 * (q0 - q1) + v0 + v1)
    v = v0 + 2 * s * (3 * (q1 - q0) - 2 * v0 - v1) + 3 * s**2 * (2 * (q0 - q1) + v0 + v1)
    found = np.concatenate([q, v / INTERVAL], axis=-1)
    return np.where(np.abs(found) < 1e3, found, np.nan)


def _says(domain: Domain, name: str) -> bool:
    return name in domain.names or (name == "lag" and "response" in domain.names)


def _start(domain: Domain, vector: Float[np.ndarray, "15"]) -> Float[np.ndarray, "15"]:
    """The model's vector with what the domain says of the loop."""
    values = dict(zip(NAMES, vector, strict=True))
    for name in ("offset1", "offset2", "gain1", "gain2", *LATENCY):
        if name in domain.names:
            values[name] = domain.nominal.value(name)
    if "response" in domain.names and "lag" not in domain.names:
        # Of a change of torque, a first-order lag makes this part within a step of the loop.
        values["lag"] = -LOOP_DT / np.log1p(-min(domain.nominal.loop.response, 0.999))
    values["lag"] = max(values["lag"], LEAST_LAG)
    return np.array([values[name] for name in NAMES])
