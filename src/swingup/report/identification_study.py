"""An identification as a study: parameters, held-out errors and windows, residuals, and friction."""

import numpy as np

from ..identification.fit.prediction import INDEX
from ..identification.fit.scoring import LENGTH, prediction_errors
from ..identification.identify import Identification
from ..identification.log.segments import INTERVAL, Segments
from ..identification.open_loop import SPEED_HORIZON, fastest_speeds, predicted_curves, smoothed
from ..identification.results import NARROW, OFFSET_SIZE
from .compare_study import PERIOD, STATES, motion_panels
from .study import BAND, DOTS, LINE, THIN, Curve, Panel, Part, Study, Table, shown

MOST_LOGS = 3
"""Logs whose held-out windows are drawn."""
FITTED, START = 0, 1
"""Colours."""
FASTEST = 0.995
"""Share of the rows whose speeds the friction curves span."""


def study_of_identification(found: Identification) -> Study:
    """Lay an identification out."""
    logs = ", ".join(recording.name for recording in found.recordings)
    lead = (
        f"Parameters of a double pendulum and its loop, from {logs}. Errors are those of motion that the fit "
        f"did not see, beside those of {found.start_name} with its best delay and lag."
    )
    parts = [_parameters(found), _errors(found), *_windows(found), _residuals(found), _friction(found)]
    return Study("Identified double pendulum", lead, parts, found.notes)


def _parameters(identification: Identification) -> Part:
    found = identification.estimates
    rows = [
        [name, shown(found.values[name], 4), f"{low:.4g} to {high:.4g}", _answer(found.determined.get(name))]
        for name, (low, high) in found.intervals.items()
    ]
    note = (
        f"SI units. Determined: the 95 % interval is no wider than {100 * NARROW:g} % of the value, or than "
        f"{1e3 * NARROW * OFFSET_SIZE:g} mrad for an offset. Intervals come from a bootstrap over logs and blocks."
    )
    return Part("Parameters", note, [Table(("Parameter", "Value", "95 % interval", "Determined"), rows)])


def _answer(sure: bool | None) -> str:
    return "yes" if sure else "no"


def _errors(found: Identification) -> Part:
    fitted, start = found.errors["fitted"], found.errors["start"]
    quantities = {"angle": "Angle (rad)", "velocity": "Velocity (rad/s)"}
    heads = [
        "After (s)",
        *(f"{title}: {name}" for title in quantities.values() for name in ("fitted", found.start_name)),
    ]
    rows = [
        [
            horizon,
            *(shown(getattr(errors[horizon], quantity)) for quantity in quantities for errors in (fitted, start)),
        ]
        for horizon in fitted
    ]
    note = f"Root mean square over {len(found.windows)} held-out windows and both joints."
    return Part("Held-out errors", note, [Table(heads, rows)])


def _windows(found: Identification) -> list[Part]:
    """Held-out windows of the first logs that have some, one after another."""
    parts = []
    for log in np.unique(found.windows.log)[:MOST_LOGS]:
        recording = found.recordings[log]
        windows = _apart(found.windows.take(np.flatnonzero(found.windows.log == log)))
        drawn = [
            (name, predicted_curves(found.setting, models[log], windows))
            for name, models in (("fitted", found.models), (found.start_name, found.start_models))
        ]
        panels = motion_panels(*smoothed(recording, PERIOD), drawn)
        note = (
            "Predictions over 0.5 s from the smoothed measurement, where the fit saw nothing and the joints move."
        )
        parts.append(Part(f"Held-out windows: {recording.name}", note, (), panels, over_time=True))
    return parts


def _apart(windows: Segments) -> Segments:
    """The windows that do not overlap."""
    kept: list[int] = []
    for row, time in enumerate(windows.start):
        if not kept or time >= windows.start[kept[-1]] + LENGTH - 1e-9:
            kept.append(row)
    return windows.take(np.array(kept, int))


def _residuals(found: Identification) -> Part:
    windows, output = found.windows, round(SPEED_HORIZON / INTERVAL) - 1
    speeds = fastest_speeds(windows, output + 1)
    errors = {
        (found.start_name, START): prediction_errors(found.setting, found.start_models, windows)[:, output],
        ("fitted", FITTED): prediction_errors(found.setting, found.models, windows)[:, output],
    }
    panels = [
        Panel("fastest joint in the window (rad/s)", f"error of {label}", [
            Curve(name, speeds, rows[:, place], colour, DOTS) for (name, colour), rows in errors.items()
        ])
        for place, label in enumerate(STATES)
    ]  # fmt: skip
    note = "Predicted minus measured after 0.25 s, one dot a held-out window. A trend shows what the model lacks."
    return Part("Residuals", note, (), panels if len(windows) else ())


def _friction(found: Identification) -> Part:
    estimates, start, panels = found.estimates, found.start_models[0], []
    fastest = max(float(np.quantile(np.abs(recording.dq), FASTEST)) for recording in found.recordings)
    v = np.linspace(-fastest, fastest, 401)
    slope = np.arctan(found.setting.steepness * v)
    for joint in (1, 2):
        names = (f"b{joint}", f"cf{joint}")
        b, cf = (estimates.values[name] for name in names)
        (b0, b1), (cf0, cf1) = (estimates.intervals.get(name, (estimates.values[name],) * 2) for name in names)
        ends = np.array([b0 * v + cf0 * slope, b1 * v + cf1 * slope])
        before = start[INDEX[names[0]]] * v + start[INDEX[names[1]]] * slope
        panels.append(Panel(f"velocity of joint {joint} (rad/s)", f"friction of joint {joint} (N m)", [
            Curve("", v, ends.min(axis=0), FITTED, BAND, ends.max(axis=0)),
            Curve("fitted", v, b * v + cf * slope, FITTED, LINE),
            Curve(found.start_name, v, before, START, THIN),
        ]))  # fmt: skip
    note = "b dq + cf arctan(s dq). The band has both coefficients at the same ends of their 95 % intervals."
    return Part("Friction", note, (), panels)
