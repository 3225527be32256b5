"""Identify a pendulum and its loop from logs: the parameters, how sure they are, and errors on held-out motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ..common.errors import SwingupError
from ..plant.plant import Plant, PlantLike, load_plant
from .fit.bootstrap import draw_solutions
from .fit.fit import Fit, fit_all, fit_start, refit
from .fit.prediction import NAMES, Integration, integration_of, vector_of
from .fit.problem import Problem, known_entries, session_numbers
from .fit.regression import check_joints
from .fit.scoring import Errors, hold_out, prediction_errors, score_windows, summarise
from .log.recording import Recording, read_recording, sensors
from .log.segments import FIT_LENGTH, Segments, cut_windows, join
from .plant_file import domain_of, representative, write_plant_files
from .results import TITLES, Estimates, make_notes, read_solution

REPORTED = ("angle", "velocity")
"""Errors of a row that results report."""


@dataclass(frozen=True)
class Identification:
    """A fitted plant and loop, with what a reader needs to trust it."""

    plant: Plant
    """A physically consistent pendulum with the fitted base parameters."""
    estimates: Estimates
    """Estimates, intervals, and which of them the logs determine."""
    errors: Mapping[str, Errors]
    """Errors of the fitted model and of the starting plant, on held-out motion."""
    domain: Mapping[str, Any]
    """Ranges of plant and loop: what was not determined stays wide."""
    notes: Sequence[str]
    """What a user should know of the logs and the fit."""
    start_name: str
    setting: Integration
    recordings: Sequence[Recording]
    """Those that were fitted, then those that were held out."""
    models: Float[np.ndarray, "logs 15"]
    """The fitted model of each recording, ``prediction.NAMES``, from motion that is not held out."""
    start_models: Float[np.ndarray, "logs 15"]
    """The model of the starting plant with its best delay and lag."""
    windows: Segments
    """The held-out windows that the errors are of."""

    def as_dict(self) -> dict[str, Any]:
        """As JSON values: parameters, intervals, determined and errors."""
        return {
            "parameters": self.plant.values() | dict(self.estimates.values),
            "intervals": {name: list(pair) for name, pair in self.estimates.intervals.items()},
            "determined": dict(self.estimates.determined),
            "errors": {
                name: {horizon: {each: getattr(row, each) for each in REPORTED} for horizon, row in rows.items()}
                for name, rows in self.errors.items()
            },
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
    plant, recordings, tests = load_plant(start), [*map(read_recording, files)], [*map(read_recording, test)]
    numbers = session_numbers(sessions, len(recordings) + len(tests))
    setting, vector = integration_of(plant), vector_of(plant)
    check_joints([*recordings, *tests], setting, vector)
    problem = Problem(setting, vector, recordings, numbers[: len(recordings)], known_entries(known))
    if max(numbers) > max(problem.sessions):
        raise SwingupError("a test log has a session of its own: fit at least one log of each session")
    windows = join([cut_windows(each, FIT_LENGTH, log=log) for log, each in enumerate(recordings)])
    if tests:
        judged, kept = score_windows(tests), windows
        judged = replace(judged, log=judged.log + len(recordings))
    else:
        judged, kept = hold_out(score_windows(recordings), windows)
    start_fit = fit_start(problem, kept)
    solution = fit_all(problem, kept, start_fit)
    models, start_models = solution.models[numbers], start_fit[numbers]
    final = solution if tests or not len(kept) else refit(problem, windows, solution)
    estimates = read_solution(problem, final.unknowns, final.z, draw_solutions(final, windows, seed), seed)
    fitted, domain = _plant_and_domain(problem, final, estimates, plant)
    return Identification(
        plant=fitted,
        estimates=estimates,
        errors={
            "fitted": summarise(prediction_errors(setting, models, judged)),
            "start": summarise(prediction_errors(setting, start_models, judged)),
        },
        domain=domain,
        notes=make_notes([*recordings, *tests], problem, estimates, len(kept), len(judged)),
        start_name=plant.name,
        setting=setting,
        recordings=[*recordings, *tests],
        models=models,
        start_models=start_models,
        windows=judged,
    )


def _plant_and_domain(
    problem: Problem, final: Fit, estimates: Estimates, start: Plant
) -> tuple[Plant, dict[str, Any]]:
    """A pendulum with the fitted base parameters, and ranges around it and its loop."""
    model = dict(zip(NAMES, np.maximum(final.models[0], 0.0).tolist(), strict=True))
    fitted = representative(model, start)
    model["A"] -= model["B"]  # as in the estimates
    ranges = {
        name: estimates.intervals.get(TITLES.get(name, name), (value, value)) for name, value in model.items()
    }
    loop = {name: list(ranges[name]) for name in ("offset1", "offset2")}
    if ranges["gain1"] != (1.0, 1.0):
        loop |= {name: list(ranges["gain1"]) for name in ("gain1", "gain2")}
    return fitted, domain_of(fitted, ranges, loop | sensors(problem.recordings))
