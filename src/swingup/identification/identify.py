"""Identify a pendulum and its loop from logs: the parameters, how sure they are, and errors on held-out motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ..common.errors import SwingupError
from ..plant.plant import NAMES as PLANT_NAMES
from ..plant.plant import Plant, PlantLike, load_plant
from .fit.bootstrap import draw_solutions
from .fit.estimate import Problem, fit_all, fit_start, refit
from .fit.fit import Fit
from .fit.holdout import clear_of, held_out
from .fit.known import known_entries, session_numbers
from .fit.prediction import INDEX, NAMES, Setting, setting_of, vector_of
from .fit.regression import check_joints
from .fit.scoring import LENGTH, Errors, prediction_errors, score_windows, summarise
from .log.recording import Recording, read_recording, sensors
from .log.windows import FIT_LENGTH, Windows, cut_windows, join
from .notes import make_notes
from .plant_file import domain_of, representative, write_plant_files
from .results import TITLES, Estimates, read_solution


@dataclass(frozen=True)
class Identification:
    """A fitted plant and loop, with what a reader needs to trust it."""

    plant: Plant
    """A physically consistent pendulum with the fitted base parameters."""
    estimates: Estimates
    """Estimates, intervals, and which of them the logs determine."""
    errors: Mapping[str, Errors]
    """Of the fitted model and of the starting plant, on held-out motion."""
    domain: Mapping[str, Any]
    """Ranges of plant and loop: what was not determined stays wide."""
    notes: Sequence[str]
    """What a user should know of the logs and the fit."""
    start_name: str
    setting: Setting
    recordings: Sequence[Recording]
    """Those that were fitted, then those that were held out."""
    models: Float[np.ndarray, "logs 15"]
    """The fitted model of each recording, ``prediction.NAMES``; without the held-out motion."""
    start_models: Float[np.ndarray, "logs 15"]
    """The starting plant with its best delay and lag, likewise."""
    windows: Windows
    """The held-out windows that the errors are of."""

    def as_dict(self) -> dict[str, Any]:
        """As JSON values: parameters, intervals, determined and errors."""
        plant = {name: float(getattr(self.plant, name)) for name in PLANT_NAMES}
        return {
            "parameters": {**plant, **self.estimates.values},
            "intervals": {name: list(pair) for name, pair in self.estimates.intervals.items()},
            "determined": dict(self.estimates.determined),
            "errors": {name: {key: dict(row) for key, row in rows.items()} for name, rows in self.errors.items()},
        }

    def save(self, path: str | Path) -> Path:
        """Write the plant to a YAML file, and the domain beside it; returns the domain's path.

        Raises:
            SwingupError: a file cannot be written.
        """
        return write_plant_files(path, self.plant, self.domain, [recording.name for recording in self.recordings])


def identify(
    files: Sequence[str | Path],
    test: Sequence[str | Path] = (),
    start: PlantLike = "C.1",
    known: Mapping[str, float] | None = None,
    sessions: Sequence[str] | None = None,
    seed: int = 0,
) -> Identification:
    """Identify a double pendulum and its loop from logs.

    Args:
        files: logs to fit, CSV files of RealAIGym's or CloudPendulum's kind.
        test: logs to report errors on. Without them a log, or the last quarter of each, is held out for the
            errors; the parameters are then fitted to everything.
        start: the plant to start from: its lengths, gravity and gear ratio count as known.
        known: values that the user knows, such as ``{"m2r2": 0.16}``, ``{"Ir": 6e-5}`` or ``{"gain": 0.85}``.
        sessions: a label for each log, test logs last; torque gains are relative to the first session.
        seed: of the bootstrap.

    Raises:
        SwingupError: a log cannot be read or used, or an argument makes no sense.
    """
    if not files:
        raise SwingupError("no logs: give at least one CSV file")
    plant = load_plant(start)
    recordings = [read_recording(path) for path in files]
    tests = [read_recording(path) for path in test]
    numbers = session_numbers(sessions, len(recordings) + len(tests))
    problem = _pose(plant, recordings, tests, numbers, known)
    setting = problem.setting
    windows = join([cut_windows(each, FIT_LENGTH, log=log) for log, each in enumerate(recordings)])
    if tests:
        judged, kept = score_windows(tests), windows
        owners = numbers[len(recordings) :]
    else:
        judged, kept = _hold_out(recordings, windows)
        owners = numbers
    start_models = fit_start(problem, kept)
    solution = fit_all(problem, kept, start_models)
    errors = {
        "fitted": summarise(prediction_errors(setting, solution.models[owners], judged)),
        "start": summarise(prediction_errors(setting, start_models[owners], judged)),
    }
    final = solution if tests or not len(kept) else refit(problem, windows, solution)
    estimates, domain, fitted = _read(problem, final, windows, plant, seed)
    return Identification(
        plant=fitted,
        estimates=estimates,
        errors=errors,
        domain=domain,
        notes=make_notes([*recordings, *tests], problem, estimates, len(kept), len(judged)),
        start_name=plant.name,
        setting=setting,
        recordings=[*recordings, *tests],
        models=solution.models[numbers],
        start_models=start_models[numbers],
        windows=judged if not tests else replace(judged, log=judged.log + len(recordings)),
    )


def _pose(
    start: Plant,
    recordings: Sequence[Recording],
    tests: Sequence[Recording],
    numbers: Sequence[int],
    known: Mapping[str, float] | None,
) -> Problem:
    """What the fits share, after checks of the logs and their sessions."""
    setting, vector = setting_of(start), vector_of(start)
    check_joints([*recordings, *tests], setting, vector)
    problem = Problem(setting, vector, recordings, numbers[: len(recordings)], known_entries(known))
    if max(numbers) >= problem.count:
        raise SwingupError("a test log has a session of its own: fit at least one log of each session")
    return problem


def _hold_out(recordings: Sequence[Recording], windows: Windows) -> tuple[Windows, Windows]:
    """The windows to judge, and those of the fit that share no time with them."""
    everything = score_windows(recordings)
    judged = everything.take(np.flatnonzero(held_out(everything)))
    return judged, windows.take(np.flatnonzero(clear_of(windows, judged, FIT_LENGTH, LENGTH)))


def _read(
    problem: Problem, final: Fit, windows: Windows, start: Plant, seed: int
) -> tuple[Estimates, dict[str, Any], Plant]:
    """Intervals, the domain and the plant of a solution."""
    draws = draw_solutions(final, windows, seed)
    estimates = read_solution(final.unknowns, final.z, draws, problem.has_scale, list(problem.known), seed)
    model = dict(zip(NAMES, np.maximum(final.models[0], 0.0), strict=True))
    fitted = representative(model, start)
    model["A"] -= model["B"]  # as in the estimates
    value = {name: (float(model[name]), float(model[name])) for name in INDEX}
    ranges = {name: estimates.intervals.get(TITLES.get(name, name), value[name]) for name in value}
    loop = {name: list(ranges[name]) for name in ("offset1", "offset2")}
    if ranges["gain1"] != (1.0, 1.0):
        loop |= {name: list(ranges["gain1"]) for name in ("gain1", "gain2")}
    return estimates, domain_of(fitted, ranges, loop | sensors(problem.recordings)), fitted
