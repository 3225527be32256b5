"""What figures show: motions over time, phase portraits, robustness by criterion, and learning curves."""

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..benchmark.boards import PERFORMANCE
from ..benchmark.recording import checked_rows
from ..benchmark.robustness_board import CRITERIA
from ..benchmark.rollout import Trajectory
from ..benchmark.swing_up_board import compute_criteria, tip_heights
from ..benchmark.values import COLUMNS
from ..common.checks import finite_number, whole_number
from ..common.errors import SwingupError, quoted
from ..common.files import read_bytes
from ..drawing import GOAL_HEIGHT
from ..learner.metrics import METRICS_FILE, REWARD_RATE
from ..loop.resolve import resolve
from ..plant.plant import LEADERBOARD, Plant, PlantLike, Robot, get_robot
from .figure import BARS, DOTS, LINE, PALE_BARS, RING, STAR, THIN, Curve, Figure, Mark, Panel

TIME = "time (s)"
LINKS = ("link-1", "link-2")  # Colours of the joints' angles and velocities
CURVE_KEYS = ("reward", "score")
"""The values of a row of metrics that learning curves show; a run has one of them."""
RESETS_KEY = "termination_rate"  # A further value, of tasks whose steps may be cut at random
MAX_DRAWN_NUMBER = 1e15
"""Maximum count or score: matplotlib's axes cannot show numbers near the maximum of floating point."""
MAX_RESULT_BYTES = 64_000_000
"""Maximum size of a file with a robustness score; the command writes about 100,000 bytes a seed."""
ROBUSTNESS_REMEDY = "write it with swingup evaluate --board robustness --json"


def trajectory_figure(
    trajectories: Mapping[str, Trajectory], robot: Robot | str, plant: PlantLike = LEADERBOARD
) -> Figure:
    """Positions (rad), velocities (rad/s) and torques (N m) over time (s), a column for each trajectory.

    Angles are unwrapped from a start within half a turn of hanging. Green marks the goal nearest to the end, and
    the time from which the tip stays up. Names become titles. The passive joint's torque is drawn in grey unless it
    is zero.
    """
    robot, found = get_robot(robot), resolve(plant).facts
    columns = []
    for name, given in trajectories.items():
        rows = checked_rows(given, name)
        rules = replace(PERFORMANCE, duration=0.0)  # a run of any length
        up = compute_criteria(rows.time, rows.x, rows.u, found.l1, found.l2, rules).swingup_time
        title = name if up is None else f"{name}, up at {up:.2f} s"
        _, *panels = motion_panels({"": rows}, robot, found, title)
        marks = [] if up is None else [Mark("up", up, upright=True)]
        columns.append([replace(panel, marks=[*panel.marks, *marks]) for panel in panels])
    return Figure([panel for row in zip(*columns, strict=True) for panel in row], len(columns), shared=True)


def motion_panels(
    runs: Mapping[str, Trajectory], robot: Robot, plant: Plant, title: str = "", others: Sequence[Trajectory] = ()
) -> list[Panel]:
    """Tip height, positions, velocities and torques over time.

    The first run is the main one, the others are thin; of ``others`` only the tip is drawn, in grey.
    """
    lengths = plant.l1, plant.l2
    heights = [
        Curve("other controllers", rows.time, tip_heights(rows.x, *lengths), "base", THIN) for rows in others
    ]
    positions, velocities, torques = [], [], []
    for number, (run, rows) in enumerate(runs.items()):
        end, look, q = f", {run}" if run else "", THIN if number else LINE, unwrapped(rows.x)
        heights.append(Curve(f"tip{end}", rows.time, tip_heights(rows.x, *lengths), LINKS[1], look))
        for joint, colour in enumerate(LINKS):
            positions.append(Curve(f"q{joint + 1}{end}", rows.time, q[:, joint], colour, look))
            velocities.append(Curve(f"dq{joint + 1}{end}", rows.time, rows.x[:, 2 + joint], colour, look))
        for joint in (1 - robot.joint, robot.joint):
            colour = "driven" if joint == robot.joint else "base"
            if joint == robot.joint or rows.u[:, joint].any():
                torques.append(Curve(f"u{joint + 1}{end}", rows.time, rows.u[:, joint], colour, look, steps=True))
    first = next(iter(runs.values()))
    limit, reach = plant.limit(robot.joint), sum(lengths)
    last = 2 * first.time[-1] - first.time[-2]  # the last row lasts as long as the one before
    ends = float(first.time[0]), float(last)
    goal_line = [Mark("goal", GOAL_HEIGHT * reach)]
    goals = [Mark("goal", float(goal)) for goal in upright_near(unwrapped(first.x)[-1])]
    limits = [Mark("limit", float(sign * limit), "base") for sign in (1, -1)]
    return [
        Panel(TIME, "tip height (m)", heights, goal_line, "", ends, (-1.1 * reach, 1.1 * reach)),
        Panel(TIME, "position (rad)", positions, goals, title, ends, angles="y"),
        Panel(TIME, "velocity (rad/s)", velocities, x_range=ends),
        Panel(TIME, "torque (N m)", torques, limits, x_range=ends),
    ]


