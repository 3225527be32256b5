"""A comparison as a study: tables and panels."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..identification.fit.prediction import INDEX
from ..identification.fit.problem import LATENCY
from ..identification.fit.scoring import ErrorRow
from ..identification.log.segments import Segments
from ..identification.open_loop import OpenLoop, smoothed
from .closed_loop import ClosedLoop, Run
from .compare import Comparison
from .study import DASHED, LINE, MEASURED, STEPS, THIN, Curve, Panel, Part, Study, Table, shown

PERIOD = 0.01
"""Between drawn rows (s)."""
STATES = ("q1 (rad)", "q2 (rad)", "dq1 (rad/s)", "dq2 (rad/s)")
TORQUES = ("u1 (N m)", "u2 (N m)")
TIME = "time (s)"


def study_of(comparison: Comparison) -> Study:
    """Lay a comparison out: predictions over time, errors by horizon and by speed, and simulated runs."""
    recording = comparison.recording
    names = ", ".join(each.name for each in comparison.predictions)
    lead = (
        f"A log of {recording.duration:.3g} s with rows every {1e3 * recording.period:.3g} ms, beside open-loop "
        f"predictions of {names}. Each starts from the smoothed measurement, and the log's torques drive it."
    )
    parts = [
        _motion(comparison),
        _horizons(comparison.predictions),
        _speeds(comparison.predictions),
        *(_run(name, run) for name, run in comparison.runs.items()),
    ]
    return Study(f"{recording.name} beside {names}", lead, parts, comparison.notes)


def motion_panels(
    times: np.ndarray, states: np.ndarray, drawn: Sequence[tuple[str, Segments]], labels: Sequence[str] = STATES
) -> list[Panel]:
    """Angles and velocities over time, with predictions that are interrupted where one ends."""
    panels = []
    for place, label in enumerate(labels):
        curves = [Curve("log", times, states[:, place], MEASURED)]
        for number, (name, part) in enumerate(drawn):
            curves.append(Curve(name, _broken(part.times), _broken(part.states[..., place]), number, THIN))
        panels.append(Panel(TIME, label, curves))
    return panels


def _motion(comparison: Comparison) -> Part:
    recording = comparison.recording
    times, states = smoothed(recording, PERIOD)
    drawn = [(each.name, part) for each, part in zip(comparison.predictions, comparison.drawn, strict=True)]
    panels = motion_panels(times, states, drawn)
    for joint in np.flatnonzero(recording.driven):
        u = Curve("log", recording.time, recording.u[:, joint], MEASURED, STEPS)
        panels.append(Panel(TIME, TORQUES[joint], [u]))
    rows = [
        [each.name, *(f"{1e3 * each.model[INDEX[name]]:.1f} ms{_fitted(each, name)}" for name in LATENCY)]
        for each in comparison.predictions
        if any(recording.driven)
    ]
    tables = [Table(("Plant", "Delay", "Lag"), rows)] if rows else []
    note = "Predictions last 0.5 s, one after another. Where a curve leaves the log, the plant is wrong."
    return Part("Predictions over time", note, tables, panels, over_time=True)


def _fitted(prediction: OpenLoop, name: str) -> str:
    return " (best for this log)" if name in prediction.fitted else ""


def _horizons(predictions: Sequence[OpenLoop]) -> Part:
    heads = ("Plant", "After (s)", "Windows", "Angle RMS (rad)", "median", "Velocity RMS (rad/s)", "median")
    rows = [[each.name, key, *_cells(row)] for each in predictions for key, row in each.horizons.items()]
    places = [float(key) for key in predictions[0].horizons]
    panels = _error_panels(
        "horizon (s)", predictions, places, [list(each.horizons.values()) for each in predictions]
    )
    panels = [replace(panel, logarithmic=True) for panel in panels]
    note = (
        "Windows start every 0.1 s where a joint is faster than 1 rad/s. RMS is over windows and joints, the "
        "median over windows: it says more where the motion is unstable. Solid: RMS, dashed: median."
    )
    return Part("Errors by horizon", note, [Table(heads, rows)], panels)


def _speeds(predictions: Sequence[OpenLoop]) -> Part:
    heads = (
        "Plant",
        "Fastest joint (rad/s)",
        "Windows",
        "Angle RMS (rad)",
        "median",
        "Velocity RMS (rad/s)",
        "median",
    )
    groups = [[f"{row.slowest:.1f}–{row.fastest:.1f}" for row in each.speeds] for each in predictions]
    rows = [
        [each.name, label, *_cells(row.errors)]
        for each, labels in zip(predictions, groups, strict=True)
        for label, row in zip(labels, each.speeds, strict=True)
    ]
    grouped = [[row.errors for row in each.speeds] for each in predictions]
    places = [float(place) for place in range(len(groups[0]))]
    panels = _error_panels("fastest joint (rad/s)", predictions, places, grouped)
    panels = [replace(panel, ticks=groups[0]) for panel in panels]
    note = "Errors after 0.25 s, of four groups of windows from slow to fast. Solid: RMS, dashed: median."
    return Part("Errors by speed", note, [Table(heads, rows)] if rows else [], panels if rows else [])


def _error_panels(
    label: str, predictions: Sequence[OpenLoop], places: Sequence[float], rows: Sequence[Sequence[ErrorRow]]
) -> list[Panel]:
    """Angles and velocities side by side, a solid and a dashed curve for each plant."""
    panels = []
    for quantity, unit in (("angle", "rad"), ("velocity", "rad/s")):
        curves = []
        for number, (each, row) in enumerate(zip(predictions, rows, strict=True)):
            for title, look in ((quantity, LINE), (f"{quantity}_median", DASHED)):
                values = [getattr(cell, title) for cell in row]
                y = np.array([np.nan if value is None else value for value in values])
                curves.append(Curve(each.name if look == LINE else "", np.array(places), y, number, look))
        panels.append(Panel(label, f"{quantity} error ({unit})", curves))
    return panels


def _cells(row: ErrorRow) -> list[str]:
    return [
        str(row.windows),
        *(shown(value) for value in (row.angle, row.angle_median, row.velocity, row.velocity_median)),
    ]


def _run(name: str, found: ClosedLoop) -> Part:
    recorded, simulated = found.recorded, found.simulated
    rows = [_outcome("log", recorded), _outcome(f"{name}, simulated", simulated)]
    heads = (
        "Run",
        "Outcome",
        "Swing-up (s)",
        "Highest tip (%)",
        "Largest speed (rad/s)",
        "Energy (J)",
        "Torque cost (N² m² s)",
    )
    runs = (("log", recorded, MEASURED), (f"{name}, simulated", simulated, 0))
    panels = [
        Panel(TIME, label, [_curve(title, run, run.trajectory.x[:, place], colour) for title, run, colour in runs])
        for place, label in enumerate(STATES)
    ]
    joint = found.robot.joint
    torques = [_curve(title, run, run.trajectory.u[:, joint], colour) for title, run, colour in runs]
    panels.append(Panel(TIME, TORQUES[joint], torques))
    note = (
        f"{found.controller} on the {found.robot.name}, from hanging at rest, simulated: {found.domain.name}. "
        "Unstable motions differ in timing: compare how high, how fast and how still they are, not their rows."
    )
    return Part(f"Closed loop: {name}", note, [Table(heads, rows)], panels, over_time=True)


def _curve(title: str, run: Run, values: Any, colour: str | int) -> Curve:
    """A column of a run, thinned to about half of ``PERIOD``."""
    time = np.asarray(run.trajectory.time)
    every = max(1, round(PERIOD / float(np.median(np.diff(time)))) // 2)
    look = LINE if colour == MEASURED else THIN
    return Curve(title, time[::every], np.asarray(values)[::every], colour, look)


def _outcome(name: str, run: Run) -> list[str]:
    criteria = run.criteria
    return [
        name, "up" if criteria.success else run.tip.failure or "failure", shown(criteria.swingup_time),
        shown(run.tip.percent), shown(run.speed), shown(criteria.energy), shown(criteria.torque_cost),
    ]  # fmt: skip


def _broken(values: np.ndarray) -> np.ndarray:
    """Rows one after another, with a NaN between two of them."""
    return np.pad(values, ((0, 0), (0, 1)), constant_values=np.nan).ravel()
