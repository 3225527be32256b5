"""Reports as tables and figures under headings: a log beside plants, an identification, and an adaptation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ..benchmark.board import CAUSES, Result
from ..benchmark.diagnosis import Diagnosis
from ..benchmark.log_comparison import ClosedLoop, Comparison
from ..benchmark.values import COLUMNS
from ..identification.identify import Identification
from ..identification.prediction import INDEX
from ..identification.recording import Recording
from ..identification.results import WIDEST_INTERVAL
from ..identification.scoring import (
    LENGTH,
    SPEED_HORIZON,
    ErrorRow,
    OpenLoop,
    fastest_speeds,
    predicted_curves,
    prediction_errors,
    smoothed,
)
from ..identification.segments import INTERVAL, Segments, clear_of_gaps
from ..identification.unknowns import LATENCY
from ..learner.card import best_policy, facts
from ..learner.metrics import METRICS_FILE, MISSING, read_metrics
from ..loop.domain import Domain
from ..plant.plant import get_robot
from .figure import DASHED, DOTS, LINE, THIN, Curve, Figure, Panel
from .figures import TIME, curves_figure, make_labels

DRAWN_PERIOD = 0.01  # between drawn rows (s)
STATES = ("q1 (rad)", "q2 (rad)", "dq1 (rad/s)", "dq2 (rad/s)")
TORQUES = ("u1 (N m)", "u2 (N m)")
ERRORS = ("Angle RMS (rad)", "median", "Velocity RMS (rad/s)", "median")
QUANTITIES = ("angle", "angle_median", "velocity", "velocity_median")
RUN_VALUES = ("Swing-up (s)", "Highest tip (%)", "Largest speed (rad/s)", "Energy (J)", "Torque cost (N² m² s)")
MAXIMUM_LOGS = 3  # logs whose held-out windows are drawn
FITTED, START = 0, 1  # series of the fitted plant, and of the one that the fit started from
SPEED_SHARE = 0.995  # share of the rows whose speeds the friction curves span


@dataclass(frozen=True)
class Table:
    """Rows of text under headings; the first column names the rows."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Part:
    """A part of a report under one heading."""

    title: str
    note: str
    tables: Sequence[Table] = ()
    figure: Figure | None = None


@dataclass(frozen=True)
class LogReport:
    """What a page about logs or runs shows."""

    title: str
    lead: str
    parts: Sequence[Part]
    notes: Sequence[str] = ()  # what a reader should know, one line each
    pendulums: bool = True  # whether the page says how a pendulum's angles count


def shown(value: float | None, digits: int = 3) -> str:
    """A number in a table; a dash where there is none."""
    return "–" if value is None or not np.isfinite(value) else f"{value:.{digits}g}"


def report_comparison(comparison: Comparison) -> LogReport:
    """Lay a comparison out: predictions over time, errors by horizon and by speed, and simulated runs."""
    recording = comparison.recording
    names = ", ".join(each.name for each in comparison.predictions)
    lead = (
        f"A log of {recording.duration:.3g} s with rows every {1e3 * recording.period:.3g} ms, beside open-loop "
        f"predictions of {names}. Each starts from the smoothed measurement, and the log's torques drive it."
    )
    runs = [_run(name, run) for name, run in comparison.runs.items()]
    parts = [_over_time(comparison), *_error_parts(comparison.predictions), *runs]
    return LogReport(f"{recording.name} beside {names}", lead, parts, comparison.notes)


def _states(series: Sequence[Sequence[Curve]]) -> list[Panel]:
    return [Panel(TIME, label, curves) for label, curves in zip(STATES, zip(*series, strict=True), strict=True)]


def _motion(name: str, time: np.ndarray, x: np.ndarray, colour: str | int = "ink", look: str = LINE) -> list[Curve]:
    return [Curve(name, time, each, colour, look) for each in x.T]


def _predictions(recording: Recording, predicted: Mapping[str, Segments]) -> list[Panel]:
    """A log, and predictions of it one after another with a row of NaN between two of them."""
    times, x = smoothed(recording, DRAWN_PERIOD)
    # Nobody measured what a smoother draws across a gap.
    series = [_motion("log", times, np.where(clear_of_gaps(recording, times, times)[:, None], x, np.nan))]
    for number, (name, part) in enumerate(predicted.items()):
        time = np.pad(part.times, ((0, 0), (0, 1)), constant_values=np.nan).ravel()
        x = np.pad(part.states, ((0, 0), (0, 1), (0, 0)), constant_values=np.nan).reshape(-1, 4)
        series.append(_motion(name, time, x, number, THIN))
    return _states(series)


