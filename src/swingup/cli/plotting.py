"""The command ``plot``: figures and animations of trajectories, results and runs."""

from typing import Annotated

from tyro.conf import arg

from ..benchmark.recording import driven_robot, load_trajectory
from ..common.checks import one_of
from ..common.errors import SwingupError
from ..common.files import check_suffix, check_writable, write_atomically
from ..learner.metrics import read_metrics
from ..report.draw import FIGURE_FORMATS, draw, render
from ..report.figures import (
    curves_figure,
    make_labels,
    phase_figure,
    read_robustness,
    robustness_figure,
    trajectory_figure,
)
from ..report.film import FILM_FORMATS, FPS, SIZE, animate
from .arguments import NO_OPTIONS, Names, PlantOptions, RobotName, plant_of
from .output import tell

PLOT_KINDS = ("trajectory", "phase", "animation", "robustness", "curve")


def plot_command(
    kind: Annotated[str, arg(metavar="KIND")],
    files: Annotated[tuple[str, ...], arg(metavar="FILE...")],
    /,
    out: str,
    robot: RobotName | None = None,
    plant: PlantOptions = NO_OPTIONS,
    columns: Names = (),
    fps: float = FPS,
    size: int = SIZE,
    speed: float = 1.0,
) -> None:
    """Draw figures from files: .png, .svg or .pdf; animations: .gif or .webp.

    Args:
        kind: trajectory, phase or animation, from CSV files; robustness, from the JSON of evaluate --board
            robustness --json; or curve, from metrics.jsonl.
        files: the files to draw.
        out: the picture's file.
        robot: the robot of the trajectories; by default the one whose driven joint alone has torque.
        plant: the trajectories' pendulum: its lengths and its torque limit.
        columns: names and units of the trajectories' columns, as of score.
        fps: frames a second of an animation.
        size: height of an animation (pixels).
        speed: speed of an animation; 1 is real time.
    """
    check_writable(out)
    one_of("kind of plot", kind, PLOT_KINDS)
    if not files:
        raise SwingupError("nothing to draw: give at least one file")
    suffix, found = check_suffix(out, FILM_FORMATS if kind == "animation" else FIGURE_FORMATS), plant_of(plant)
    labels = make_labels(files)
    if kind == "robustness":
        figure = robustness_figure(dict(zip(labels, map(read_robustness, files), strict=True)))
    elif kind == "curve":
        figure = curves_figure(dict(zip(labels, map(read_metrics, files), strict=True)))
    else:
        trajectories = [load_trajectory(file, columns) for file in files]
        robots = [robot or driven_robot(file, rows.u) for file, rows in zip(files, trajectories, strict=True)]
        if kind == "animation":
            animate(list(zip(trajectories, robots, strict=True)), out, fps, size, speed, found)
            tell(out)
            return
        for file, other in zip(files, robots, strict=True):
            if other != robots[0]:
                of = f"{files[0]} is of the {robots[0].name}, {file} of the {other.name}"
                raise SwingupError(f"{of}: draw two pictures")
        named = dict(zip(labels, trajectories, strict=True))
        figure = phase_figure(named, robots[0]) if kind == "phase" else trajectory_figure(named, robots[0], found)
    write_atomically(out, render(draw(figure), suffix))
    tell(out)
