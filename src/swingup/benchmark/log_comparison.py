"""A log beside what plants predict of it, and beside a controller's simulated run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ..common.errors import SwingupError
from ..controllers.registry import controller_on
from ..dynamics.dynamics import wrap_difference
from ..identification.conventions import check_columns
from ..identification.prediction import integration_of, vector_of
from ..identification.recording import Recording, read_recording
from ..identification.scoring import OpenLoop, predict_log, predicted_curves
from ..identification.segments import Segments, cut_windows
from ..loop.domain import Domain
from ..loop.resolve import resolve
from ..plant.plant import Robot, get_robot
from .board import Result
from .boards import HARDWARE
from .judge import judge, score
from .plausibility import HANGING_TOLERANCE
from .recording import NO_ZEROS, driven_robot
from .rollout import Trajectory

MAX_PLANTS = 4  # Maximum number of plants: readers can tell four colours apart
DRAWN_LENGTH = 0.5  # Length of the predictions that are drawn (s)
MAX_RUN_DURATION = 120.0  # Maximum duration of a simulated run (s)


@dataclass(frozen=True)
class ClosedLoop:
    """The recorded run, and the controller's on a simulated plant in its loop, judged for as long."""

    domain: Domain
    recorded: Result
    simulated: Result

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        runs = {"recorded": self.recorded, "simulated": self.simulated}
        head = {"domain": {"name": self.domain.name} | self.domain.as_dict()}
        return head | {name: run.as_dict() | {"speed": run.runs[0].speed} for name, run in runs.items()}


@dataclass(frozen=True)
class Comparison:
    """What a log shows of plants, and perhaps of a controller in their loops."""

    recording: Recording
    predictions: Sequence[OpenLoop]
    drawn: Sequence[Segments]  # For each plant predictions of 0.5 s, one after another
    runs: Mapping[str, ClosedLoop]  # By plant; empty without a controller

    @property
    def notes(self) -> list[str]:
        """What a reader should know, one line each."""
        found = list(self.recording.warnings)
        if not self.predictions[0].horizons["0.1"].windows:
            found.append("no window of 0.5 s has a joint faster than 1 rad/s: there are no errors to report")
        if self.runs and np.abs(wrap_difference(self.recording.q[0])).max() > HANGING_TOLERANCE[0]:
            found.append("the simulated run begins hanging at rest, the log does not")
        return found

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        plants = {each.name: each.as_dict() for each in self.predictions}
        for name, run in self.runs.items():
            plants[name]["closed_loop"] = run.as_dict()
        return {
            "log": self.recording.name,
            "duration": self.recording.duration,
            "plants": plants,
            "notes": self.notes,
        }


def compare(
    log: str | Path,
    plants: Mapping[str, Domain],
    controller: str | None = None,
    loop: Domain | str | None = None,
    robot: Robot | str | None = None,
    seed: int = 0,
    columns: Sequence[str] = (),
) -> Comparison:
    """Compare a log, as ``swingup identify`` reads it, with plants.

    Delay and lag that a plant's domain does not say are those that predict the log best. A controller's run on each
    plant stands beside the log: with the loop of ``loop``, or None for that of ``plants``, and by default on the
    robot whose joint has the log's torque. The seed is of all that is drawn in these runs.
    """
    if not 0 < len(plants) <= MAX_PLANTS:
        raise SwingupError(f"{len(plants)} plants: give one to {MAX_PLANTS}")
    recording, runs = read_recording(log, columns=columns), {}
    first = next(iter(plants.values())).nominal_plant
    doubts = check_columns(recording, integration_of(first), vector_of(first), force=True)
    recording = replace(recording, warnings=(*recording.warnings, *doubts))
    if controller is not None:
        driven = driven_robot(recording.name, recording.u) if robot is None else get_robot(robot)
        for name, domain in plants.items():
            around = resolve(domain, loop)
            found = controller_on(controller, driven, domain.nominal_plant)
            runs[name] = close_loop(recording, found, controller, driven, around, seed)
    predictions = [predict_log(recording, domain, name) for name, domain in plants.items()]
    windows = cut_windows(recording, DRAWN_LENGTH, stride=DRAWN_LENGTH, minimum_speed=0.0)
    drawn = [predicted_curves(each.setting, each.model, windows) for each in predictions]
    return Comparison(recording, predictions, drawn, runs)


def close_loop(
    recording: Recording, controller: Any, name: str, robot: Robot, domain: Domain, seed: int = 0
) -> ClosedLoop:
    """Run a controller from rest on a plant and a loop drawn from the domain, for as long as the log lasts."""
    board = replace(HARDWARE, duration=min(recording.duration, MAX_RUN_DURATION))
    run = judge(controller, robot, replace(board, domain=domain.name), 1, seed=seed, name=name, domain=domain)
    simulated, plant = run.trajectory, jax.tree.map(float, run.runs[0].case.scenario.parameters)
    assert simulated is not None
    x = np.concatenate([recording.q, recording.dq], axis=1) - np.append(plant.zeros, NO_ZEROS)
    measured = Trajectory(recording.time, x, recording.u)
    # Forced: a log that the plant does not explain is what this compares.
    found = [
        score(rows, robot, board, name=each, plant=plant, force=True)
        for rows, each in ((measured, recording.name), (simulated, name))
    ]
    return ClosedLoop(domain, *found)