def _interrupted(recording: Recording, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The times of a log and values, with a row of NaN in each gap."""
    gaps = np.flatnonzero(recording.gaps) + 1
    return np.insert(recording.time, gaps, recording.time[gaps - 1]), np.insert(values, gaps, np.nan)


def _over_time(comparison: Comparison) -> Part:
    recording = comparison.recording
    names = [each.name for each in comparison.predictions]
    panels = _predictions(recording, dict(zip(names, comparison.drawn, strict=True)))
    for joint in np.flatnonzero(recording.driven):
        u = Curve("log", *_interrupted(recording, recording.u[:, joint]), look=THIN, steps=True)
        panels.append(Panel(TIME, TORQUES[joint], [u]))
    best = ("", " (best for this log)")
    rows = [
        [each.name, *(f"{1e3 * each.model[INDEX[name]]:.1f} ms{best[name in each.fitted]}" for name in LATENCY)]
        for each in comparison.predictions
        if any(recording.driven)
    ]
    tables = [Table(("Plant", "Delay", "Lag"), rows)] if rows else []
    note = "Predictions last 0.5 s, one after another. Where a curve leaves the log, the plant is wrong."
    return Part("Predictions over time", note, tables, Figure(panels, shared=True))


_Errors: TypeAlias = Sequence[tuple[str, ErrorRow]]


def _error_parts(predictions: Sequence[OpenLoop]) -> list[Part]:
    by_horizon = {each.name: list(each.horizons.items()) for each in predictions}
    by_speed = {
        each.name: [(f"{row.slowest:.1f}–{row.fastest:.1f}", row.errors) for row in each.speeds]
        for each in predictions
    }
    note = (
        "Windows start every 0.1 s where a joint is faster than 1 rad/s. RMS is over windows and joints, the "
        "median over windows: it says more where the motion is unstable. Solid: RMS, dashed: median."
    )
    first = _error_part("Errors by horizon", "After (s)", "horizon (s)", note, by_horizon)
    note = "Errors after 0.25 s, of four groups of windows from slow to fast. Solid: RMS, dashed: median."
    label = "fastest joint (rad/s)"
    return [first, _error_part("Errors by speed", label.capitalize(), label, note, by_speed, True)]


def _error_part(
    title: str, head: str, label: str, note: str, errors: Mapping[str, _Errors], named: bool = False
) -> Part:
    """A table of errors, and angles and velocities side by side with a solid and a dashed curve for each plant."""
    rows = [
        [name, key, str(row.windows), *(shown(getattr(row, quantity)) for quantity in QUANTITIES)]
        for name, found in errors.items()
        for key, row in found
    ]
    keys = [key for key, _ in next(iter(errors.values()))]
    places = np.arange(float(len(keys))) if named else np.array(keys, float)
    axes: dict[str, Any] = {"ticks": keys} if named else {"logarithmic": True}
    panels = []
    for pair, unit in ((QUANTITIES[:2], "rad"), (QUANTITIES[2:], "rad/s")):
        curves = []
        for number, (name, found) in enumerate(errors.items()):
            # None becomes NaN.
            rms, median = (np.array([getattr(row, quantity) for _, row in found], float) for quantity in pair)
            curves += [Curve(name, places, rms, number), Curve("", places, median, number, DASHED)]
        panels.append(Panel(label, f"{pair[0]} error ({unit})", curves, **axes))
    tables = [Table(("Plant", head, "Windows", *ERRORS), rows)] if rows else []
    return Part(title, note, tables, Figure(panels, columns=2) if rows else None)


def _run(name: str, found: ClosedLoop) -> Part:
    runs = {"log": found.recorded, f"{name}, simulated": found.simulated}
    robot = get_robot(found.simulated.robot)
    looks: dict[str, Any] = dict(zip(runs, (("ink", LINE), (0, THIN)), strict=True))
    rows = {}
    for title, run in runs.items():
        if run.trajectory is not None:
            # Drawn rows are about half of DRAWN_PERIOD apart.
            every = max(1, round(DRAWN_PERIOD / float(np.median(np.diff(run.trajectory.time)))) // 2)
            rows[title] = run.trajectory.take(slice(None, None, every))
    panels = _states([_motion(title, each.time, each.x, *looks[title]) for title, each in rows.items()])
    torques = [Curve(title, each.time, each.u[:, robot.joint], *looks[title]) for title, each in rows.items()]
    note = (
        f"{found.simulated.controller} on the {robot.name}, from hanging at rest, simulated: {found.domain.name}. "
        "Unstable motions differ in timing: compare how high, how fast and how still they are, not their rows."
    )
    table = Table(("Run", "Outcome", *RUN_VALUES), [_outcome(title, run) for title, run in runs.items()])
    figure = Figure([*panels, Panel(TIME, TORQUES[robot.joint], torques)], shared=True)
    return Part(f"Closed loop: {name}", note, [table], figure)


def _outcome(name: str, run: Result) -> list[str]:
    criteria = run.criteria
    outcome = "up" if criteria.success else run.tip.failure or "failure"
    values = (criteria.swingup_time, run.tip.percent, run.runs[0].speed, criteria.energy, criteria.torque_cost)
    return [name, outcome, *map(shown, values)]


def report_identification(found: Identification) -> LogReport:
    """Lay an identification out: parameters, held-out errors and windows, residuals, and friction."""
    logs = ", ".join(recording.name for recording in found.recordings)
    lead = (
        f"Parameters of a double pendulum and its loop, from {logs}. Errors are those of motion that the fit "
        f"did not see, beside those of {found.start_name} with its best delay and lag."
    )
    parts = [*identification_tables(found), *_windows(found), _residuals(found), _friction(found)]
    return LogReport("Identified double pendulum", lead, parts, found.notes)


def identification_tables(found: Identification) -> list[Part]:
    """The parts of an identification's report that are tables alone: parameters and held-out errors."""
    return [_parameters(found), _errors(found)]


def _parameters(identification: Identification) -> Part:
    found = identification.estimates
    sure = {name: "yes" if found.determined.get(name) else "no" for name in found.intervals}
    rows = [
        [name, shown(found.values[name], 4), f"{low:.4g} to {high:.4g}", sure[name]]
        for name, (low, high) in found.intervals.items()
    ]
    note = (
        f"SI units. Determined: the 95 % interval is no wider than {WIDEST_INTERVAL}. Intervals come from a "
        "bootstrap over logs and blocks."
    )
    return Part("Parameters", note, [Table(("Parameter", "Value", "95 % interval", "Determined"), rows)])


def _errors(found: Identification) -> Part:
    quantities, names = {"angle": "Angle (rad)", "velocity": "Velocity (rad/s)"}, ("fitted", found.start_name)
    heads = ["After (s)", *(f"{title}: {name}" for title in quantities.values() for name in names)]
    errors = [found.errors[key] for key in ("fitted", "start")]
    rows = [
        [horizon, *(shown(getattr(each[horizon], quantity)) for quantity in quantities for each in errors)]
        for horizon in errors[0]
    ]
    note = f"Root mean square over {len(found.windows)} held-out windows and both joints."
    return Part("Held-out errors", note, [Table(heads, rows)])


def _windows(found: Identification) -> list[Part]:
    """Held-out windows of the first logs that have some, one after another."""
    parts = []
    for log in np.unique(found.windows.log)[:MAXIMUM_LOGS]:
        recording = found.recordings[log]
        windows = _apart(found.windows.take(np.flatnonzero(found.windows.log == log)))
        models = {"fitted": found.models, found.start_name: found.start_models}
        drawn = {name: predicted_curves(found.setting, each[log], windows) for name, each in models.items()}
        note = "Predictions over 0.5 s from the smoothed measurement, where the fit saw nothing and joints move."
        figure = Figure(_predictions(recording, drawn), shared=True)
        parts.append(Part(f"Held-out windows: {recording.name}", note, (), figure))
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
    series = []
    for name, colour, models in ((found.start_name, START, found.start_models), ("fitted", FITTED, found.models)):
        errors = prediction_errors(found.setting, models, windows)[:, output]
        series.append([Curve(name, speeds, each, colour, DOTS) for each in errors.T])
    label = "fastest joint in the window (rad/s)"
    panels = [replace(panel, x=label, y=f"error of {panel.y}") for panel in _states(series)]
    note = "Predicted minus measured after 0.25 s, one dot a held-out window. A trend shows what the model lacks."
    return Part("Residuals", note, (), Figure(panels, columns=2) if len(windows) else None)


def _friction(found: Identification) -> Part:
    estimates, start, panels = found.estimates, found.start_models[0], []
    fastest = max(float(np.quantile(np.abs(recording.dq), SPEED_SHARE)) for recording in found.recordings)
    v = np.linspace(-fastest, fastest, 401)
    slope = np.arctan(found.setting.steepness * v)
    for joint in (1, 2):
        names = (f"b{joint}", f"cf{joint}")
        b, cf = (estimates.values[name] for name in names)
        (b0, b1), (cf0, cf1) = (estimates.intervals.get(name, (estimates.values[name],) * 2) for name in names)
        band = np.sort([b0 * v + cf0 * slope, b1 * v + cf1 * slope], axis=0).T
        before = start[INDEX[names[0]]] * v + start[INDEX[names[1]]] * slope
        panels.append(Panel(f"velocity of joint {joint} (rad/s)", f"friction of joint {joint} (N m)", [
            Curve("fitted", v, b * v + cf * slope, FITTED, interval=band),
            Curve(found.start_name, v, before, START, THIN),
        ]))  # fmt: skip
    note = "b dq + cf arctan(s dq). The band has both coefficients at the same ends of their 95 % intervals."
    return Part("Friction", note, (), Figure(panels, columns=2))


def report_diagnosis(found: Diagnosis) -> LogReport:
    """Lay a diagnosis out: the causes, the loop and the plant, and the log itself."""
    recording = found.recording
    columns = (*recording.q.T, *recording.dq.T, *recording.u.T)
    series = [Curve("log", *_interrupted(recording, each)) for each in columns]
    panels = [Panel(TIME, label, [each]) for label, each in zip((*STATES, *TORQUES), series, strict=True)]
    log = Part("Log", "What the controller saw and commanded.", (), Figure(panels, shared=True))
    return LogReport(f"Diagnosis of {recording.name}", found.answer, [*diagnosis_tables(found), log], found.lines)


def diagnosis_tables(found: Diagnosis) -> list[Part]:
    """The tables of a diagnosis."""
    causes = [[each.name, each.sure, each.text] for each in found.causes]
    tables = [
        ("Causes", "Likeliest first.", ("Cause", "Sure", "What the log shows"), causes),
        ("Loop", "As the log shows it.", ("", "Value"), [list(each) for each in found.loop.items()]),
        (
            "Plant and loop",
            "What differs from what the policy assumes, in ordinary spreads.",
            ("Name", "Assumed", "Found", "Spreads"),
            [list(each) for each in found.differences],
        ),
    ]
    return [Part(title, note, [Table(heads, rows)]) for title, note, heads, rows in tables if rows]


def report_adaptation(domain: Domain, result: Result) -> LogReport:
    """Lay an adaptation to a domain out, with its result on the board ``sim2real``, on other draws."""
    low, high = result.success_interval
    lead = (
        f"A policy for the {result.robot} that finds its plant, for draws of {domain.name}. On "
        f"{len(result.runs)} other draws it swings up and stays {result.successes} times "
        f"({low:.0%} to {high:.0%}, 95 % interval)."
    )
    ranges = [[name, shown(a, 4), shown(b, 4)] for name, a, b in domain.ranges]
    drawn = Part("Domain", "SI units; each draw takes each number evenly.", [Table(("Name", "From", "To"), ranges)])
    return LogReport(f"Adapted {result.robot}", lead, [_judged(result), drawn])


def _judged(result: Result) -> Part:
    values = [[COLUMNS[name].title, COLUMNS[name].show(value)] for name, value in result.values.items()]
    failed = [(run.case.settings.get("seed"), run.tip) for run in result.runs if not run.success]
    causes = [
        [cause, ", ".join(str(seed) for seed, tip in failed if tip is not None and tip.cause == cause) or "–"]
        for cause in CAUSES
    ]
    assert result.trajectory is not None
    rows = result.trajectory.take(slice(None))
    motion = zip((*STATES, *TORQUES), (*rows.x.T, *rows.u.T), strict=True)
    panels = [Panel(TIME, label, [Curve("first draw", rows.time, each)]) for label, each in motion]
    tables = [Table(("Board sim2real", "Value"), values), Table(("Failed", "Seeds"), causes)]
    note = "The first one is drawn."
    return Part("Draws that training did not see", note, tables, Figure(panels, shared=True))


def learning_curves(runs: Sequence[str | Path]) -> Figure:
    """The metrics of runs, from their folders or from files of metrics."""
    files = [_metrics_file(run) for run in runs]
    return curves_figure(dict(zip(make_labels(files), map(read_metrics, files), strict=True)))


def curves_part(runs: Sequence[str | Path]) -> Part:
    """The metrics of runs as a part of a page."""
    note = "Reward rate and resets are the exploring policy's. A dot is an evaluation, the line the best so far."
    return Part("Learning curves", note, figure=learning_curves(runs))


def report_runs(runs: Sequence[str | Path]) -> LogReport:
    """Lay out runs, each in its folder: facts of the best policies, and the learning curves."""
    files, curves = [_metrics_file(run) for run in runs], curves_part(runs)
    names, found = make_labels(files), [facts(best_policy(file.parent)) for file in files]
    keys = dict.fromkeys(key for each in found for key in each)
    rows = [[key, *(each.get(key, MISSING) for each in found)] for key in keys]
    best = Part("Best policies", "By the score of their evaluations.", [Table(["", *names], rows)])
    return LogReport(", ".join(names), "Training runs by swingup.", [best, curves], pendulums=False)


def _metrics_file(run: str | Path) -> Path:
    return Path(run) / METRICS_FILE if Path(run).is_dir() else Path(run)