def phase_figure(
    trajectories: Mapping[str, Trajectory], robot: Robot | str, colours: Sequence[str] | None = None
) -> Figure:
    """The phase portrait of each joint, velocity (rad/s) over position (rad), with start and goal.

    Angles are unwrapped from a start within half a turn of hanging; the goals are those nearest to the ends. With
    colours of both joints the lines after the first are thin; without them each trajectory has one.
    """
    robot, panels = get_robot(robot), []
    checked = {name: checked_rows(given, name) for name, given in trajectories.items()}
    for joint, place in enumerate(("shoulder", "elbow")):
        lines, ends = [], []
        for k, (name, rows) in enumerate(checked.items()):
            q, rate = unwrapped(rows.x), rows.x[:, 2 + joint]
            colour, look = (k, LINE) if colours is None else (colours[joint], THIN if k else LINE)
            lines.append(Curve(name, q[:, joint], rate, colour, look, time=rows.time))
            goal = upright_near(q[-1])[joint : joint + 1]
            ends += [
                Curve("start", q[:1, joint], rate[:1], "ink", RING),
                Curve("goal", goal, np.zeros(1), "goal", STAR),
            ]
        title = f"{place} ({'driven' if joint == robot.joint else 'passive'})"
        labels = f"q{joint + 1} (rad)", f"dq{joint + 1} (rad/s)"
        panels.append(Panel(*labels, [*lines, *ends], title=title, angles="x"))
    return Figure(panels, columns=2)


def unwrapped(x: np.ndarray) -> np.ndarray:
    """Both angles (N, 2) of states (N, 4) without jumps, from a start within half a turn of 0 (rad)."""
    q: np.ndarray = np.unwrap(x[:, :2], axis=0)
    return q - 2 * np.pi * np.round(q[0] / (2 * np.pi))


def upright_near(q: np.ndarray) -> np.ndarray:
    """The upright angles (2,) nearest to some angles (2,) (rad)."""
    upright = np.array([np.pi, 0.0])
    return upright + 2 * np.pi * np.round((q - upright) / (2 * np.pi))


def robustness_figure(results: Mapping[str, Mapping[str, Any]], pale: Sequence[str] = ()) -> Figure:
    """The success (%) of several controllers in each criterion of the robustness score as bars.

    The legend also shows overall scores of results with intervals, and 95 % intervals become error bars.
    Those in ``pale`` stand back.
    """
    for name, result in results.items():
        check_robustness(name, result)
    criteria = [name for name in CRITERIA if any(result.get(name) is not None for result in results.values())]
    group = min(0.84, 0.35 + 0.15 * len(results))
    width, curves = group / max(1, len(results)), []
    for k, (name, result) in enumerate(results.items()):
        places = [p for p, key in enumerate(criteria) if result.get(key) is not None]
        heights = np.array([float(result[criteria[p]]) for p in places])
        known = result.get("intervals", {})
        overall = "" if result.get("score") is None else f", {result['score']:.3f}"
        between = " ({:.3f}–{:.3f})".format(*known["score"]) if overall and known.get("score") else ""
        ends = [known.get(criteria[p]) or (height, height) for p, height in zip(places, heights, strict=True)]
        curves.append(
            Curve(
                name + overall + between, np.array(places) + (k + 0.5) * width - group / 2, heights, k,
                PALE_BARS if name in pale else BARS, interval=np.array(ends) if known else None, width=0.92 * width,
            )
        )  # fmt: skip
    names = [COLUMNS[key].label for key in criteria]
    ranges = (-0.55, len(criteria) - 0.45), (0.0, 105.0)
    return Figure([Panel("criterion", "success (%)", curves, (), "", *ranges, names)])


