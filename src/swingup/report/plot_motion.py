"""Figures of motion: trajectories over time, and phase portraits."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..benchmark.evaluate import score
from ..benchmark.rollout import Trajectory
from ..drawing import BASE, DRIVEN, GREEN, LINK_1, LINK_2
from ..plant.plant import LEADERBOARD, PlantLike, load_plant
from ..plant.robots import Robot, get_robot
from .files import check_trajectory, require_some
from .style import RING, STAR, legend_below, line_look, new_figure, plain, styled, tick_angles

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_trajectories(
    trajectories: Mapping[str, Trajectory], robot: Robot | str, plant: PlantLike = LEADERBOARD
) -> "Figure":
    """Draw positions (rad), velocities (rad/s) and torques (N m) over time (s), a column for each trajectory.

    Angles are unwrapped from a start within half a turn of hanging. Green marks the goal nearest to the end, and
    the time from which the tip stays up.

    Args:
        trajectories: by name; the names become titles.
        robot: which joint is driven; the other's torque is drawn in grey unless it is zero.
        plant: gives the lengths of the links and the torque limit.

    Raises:
        SwingupError: there is no trajectory, one is malformed, or matplotlib is not installed.
    """
    robot, count, parameters = get_robot(robot), len(trajectories), load_plant(plant).driven(robot)
    limit = float(max(parameters.tl1, parameters.tl2))
    require_some(trajectories, "trajectory")
    with styled():
        figure = new_figure(1.4 + 2.9 * count if count > 1 else 5.4, 4.6)
        axes = figure.subplots(3, count, sharex="col", sharey="row", squeeze=False, height_ratios=(1.15, 1, 0.9))
        for column, (name, trajectory) in enumerate(trajectories.items()):
            _draw_column(list(axes[:, column]), check_trajectory(name, trajectory), robot.joint, limit)
            _mark_time(list(axes[:, column]), score(trajectory, robot, plant=plant).swingup_time)
            axes[0, column].set_title(plain(name))
        for each, label in zip(axes[:, 0], ("position (rad)", "velocity (rad/s)", "torque (N m)"), strict=True):
            each.set_ylabel(label)
        for row in axes:
            shown = {t: line for each in row for line, t in zip(*each.get_legend_handles_labels(), strict=True)}
            row[-1].legend(shown.values(), shown.keys(), loc="center left", bbox_to_anchor=(1.0, 0.5))
        figure.align_ylabels(axes[:, 0])
    return figure


def plot_phase(trajectories: Mapping[str, Trajectory], robot: Robot | str) -> "Figure":
    """Draw the phase portrait of each joint, velocity (rad/s) over position (rad), with start and goal.

    Angles are unwrapped from a start within half a turn of hanging; the goals are those nearest to the ends.

    Args:
        trajectories: by name, as in the legend.
        robot: which joint is driven; its panel says so.

    Raises:
        SwingupError: there is no trajectory, one is malformed, or matplotlib is not installed.
    """
    robot = get_robot(robot)
    require_some(trajectories, "trajectory")
    with styled():
        figure = new_figure(7.0, 3.4)
        panels = figure.subplots(1, 2)
        entries: list[tuple[Artist, str]] = []
        for k, (name, trajectory) in enumerate(trajectories.items()):
            _, x, _ = check_trajectory(name, trajectory)
            q = unwrapped(x)
            for joint, each in enumerate(panels):
                (line,) = each.plot(q[:, joint], x[:, 2 + joint], **line_look(k), linewidth=1.0, label=plain(name))
                (start,) = each.plot(*q[:1, joint], x[0, 2 + joint], **RING)
                (goal,) = each.plot(goals(q)[joint], 0.0, **STAR)
            entries.append((line, plain(name)))
        for joint, each in enumerate(panels):
            tick_angles(each.xaxis)
            each.set(xlabel=f"$q_{joint + 1}$ (rad)", ylabel=rf"$\dot q_{joint + 1}$ (rad/s)")
            kind = "driven" if joint == robot.joint else "passive"
            each.set_title(f"{('shoulder', 'elbow')[joint]} ({kind})")
        legend_below(figure, [*entries, (start, "start"), (goal, "goal")])
    return figure


def unwrapped(x: np.ndarray) -> np.ndarray:
    """Both angles (N, 2) of states (N, 4) without jumps, from a start within half a turn of 0 (rad)."""
    q: np.ndarray = np.unwrap(x[:, :2], axis=0)
    return q - 2 * np.pi * np.round(q[0] / (2 * np.pi))


def goals(q: np.ndarray) -> np.ndarray:
    """The upright angles (2,) nearest to the last row of angles (N, 2) (rad)."""
    upright = np.array([np.pi, 0.0])
    return upright + 2 * np.pi * np.round((q[-1] - upright) / (2 * np.pi))


def _draw_column(panels: Sequence["Axes"], rows: tuple[np.ndarray, ...], driven: int, limit: float) -> None:
    """Positions, velocities and torques of one trajectory, from the upper panel to the lower."""
    (time, x, u), (top, middle, bottom) = rows, panels
    q = unwrapped(x)
    for joint, colour in enumerate((LINK_1, LINK_2)):
        top.plot(time, q[:, joint], color=colour, label=f"$q_{joint + 1}$")
        middle.plot(time, x[:, 2 + joint], color=colour, label=rf"$\dot q_{joint + 1}$")
    for goal, label in zip(goals(q), ("goal", "_goal"), strict=True):
        top.axhline(goal, color=GREEN, linewidth=0.8, linestyle="--", zorder=1, label=label)
    tick_angles(top.yaxis)
    _draw_torques(bottom, time, u, driven, limit)
    end = 2 * time[-1] - time[-2]  # the last row lasts as long as the one before
    bottom.set(xlabel="time (s)", xlim=(time[0], end))


def _mark_time(panels: Sequence["Axes"], up: float | None) -> None:
    """A line at the swing-up time, with the time as text in the panel of the velocities."""
    if up is None:
        return
    for axes in panels:
        axes.axvline(up, color=GREEN, linewidth=0.8, linestyle=":", zorder=1, label="_up")
    late = up > sum(panels[1].get_xlim()) / 2
    look: dict[str, Any] = {"xytext": (-4 if late else 4, -1), "ha": "right" if late else "left", "va": "top"}
    look |= {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "color": GREEN, "fontsize": 7.5}
    panels[1].annotate(f"up at {up:.2f} s", (up, 1.0), **look)


def _draw_torques(axes: "Axes", time: np.ndarray, u: np.ndarray, driven: int, limit: float) -> None:
    for joint in (1 - driven, driven):
        if joint == driven or u[:, joint].any():
            look: dict[str, Any] = {"color": DRIVEN if joint == driven else BASE, "drawstyle": "steps-post"}
            axes.plot(time, u[:, joint], label=f"$u_{joint + 1}$", linewidth=0.9, **look)
    for torque, label in ((limit, "limit"), (-limit, "_limit")):
        axes.axhline(torque, color=BASE, linewidth=0.8, linestyle="--", zorder=1, label=label)
