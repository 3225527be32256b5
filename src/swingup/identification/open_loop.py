"""A plant's open-loop predictions of a log: errors by horizon and by speed, and stretches to look at.

Up to 0.5 s the windows are those of the fixed scoring, so that the errors are those that ``identify`` reports.
After 1 s an error says less: where the motion is unstable any plant is lost by then, and medians say more.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicHermiteSpline

from ..loop.domain import Domain
from ..loop.loop import LOOP_DT
from .fit.fit import fit_start
from .fit.prediction import INDEX, NAMES, Integration, in_loop, integration_of, predict, vector_of
from .fit.scoring import ErrorRow, Errors, error_row, prediction_errors, score_windows, summarise
from .fit.unknowns import LATENCY, Problem
from .log.recording import Recording
from .log.segments import FIT_LENGTH, INTERVAL, Segments, cut_windows
from .log.smoothing import REACH, smooth

LONGEST_HORIZON = 1.0
"""The longest horizon (s)."""
SPEED_HORIZON = 0.25
"""Horizon of the errors by speed (s)."""
SPEED_GROUPS = 4
"""Groups of equally many windows, from slow to fast."""
DRAWN_STEP = 0.01
"""Time between the states of a curve (s)."""
LARGEST_DRAWN = 1e3
"""A state beyond this (rad, rad/s) has diverged: it is not drawn."""


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
    """Name of the plant."""
    setting: Integration
    model: Float[np.ndarray, "15"]
    """``prediction.NAMES``"""
    fitted: tuple[str, ...]
    """Those of delay and lag that were fitted to this log, since plant and domain do not say them."""
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
    # What the domain says is judged as it is; what it leaves open must not spoil the plant's errors.
    said = {"lag", *domain.names} if "response" in domain.names else {*domain.names}
    known = {each: float(start[INDEX[each]]) for each in LATENCY if each in said}
    # Without torques nothing is late.
    fitted = tuple(each for each in LATENCY if each not in known) if any(recording.driven) else ()
    problem = Problem(setting, start, [recording], [0], known)
    model = fit_start(problem, cut_windows(recording, FIT_LENGTH))[0] if fitted else start
    short, long = score_windows([recording]), cut_windows(recording, LONGEST_HORIZON)
    near, far = (prediction_errors(setting, model[None], windows) for windows in (short, long))
    errors = {**summarise(near), **summarise(far, [LONGEST_HORIZON])}
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
    return replace(windows, offsets=offsets, states=np.where(np.abs(found) < LARGEST_DRAWN, found, np.nan))


def smoothed(recording: Recording, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and smoothed states of a log at even periods, to draw or to compare with."""
    times = np.arange(REACH, recording.duration - REACH, period)
    return times, smooth(recording, times)


def _start(domain: Domain, vector: Float[np.ndarray, "15"]) -> Float[np.ndarray, "15"]:
    """The model's vector with what the domain says of the loop."""
    values = {name: domain.nominal.value(name) for name in domain.names}
    if "response" in values:
        # Of a change of torque, a first-order lag makes this part within a step of the loop.
        values.setdefault("lag", -LOOP_DT / np.log1p(-min(values["response"], 0.999)))
    return in_loop(vector, values)
