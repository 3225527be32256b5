"""The figures: trajectories, phase portraits, robustness and learning curves."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..benchmark.evaluate import score
from ..benchmark.rollout import Trajectory
from ..benchmark.rules import CRITERIA
from ..drawing import BASE, DRIVEN, GREEN, LINK_1, LINK_2
from ..errors import SwingupError
from ..physics.parameters import TORQUE_LIMIT, Robot, get_robot
from .files import CURVE_KEYS, check_curve, check_robustness, check_trajectory
from .style import RING, STAR, bar_look, legend_below, line_look, new_figure, plain, styled, tick_angles

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CRITERION_NAMES = dict(
    zip(
        CRITERIA,
        ("Model", "Velocity\nnoise", "Torque\nnoise", "Torque\nresponse", "Time\ndelay", "Perturbations"),
        strict=True,
    )
)
MOST_NUMBERED = 3
"""With more controllers, the bars are too narrow for their numbers."""
DOTS: Any = {"markersize": 2, "alpha": 0.4, "label": "_evaluations"}
ABOVE: Any = {"xytext": (0, 1.5), "textcoords": "offset points", "ha": "center", "fontsize": 7}


def plot_trajectories(trajectories: Mapping[str, Trajectory], robot: Robot | str) -> "Figure":
    """Draw positions (rad), velocities (rad/s) and torques (N m) over time (s), a column for each trajectory.

    Angles are unwrapped from a start within half a turn of hanging. Green marks the goal nearest to the end, and
    the time from which the tip stays up.

    Args:
        trajectories: by name; the names become titles.
        robot: which joint is driven; the other's torque is drawn in grey unless it is zero.

    Raises:
        SwingupError: there is no trajectory, one is malformed, or matplotlib is not installed.
    """
    robot, count = get_robot(robot), len(trajectories)
    _require(trajectories, "trajectory")
    with styled():
        figure = new_figure(1.4 + 2.9 * count if count > 1 else 5.4, 4.6)
        axes = figure.subplots(3, count, sharex="col", sharey="row", squeeze=False, height_ratios=(1.15, 1, 0.9))
        for column, (name, trajectory) in enumerate(trajectories.items()):
            _draw_column(list(axes[:, column]), check_trajectory(name, trajectory), robot.joint)
            _mark_time(list(axes[:, column]), score(trajectory, robot).swingup_time)
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
    _require(trajectories, "trajectory")
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


def plot_robustness(results: Mapping[str, Mapping[str, Any]]) -> "Figure":
    """Draw the success (%) of several controllers in each criterion of the robustness score as bars.

    Args:
        results: outputs of ``Robustness.as_dict``, by name, as in the legend. The legend also shows the overall
            scores; 95 % intervals become error bars.

    Raises:
        SwingupError: there is no result, one has another form, or matplotlib is not installed.
    """
    _require(results, "robustness score")
    for name, result in results.items():
        check_robustness(name, result)
    criteria = [name for name in CRITERIA if any(result.get(name) is not None for result in results.values())]
    numbered, group = len(results) <= MOST_NUMBERED, min(0.8, 0.35 + 0.15 * len(results))
    with styled():
        figure = new_figure(max(5.6, 1.2 + 0.2 * len(results) * len(criteria)), 3.3)
        axes = figure.subplots()
        entries: list[tuple[Artist, str]] = []
        for k, (name, result) in enumerate(results.items()):
            width = group / len(results)
            places = {key: p + (k + 0.5) * width - group / 2 for p, key in enumerate(criteria)}
            measured = {key: float(result[key]) for key in criteria if result.get(key) is not None}
            look = {"width": 0.92 * width, "label": plain(name), **bar_look(k)}
            bars = axes.bar([places[key] for key in measured], list(measured.values()), **look)
            entries.append((bars[0], plain(name) + _overall(result)))
            for key, value in measured.items():
                top = _draw_interval(axes, places[key], value, result.get("intervals", {}).get(key))
                if numbered:
                    axes.annotate(f"{value:.0f}", (places[key], top), **ABOVE)
        axes.set_xticks(range(len(criteria)), [CRITERION_NAMES[key] for key in criteria])
        axes.set(xlabel="criterion", ylabel="success (%)", ylim=(0, 105 if numbered else 101))
        axes.tick_params(axis="x", length=0)
        axes.grid(visible=False, axis="x")
        legend_below(figure, entries)
    return figure


def plot_curves(runs: Mapping[str, Sequence[Mapping[str, Any]]]) -> "Figure":
    """Draw mean reward and score over frames (millions), one line for each seed of each run.

    Dots are single evaluations; the line through them is the best so far. The score is the RealAI score of a double
    pendulum, and the mean return of other tasks. Rewards, returns and scores have no unit.

    Args:
        runs: rows of ``metrics.jsonl``, by name, as in the legend.

    Raises:
        SwingupError: there is no run, one has no rows or a value that is no number, or matplotlib is missing.
    """
    _require(runs, "run")
    for name, rows in runs.items():
        check_curve(name, rows)
    with styled():
        figure = new_figure(5.6, 4.6)
        top, bottom = figure.subplots(2, 1, sharex=True)
        entries: list[tuple[Artist, str]] = []
        for k, (name, rows) in enumerate(runs.items()):
            seeds = list(dict.fromkeys(row.get("seed") for row in rows))
            look = {**line_look(k), "alpha": 1.0 if len(seeds) == 1 else 0.6, "label": plain(name)}
            for seed in seeds:
                frames, reward, points = _columns([row for row in rows if row.get("seed") == seed])
                (line,) = top.plot(frames, reward, **look)
                bottom.plot(frames, points, ".", color=look["color"], **DOTS)
                bottom.plot(frames, np.fmax.accumulate(points), drawstyle="steps-post", **look)
            entries.append((line, plain(name) + (f" ({len(seeds)} seeds)" if len(seeds) > 1 else "")))
        top.set(ylabel="mean reward per step (–)")
        (dot,) = bottom.plot([], [], ".", color="black", **DOTS)
        bottom.set(xlabel="frames (millions)", xlim=(0, None))
        if any("mean_length" in row for rows in runs.values() for row in rows):
            bottom.set(ylabel="best mean return (–)")
        else:
            bottom.set(ylabel="best RealAI score (0 to 1)", ylim=(-0.02, None))
        figure.align_ylabels((top, bottom))
        legend_below(figure, [*entries, (dot, "one evaluation")])
    return figure


def unwrapped(x: np.ndarray) -> np.ndarray:
    """Both angles (N, 2) of states (N, 4) without jumps, from a start within half a turn of 0 (rad)."""
    q: np.ndarray = np.unwrap(x[:, :2], axis=0)
    return q - 2 * np.pi * np.round(q[0] / (2 * np.pi))


def goals(q: np.ndarray) -> np.ndarray:
    """The upright angles (2,) nearest to the last row of angles (N, 2) (rad)."""
    upright = np.array([np.pi, 0.0])
    return upright + 2 * np.pi * np.round((q[-1] - upright) / (2 * np.pi))


def _require(given: Mapping[str, Any], what: str) -> None:
    if not given:
        raise SwingupError(f"nothing to draw: give at least one {what}")


def _draw_column(panels: Sequence["Axes"], rows: tuple[np.ndarray, ...], driven: int) -> None:
    """Positions, velocities and torques of one trajectory, from the upper panel to the lower."""
    (time, x, u), (top, middle, bottom) = rows, panels
    q = unwrapped(x)
    for joint, colour in enumerate((LINK_1, LINK_2)):
        top.plot(time, q[:, joint], color=colour, label=f"$q_{joint + 1}$")
        middle.plot(time, x[:, 2 + joint], color=colour, label=rf"$\dot q_{joint + 1}$")
    for goal, label in zip(goals(q), ("goal", "_goal"), strict=True):
        top.axhline(goal, color=GREEN, linewidth=0.8, linestyle="--", zorder=1, label=label)
    tick_angles(top.yaxis)
    _draw_torques(bottom, time, u, driven)
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


def _draw_torques(axes: "Axes", time: np.ndarray, u: np.ndarray, driven: int) -> None:
    for joint in (1 - driven, driven):
        if joint == driven or u[:, joint].any():
            look: dict[str, Any] = {"color": DRIVEN if joint == driven else BASE, "drawstyle": "steps-post"}
            axes.plot(time, u[:, joint], label=f"$u_{joint + 1}$", linewidth=0.9, **look)
    for limit, label in ((TORQUE_LIMIT, "limit"), (-TORQUE_LIMIT, "_limit")):
        axes.axhline(limit, color=BASE, linewidth=0.8, linestyle="--", zorder=1, label=label)


def _draw_interval(axes: "Axes", place: float, value: float, interval: Sequence[float] | None) -> float:
    """Draw an error bar unless the interval is a point or missing; returns its upper end (%)."""
    low, high = interval or (value, value)
    if high > low:
        reach = [[max(0.0, value - low)], [max(0.0, high - value)]]
        for colour, line, cap in (("white", 2.2, 2.8), ("black", 0.8, 2.0)):
            look: dict[str, Any] = {"ecolor": colour, "elinewidth": line, "capthick": line, "capsize": cap}
            axes.errorbar(place, value, reach, fmt="none", **look)
    return max(value, high)


def _overall(result: Mapping[str, Any]) -> str:
    overall, interval = result.get("overall"), result.get("intervals", {}).get("overall")
    if overall is None:
        return ""
    return f", {overall:.3f}" + (f" ({interval[0]:.3f}–{interval[1]:.3f})" if interval else "")


def _columns(rows: Sequence[Mapping[str, Any]]) -> list[np.ndarray]:
    """Frames (millions), rewards and scores; NaN where a row has none."""
    frames = np.array([row["frames"] / 1e6 for row in rows])
    return [frames, *(np.array([row.get(key, np.nan) for row in rows], float) for key in CURVE_KEYS)]
