"""One function from files to a picture: the kinds of pictures, and the files that each kind reads."""

from collections.abc import Sequence
from pathlib import Path

from ..benchmark.rollout import Trajectory
from ..benchmark.trajectory_file import load_trajectory
from ..common.checks import one_of
from ..common.errors import SwingupError
from ..common.files import write_atomically
from ..plant.plant import LEADERBOARD, PlantLike
from ..plant.robots import Robot, get_robot
from .animate import FASTEST, FPS, SIZE, animate
from .files import check_suffix, infer_robot, make_labels, read_curve, read_robustness
from .plot import plot_curves, plot_phase, plot_robustness, plot_trajectories
from .style import FIGURE_FORMATS, render

PLOT_KINDS = ("trajectory", "phase", "animation", "robustness", "curve")


def save_plot(
    kind: str,
    files: Sequence[str | Path],
    out: str | Path,
    robot: Robot | str | None = None,
    fps: float = FPS,
    size: int = SIZE,
    speed: float = 1.0,
    plant: PlantLike = LEADERBOARD,
) -> None:
    """Make a figure or a film from files, and write it whole or not at all.

    Args:
        kind: ``trajectory``, ``phase`` and ``animation`` read trajectories (CSV), ``robustness`` the JSON of
            ``swingup robustness --json``, ``curve`` the ``metrics.jsonl`` of runs.
        files: the files to draw; one file for an animation.
        out: the picture's file: ``.png``, ``.svg`` or ``.pdf``; ``.gif`` or ``.mp4`` for an animation.
        robot: the robot of the trajectories; by default the one whose driven joint alone has torque.
        fps: frames a second of an animation.
        size: width and height of an animation (pixels).
        speed: speed of an animation; 1 is real time.
        plant: the trajectories' pendulum: its lengths and its torque limit.

    Raises:
        SwingupError: an unknown kind or suffix, a file that cannot be read, understood or written, trajectories
            of different robots, or a missing library.
    """
    one_of("kind of plot", kind, PLOT_KINDS)
    if not files:
        raise SwingupError("nothing to draw: give at least one file")
    suffix = check_suffix(out, list(FASTEST) if kind == "animation" else FIGURE_FORMATS)
    labels = make_labels(files)
    if kind == "robustness":
        figure = plot_robustness({label: read_robustness(file) for label, file in zip(labels, files, strict=True)})
    elif kind == "curve":
        figure = plot_curves({label: read_curve(file) for label, file in zip(labels, files, strict=True)})
    else:
        trajectories, chosen = _load(files, robot)
        if kind == "animation":
            animate(_only(trajectories), chosen, out, fps, size, speed, plant)
            return
        named = dict(zip(labels, trajectories, strict=True))
        figure = plot_trajectories(named, chosen, plant) if kind == "trajectory" else plot_phase(named, chosen)
    write_atomically(out, render(figure, suffix))


def _load(files: Sequence[str | Path], robot: Robot | str | None) -> tuple[list[Trajectory], Robot]:
    known = None if robot is None else get_robot(robot)
    trajectories = [load_trajectory(file) for file in files]
    if known is None:
        robots = [infer_robot(*item) for item in zip(files, trajectories, strict=True)]
        for file, other in zip(files, robots, strict=True):
            if other != robots[0]:
                raise SwingupError(
                    f"{files[0]} is of the {robots[0].name}, {file} of the {other.name}: draw two pictures"
                )
        known = robots[0]
    return trajectories, known


def _only(trajectories: Sequence[Trajectory]) -> Trajectory:
    if len(trajectories) > 1:
        raise SwingupError(f"an animation shows one trajectory, not {len(trajectories)}: give one file")
    return trajectories[0]
