"""One function from files to a picture: the kinds of pictures, and the files that each kind reads."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..benchmark.trajectory_file import load_trajectory
from ..common.checks import one_of
from ..common.errors import SwingupError
from ..common.files import write_atomically
from ..plant.plant import LEADERBOARD, PlantLike
from ..plant.robots import Robot, get_robot
from .draw import FIGURE_FORMATS, draw, render
from .figures import curves_figure, phase_figure, robustness_figure, trajectory_figure
from .film import FILM_FORMATS, FPS, SIZE, animate
from .inputs import check_suffix, driven_robot, make_labels, read_curve, read_robustness
from .log_report import LogReport
from .page import render_log_page

PAGE_FORMATS = (".html", *FIGURE_FORMATS)
PLOT_KINDS = ("trajectory", "phase", "animation", "robustness", "curve")


def save_log_report(report: LogReport, out: str | Path) -> None:
    """Write a report about logs as a page, or its figures as a picture, by the file's suffix; whole or not at all.

    Raises:
        SwingupError: an unknown suffix, nothing to draw, a missing library, or a file that cannot be written.
    """
    suffix = check_suffix(out, PAGE_FORMATS)
    if suffix == ".html":
        write_atomically(out, render_log_page(report).encode())
        return
    figures = {part.title: part.figure for part in report.parts if part.figure is not None}
    write_atomically(out, render(draw(figures, report.title), suffix))


def save_plot(
    kind: str,
    files: Sequence[str | Path],
    out: str | Path,
    robot: Robot | str | None = None,
    fps: float = FPS,
    size: int = SIZE,
    speed: float = 1.0,
    plant: PlantLike = LEADERBOARD,
    columns: Sequence[str] = (),
) -> None:
    """Make a figure or a film from files, and write it whole or not at all.

    Args:
        kind: ``trajectory``, ``phase`` and ``animation`` read trajectories (CSV), ``robustness`` the JSON of
            ``swingup evaluate --board robustness --json``, ``curve`` the ``metrics.jsonl`` of runs.
        files: the files to draw; those of an animation move side by side.
        out: the picture's file: ``.png``, ``.svg`` or ``.pdf``; ``.gif`` or ``.webp`` for an animation.
        robot: the robot of the trajectories; by default the one whose driven joint alone has torque.
        fps: frames a second of an animation.
        size: height of an animation (pixels).
        speed: speed of an animation; 1 is real time.
        plant: the trajectories' pendulum: its lengths and its torque limit.
        columns: words that map the trajectories' columns.

    Raises:
        SwingupError: an unknown kind or suffix, a file that cannot be read, understood or written, a figure of
            different robots, or a missing library.
    """
    one_of("kind of plot", kind, PLOT_KINDS)
    if not files:
        raise SwingupError("nothing to draw: give at least one file")
    suffix = check_suffix(out, FILM_FORMATS if kind == "animation" else FIGURE_FORMATS)
    labels = make_labels(files)
    if kind in ("robustness", "curve"):
        read, describe = (
            (read_robustness, robustness_figure) if kind == "robustness" else (read_curve, curves_figure)
        )
        found: dict[str, Any] = dict(zip(labels, map(read, files), strict=True))
        write_atomically(out, render(draw(describe(found)), suffix))
        return
    trajectories = [load_trajectory(file, columns) for file in files]
    pairs = zip(files, trajectories, strict=True)
    robots = [driven_robot(file, rows.u) if robot is None else get_robot(robot) for file, rows in pairs]
    if kind == "animation":
        animate(list(zip(trajectories, robots, strict=True)), out, fps, size, speed, plant)
        return
    for file, other in zip(files, robots, strict=True):
        if other != robots[0]:
            raise SwingupError(
                f"{files[0]} is of the {robots[0].name}, {file} of the {other.name}: draw two pictures"
            )
    named = dict(zip(labels, trajectories, strict=True))
    figure = trajectory_figure(named, robots[0], plant) if kind == "trajectory" else phase_figure(named, robots[0])
    write_atomically(out, render(draw(figure), suffix))