def curves_figure(runs: Mapping[str, Sequence[Mapping[str, Any]]]) -> Figure:
    """Reward rate and score over frames (millions), one line for each seed of each run's rows of ``metrics.jsonl``.

    Dots are single evaluations; the line through them is the best so far. The score is the RealAI score of a double
    pendulum, and the mean return of other tasks. Rewards, returns and scores have no unit.

    Reward rate and resets are those of training, with the exploring policy. Where a run had resets, a third panel
    shows them. It has no line of a run that did not record them; the legend then has a dash.
    """
    for name, rows in runs.items():
        check_curve(name, rows)
    rewards: list[Curve] = []
    resets: list[Curve] = []
    scores: list[Curve] = []
    recorded = {name for name, rows in runs.items() if any(row.get(RESETS_KEY) is not None for row in rows)}
    with_resets = any((row.get(RESETS_KEY) or 0.0) > 0.0 for rows in runs.values() for row in rows)
    for k, (name, rows) in enumerate(runs.items()):
        seeds = list(dict.fromkeys(row.get("seed") for row in rows))
        facts = [f"{len(seeds)} seeds"] if len(seeds) > 1 else []
        facts += ["resets –"] if with_resets and name not in recorded else []
        label, look = name + (f" ({', '.join(facts)})" if facts else ""), LINE if len(seeds) == 1 else THIN
        for seed in seeds:
            mine = [row for row in rows if row.get("seed") == seed]
            frames = np.array([row["frames"] / 1e6 for row in mine])
            columns = (np.array([row.get(key, np.nan) for row in mine], float) for key in (*CURVE_KEYS, RESETS_KEY))
            reward, points, rate = columns  # NaN where a row has none
            rewards.append(Curve(label, frames, reward, k, look))
            resets.append(Curve(label, frames, 1000.0 * rate, k, look))
            scores.append(Curve("one evaluation", frames, points, k, DOTS))
            scores.append(Curve(label, frames, np.fmax.accumulate(points), k, look, steps=True))
    every = [row for rows in runs.values() for row in rows]
    returns = any("mean_length" in row for row in every)
    scored = [row for row in every if row.get("score") is not None]
    rates = returns and bool(scored) and all(row["score"] == row.get(REWARD_RATE) for row in scored)
    kind = "reward rate (–)" if rates else "mean return (–)" if returns else "RealAI score (0 to 1)"
    panels = {
        "reward rate per step (–)": rewards,
        **({"resets per 1,000 steps (–)": resets} if with_resets else {}),
        f"best {kind}": scores,
    }
    return Figure([Panel("frames (millions)", label, curves) for label, curves in panels.items()], shared=True)


def read_robustness(path: str | Path) -> Any:
    """Read the JSON object of one robustness score."""
    try:
        return json.loads(read_bytes(path, MAX_RESULT_BYTES))
    except (ValueError, RecursionError) as error:
        raise SwingupError(f"{path} is not JSON: {ROBUSTNESS_REMEDY}") from error


def check_robustness(name: str, result: Any) -> None:
    """Refuse a value that is not of the form of ``Result.as_dict``."""
    if not isinstance(result, Mapping) or all(result.get(each) is None for each in CRITERIA):
        raise SwingupError(f"{name} holds no robustness score: {ROBUSTNESS_REMEDY}")
    intervals = result.get("intervals", {})
    if not isinstance(intervals, Mapping):
        raise SwingupError(f"{name}: intervals = {quoted(intervals)} are no object: {ROBUSTNESS_REMEDY}")
    for criterion, largest in {**dict.fromkeys(CRITERIA, 100.0), "score": 1.0}.items():
        ends = intervals.get(criterion) or ()
        if not isinstance(ends, list | tuple) or len(ends) not in (0, 2):
            raise SwingupError(f"{name}: interval of {criterion} = {quoted(ends)} is not a pair")
        for value in (0.0 if result.get(criterion) is None else result[criterion], *ends):
            finite_number(f"{name}: {criterion}", value, 0.0, largest)


def check_curve(name: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Refuse rows of metrics that cannot be drawn."""
    if not rows:
        raise SwingupError(f"{name} has no rows of metrics: give the {METRICS_FILE} of a run that has reported")
    if not any(row.get(key) is not None for row in rows for key in CURVE_KEYS):
        raise SwingupError(
            f"{name} has neither {' nor '.join(CURVE_KEYS)} in its rows: give a run's {METRICS_FILE}"
        )
    for row in rows:
        seed = row.get("seed")
        if seed is not None and not isinstance(seed, str):
            whole_number(f"{name}: seed", seed, 0)
        finite_number(f"{name}: frames", row.get("frames"), 0, MAX_DRAWN_NUMBER)
        for key in (*CURVE_KEYS, RESETS_KEY):
            value = row.get(key)
            # Missing and NaN mean that nothing was measured: the curve has a gap there.
            if value is not None and not (isinstance(value, float) and math.isnan(value)):
                finite_number(f"{name}: {key}", value, -MAX_DRAWN_NUMBER, MAX_DRAWN_NUMBER)


def make_labels(files: Sequence[str | Path]) -> list[str]:
    """A different name for each file: its stem, with folders or a number where stems repeat.

    A file called ``metrics.jsonl`` goes by its folder.
    """
    paths = [Path(os.path.abspath(file)) for file in files]
    names = [path.parent if path.name == METRICS_FILE else path.with_suffix("") for path in paths]
    tails = [["/".join(name.parts[-words:]) for name in names] for words in (1, 2, 3)]
    labels = [next((tail[k] for tail in tails if tail.count(tail[k]) == 1), tails[0][k]) for k in range(len(names))]
    counts = [labels[: k + 1].count(label) for k, label in enumerate(labels)]
    return [f"{label} ({count})" if count > 1 else label for label, count in zip(labels, counts, strict=True)]
