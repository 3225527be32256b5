"""Identify a pendulum and its loop from logs: parameters, their intervals, and errors on held-out motion."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ..common import __version__
from ..common.checks import check_seeds
from ..common.errors import SwingupError, one_line
from ..common.files import write_map
from ..loop.resolve import resolve
from ..plant.files import is_model_file, representative, save_plant
from ..plant.plant import Plant, PlantLike
from .conventions import check_columns
from .fit import WARM_STAGES, Fit, between, draw_solutions, fit, fit_all, fit_start, pulled
from .prediction import INDEX, NAMES, Integration, integration_of, vector_of
from .recording import Recording, read_recording, sensors
from .results import (
    TITLES,
    USUAL_LATENCY,
    Estimates,
    bound_notes,
    domain_of,
    make_notes,
    mass_notes,
    read_solution,
    session_tail,
)
from .scoring import Errors, hold_out, prediction_errors, score_windows, summarise
from .segments import FIT_LENGTH, Segments, cut_windows, join
from .unknowns import LATENCY, Problem, known_entries, session_numbers


@dataclass(frozen=True)
class Identification:
    """A fitted plant and loop, with intervals, held-out errors and notes."""

    plant: Plant
    """A physically consistent pendulum with the fitted base parameters."""
    estimates: Estimates
    """Estimates, intervals, and which of them the logs determine."""
    errors: Mapping[str, Errors]
    """Errors of the fitted model and of the starting plant, on held-out motion."""
    domain: Mapping[str, Any]
    """Ranges of plant and loop, which stay wide where a value was not determined."""
    notes: Sequence[str]
    """Notes on the logs and the fit, one line each."""
    start_name: str
    setting: Integration
    recordings: Sequence[Recording]
    """Recordings that were fitted, then recordings that were held out."""
    models: Float[np.ndarray, "logs 15"]
    """The fitted model of each recording, ``prediction.NAMES``, from motion that is not held out."""
    start_models: Float[np.ndarray, "logs 15"]
    """The model of the starting plant with its best delay and lag."""
    windows: Segments
    """The held-out windows that the errors are of."""

    def as_dict(self) -> dict[str, Any]:
        """Parameters, intervals, determined and errors, as JSON values."""
        return {
            "parameters": self.plant.values() | dict(self.estimates.values),
            "intervals": {name: list(pair) for name, pair in self.estimates.intervals.items()},
            "determined": dict(self.estimates.determined),
            "errors": {
                name: {horizon: {"angle": row.angle, "velocity": row.velocity} for horizon, row in rows.items()}
                for name, rows in self.errors.items()
            },
        }

    def save(self, path: str | Path, *more: str | Path) -> Path:
        """Write the plant to files (.yml, .urdf or .xml), and the domain beside the first; returns its path."""
        logs = one_line(", ".join(recording.name for recording in self.recordings), 500)
        source = f"Source: swingup {__version__} identify, from {logs}."
        # Models first: one that is refused leaves no plant without its domain.
        for each in sorted((path, *more), key=is_model_file, reverse=True):
            note = "SI units. m1, m2, r1, r2 and I1 are one choice of many that move alike."
            save_plant(each, self.plant, [source, note])
        beside = Path(path).with_name(f"{Path(path).stem}-domain.yml")
        note = "Ranges of the plant and its loop: 95 % intervals, narrowed where they make no pendulum."
        write_map(beside, self.domain, source, note)
        return beside


def identify(
    files: Sequence[str | Path] | str | Path,
    test: Sequence[str | Path] | str | Path = (),
    start: PlantLike = "C.1",
    known: Mapping[str, float] | None = None,
    sessions: Sequence[str] | None = None,
    seed: int = 0,
    columns: Sequence[str] | str = (),
    force: bool = False,
) -> Identification:
    """Identify a double pendulum and its loop from logs.

    Args:
        files: logs to fit: CSV and its relatives, npz or mat.
        test: logs to report errors on. Without them a log, or the last quarter of each, is held out for the
            errors; the parameters are then fitted to everything.
        start: the plant to start from: its lengths, gravity and gear ratio count as known.
        known: values that the user knows, such as ``{"m2r2": 0.16}``, ``{"Ir": 6e-5}`` or ``{"gain": 0.85}``.
        sessions: a label for each log, test logs last; torque gains are relative to the first with torques.
        seed: of the bootstrap.
        columns: words that map the columns of all logs, as in ``["time=t", "q1=theta1:deg"]``
            (:mod:`swingup.common.columns`).
        force: whether logs are taken as they are that look as if they had other columns, units or conventions.

    Raises:
        SwingupError: a log cannot be read or used, or an argument makes no sense.
    """
    check_seeds(seed, 1)
    files, test = ([each] if isinstance(each, str | Path) else each for each in (files, test))
    columns = [columns] if isinstance(columns, str) else columns
    if not files:
        raise SwingupError("no logs: give at least one file")
    plant = resolve(start).facts
    recordings, tests = ([read_recording(log, columns, force) for log in logs] for logs in (files, test))
    numbers = session_numbers(sessions, len(recordings) + len(tests))
    setting, vector = integration_of(plant), vector_of(plant)
    notes = [note for each in (*recordings, *tests) for note in check_columns(each, setting, vector, force)]
    problem = Problem(setting, vector, recordings, numbers[: len(recordings)], known_entries(known))
    if max(numbers) > max(problem.sessions):
        raise SwingupError("a test log has a session of its own: fit at least one log of each session")
    windows = join([cut_windows(each, FIT_LENGTH, log=log) for log, each in enumerate(recordings)])
    if tests:
        judged, kept = score_windows(tests), windows
        judged = replace(judged, log=judged.log + len(recordings))
    else:
        driven = [any(each.driven) for each in recordings]
        judged, kept = hold_out(score_windows(recordings), windows, problem.sessions, driven)
    # The starting plant gets its best delay and lag too, fitted to the same motion: otherwise the comparison would
    # favour the fit.
    start_fit = fit_start(problem, kept)
    solution = fit_all(problem, kept, start_fit)
    start_models = start_fit[numbers]
    share = _best_share(setting, solution, start_fit, judged, numbers)
    # The reported parameters use all motion. The errors stay those of the fit without the held-out motion.
    final = solution
    if not tests and len(kept):
        final = fit(setting, windows, solution.unknowns, solution.z, WARM_STAGES)
    share = min(share, _possible_share(final, start_fit, plant))
    solution, whole = pulled(problem, kept, solution, start_fit, share), final
    final = pulled(problem, windows, final, start_fit, share)
    draws = draw_solutions(final, windows, seed)
    if share < 1.0:
        notes.append(_pulled_note(share))
        # What the logs say by themselves is possible, too.
        draws = np.concatenate([draws, draw_solutions(whole, windows, seed)])
    notes += mass_notes(problem, final.models[0])
    notes += bound_notes(final.unknowns, final.z)
    models = solution.models[numbers]
    estimates = read_solution(problem, final.unknowns, final.z, draws, seed)
    fitted, domain = _plant_and_domain(problem, final, estimates, plant)
    return Identification(
        plant=fitted,
        estimates=estimates,
        errors={
            "fitted": summarise(prediction_errors(setting, models, judged)),
            "start": summarise(prediction_errors(setting, start_models, judged)),
        },
        domain=domain,
        notes=(*notes, *make_notes([*recordings, *tests], problem, estimates, len(kept), len(judged))),
        start_name=plant.name,
        setting=setting,
        recordings=[*recordings, *tests],
        models=models,
        start_models=start_models,
        windows=judged,
    )


SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)
"""Shares of the way from the starting plant to the fit that are tried on held-out motion."""


def _best_share(
    setting: Integration,
    solution: Fit,
    start: Float[np.ndarray, "sessions 15"],
    judged: Segments,
    numbers: Sequence[int],
) -> float:
    """The share of the way from the start that predicts held-out motion best: all, unless the start is better."""

    def error(models: Float[np.ndarray, "sessions 15"]) -> float:
        found = summarise(prediction_errors(setting, models[numbers], judged), [FIT_LENGTH])
        return found[f"{FIT_LENGTH:g}"].angle or 0.0

    # Only a fit that is worse is pulled back: a share that is chosen on held-out motion makes the errors there
    # look better than they are.
    if error(solution.models) <= error(start):
        return 1.0
    return min(SHARES, key=lambda share: error(solution.unknowns.models(between(solution, start, share))))


def _possible_share(final: Fit, start: Float[np.ndarray, "sessions 15"], plant: Plant) -> float:
    """The largest share of the way whose base parameters a pendulum has."""
    for share in np.arange(1.0, 0.0, -0.05):
        model = final.unknowns.models(between(final, start, float(share)))[0]
        with contextlib.suppress(SwingupError):
            representative(dict(zip(NAMES, np.maximum(model, 0.0).tolist(), strict=True)), plant)
            return float(share)
    return 0.0


def _pulled_note(share: float) -> str:
    if share == 0.0:
        return (
            "the fit predicts held-out motion worse than the starting plant does, or no pendulum has its values: "
            "the starting plant is kept"
        )
    return (
        f"the whole fit predicts held-out motion worse than the starting plant, or no pendulum has its values: "
        f"{share:.0%} of the way to it is taken"
    )


def _plant_and_domain(
    problem: Problem, final: Fit, estimates: Estimates, start: Plant
) -> tuple[Plant, dict[str, Any]]:
    """A pendulum with the fitted base parameters, and ranges around it and its loop."""
    offsets = {name: float(final.models[0, INDEX[name]]) for name in ("offset1", "offset2")}
    model = dict(zip(NAMES, np.maximum(final.models[0], 0.0).tolist(), strict=True)) | offsets
    fitted = representative(model, start).changed(zero1=offsets["offset1"], zero2=offsets["offset2"])
    model["A"] -= model["B"]  # as in the estimates
    # The loop is that of the first session with torques.
    unit = problem.unit_session
    model |= {name: float(final.models[unit, INDEX[name]]) for name in ("gain1", "gain2", *LATENCY)}
    tails = dict.fromkeys(model, "") | dict.fromkeys(("gain1", "gain2", *LATENCY), session_tail(unit))
    ranges = {
        name: estimates.intervals.get(TITLES.get(name, name) + tails[name], (value, value))
        for name, value in model.items()
    }
    if not problem.driven:  # nothing shows what the loop is
        ranges |= {name: each for name, each in USUAL_LATENCY.items() if name not in problem.known}
    # What the zeros of the plant leave.
    loop = {name: [end - zero for end in ranges[name]] for name, zero in offsets.items()}
    # A gain that was not fitted is 1 by convention, which says nothing of the motors.
    if ranges["gain1"] != (1.0, 1.0):
        loop |= {name: list(ranges["gain1"]) for name in ("gain1", "gain2")}
    return fitted, domain_of(fitted, ranges, loop | sensors(problem.recordings))
