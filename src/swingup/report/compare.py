"""A log beside what plants predict of it, and beside a controller's simulated run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..common.errors import SwingupError
from ..controllers.registry import designs_for, get_controller
from ..identification.log.recording import Recording, read_recording
from ..identification.log.segments import Segments, cut_windows
from ..identification.open_loop import OpenLoop, predict_log, predicted_curves
from ..loop.domain import Domain
from ..loop.on_plant import loop_around
from ..plant.robots import Robot, get_robot
from .closed_loop import ClosedLoop, close_loop, driven_robot, starts_hanging

MOST_PLANTS = 4
"""So many colours can be told apart."""
DRAWN_LENGTH = 0.5
"""Length of the predictions that are drawn (s)."""


@dataclass(frozen=True)
class Comparison:
    """What a log shows of plants, and perhaps of a controller in their loops."""

    recording: Recording
    predictions: Sequence[OpenLoop]
    drawn: Sequence[Segments]
    """Of each plant: predictions of 0.5 s one after another."""
    runs: Mapping[str, ClosedLoop]
    """By plant; empty without a controller."""

    @property
    def notes(self) -> list[str]:
        """What a reader should know, one line each."""
        found = list(self.recording.warnings)
        if not self.predictions[0].horizons["0.1"].windows:
            found.append("no window of 0.5 s has a joint faster than 1 rad/s: there are no errors to report")
        if self.runs and not starts_hanging(self.recording):
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
) -> Comparison:
    """Compare a log with plants.

    Args:
        log: a CSV file, as ``swingup identify`` reads it.
        plants: by name; delay and lag that a plant's domain does not say are those that predict the log best.
        controller: a controller's name, whose run on each plant stands beside the log.
        loop: domain whose loop is around the plants in these runs; None for that of ``plants``.
        robot: which joint the controller drives; None for the joint with the log's torque.
        seed: of all that is drawn in these runs.

    Raises:
        SwingupError: the log cannot be used, or there is no such controller.
    """
    if not 0 < len(plants) <= MOST_PLANTS:
        raise SwingupError(f"{len(plants)} plants: give one to {MOST_PLANTS}")
    recording, runs = read_recording(log), {}
    if controller is not None:
        driven = driven_robot(recording) if robot is None else get_robot(robot)
        for name, domain in plants.items():
            around = loop_around(domain, loop)
            found = get_controller(controller, driven, plant=designs_for(controller, domain.nominal_plant))
            runs[name] = close_loop(recording, found, controller, driven, around, seed)
    predictions = [predict_log(recording, domain, name) for name, domain in plants.items()]
    windows = cut_windows(recording, DRAWN_LENGTH, stride=DRAWN_LENGTH, least_speed=0.0)
    drawn = [predicted_curves(each.setting, each.model, windows) for each in predictions]
    return Comparison(recording, predictions, drawn, runs)
