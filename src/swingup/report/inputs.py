"""What figures are made of: files and trajectories, checked, and their names for the legend."""

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..benchmark.rollout import Trajectory
from ..benchmark.rules import CRITERIA
from ..common.checks import finite_number, whole_number
from ..common.errors import SwingupError
from ..common.files import read_bytes
from ..common.text import quoted
from ..learner.metrics import METRICS_FILE, read_metrics
from ..plant.robots import ROBOTS, Robot

CURVE_KEYS = ("reward", "score")
"""The values of a row of metrics that learning curves show; a run has one of them."""

RESETS_KEY = "termination_rate"
"""A further one, of tasks whose steps may be cut at random."""

LARGEST_DRAWN = 1e15
"""No count or score is larger; matplotlib's axes cannot show numbers near the largest of floating point."""

LARGEST_RESULT = 1_000_000
"""Most bytes of a file with a robustness score; the command writes about a thousand."""

ROBUSTNESS_REMEDY = "write it with swingup evaluate --board robustness --json"


class Rows(NamedTuple):
    """A trajectory that can be drawn: time (N,), x (N, 4) and u (N, 2), in s, rad, rad/s and N m."""

    time: np.ndarray
    x: np.ndarray
    u: np.ndarray


def check_suffix(path: str | Path, known: Sequence[str]) -> str:
    """The suffix of an output file, in lower case.

    Raises:
        SwingupError: it is not among the known ones.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in known:
        raise SwingupError(f"cannot write {path}: its name must end in {' or '.join(known)}")
    return suffix


def check_trajectory(name: str, trajectory: Trajectory | Rows) -> Rows:
    """A trajectory in float64.

    Raises:
        SwingupError: the shapes do not fit, there are fewer than three rows, a value is not finite or the time does
            not increase.
    """
    time, x, u = (np.asarray(part, np.float64) for part in (trajectory.time, trajectory.x, trajectory.u))
    if time.size < 3 or time.shape != (time.size,) or x.shape != (time.size, 4) or u.shape != (time.size, 2):
        shapes = f"{time.shape}, {x.shape} and {u.shape}"
        raise SwingupError(
            f"{name}: time, x and u have shapes {shapes}: pass (N,), (N, 4) and (N, 2), N of 3 or more"
        )
    if not all(np.isfinite(part).all() for part in (time, x, u)):
        raise SwingupError(f"{name} holds values that are not finite: cut it before the first of them")
    if np.any(np.diff(time) <= 0):
        raise SwingupError(f"{name}: its time does not increase: give one run, its rows in order")
    return Rows(time, x, u)


def require_some(given: Mapping[str, Any], what: str) -> None:
    """Refuse an empty mapping of things to draw."""
    if not given:
        raise SwingupError(f"nothing to draw: give at least one {what}")


def infer_robot(name: str | Path, trajectory: Trajectory) -> Robot:
    """The robot whose driven joint is the only one with torque.

    Raises:
        SwingupError: both joints have torque, or neither has.
    """
    driven = np.any(np.asarray(trajectory.u) != 0, axis=0)
    if driven.sum() != 1:
        joints = "both joints" if driven.any() else "neither joint"
        raise SwingupError(f"{name} has torque on {joints}: name the robot, {' or '.join(ROBOTS)}")
    return next(robot for robot in ROBOTS.values() if driven[robot.joint])


def read_robustness(path: str | Path) -> dict[str, Any]:
    """Read the JSON object of one robustness score.

    Raises:
        SwingupError: the file cannot be read, is not JSON, or holds something else.
    """
    try:
        result = json.loads(read_bytes(path, LARGEST_RESULT))
    except OSError as error:
        raise SwingupError(f"cannot read {path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise SwingupError(f"{path} is not JSON: {ROBUSTNESS_REMEDY}") from error
    check_robustness(str(path), result)
    return dict(result)


def check_robustness(name: str, result: Any) -> None:
    """Refuse a value that is not of the form of ``Result.as_dict``."""
    if not isinstance(result, Mapping) or all(result.get(each) is None for each in CRITERIA):
        raise SwingupError(f"{name} holds no robustness score: {ROBUSTNESS_REMEDY}")
    intervals = result.get("intervals", {})
    for criterion, largest in {**dict.fromkeys(CRITERIA, 100.0), "score": 1.0}.items():
        interval = intervals.get(criterion) if isinstance(intervals, Mapping) else intervals
        if interval is not None and (not isinstance(interval, list | tuple) or len(interval) != 2):
            raise SwingupError(f"{name}: interval of {criterion} = {quoted(interval)} is not a pair")
        if result.get(criterion) is not None:
            finite_number(f"{name}: {criterion}", result[criterion], 0.0, largest)
        for end in interval or ():
            finite_number(f"{name}: interval of {criterion}", end, 0.0, largest)


def read_curve(path: str | Path) -> list[dict[str, Any]]:
    """Read the rows of a ``metrics.jsonl``.

    Raises:
        SwingupError: the file cannot be read, or its rows cannot be drawn.
    """
    rows = read_metrics(path)
    check_curve(str(path), rows)
    return rows


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
        finite_number(f"{name}: frames", row.get("frames"), 0, LARGEST_DRAWN)
        for key in (*CURVE_KEYS, RESETS_KEY):
            value = row.get(key)
            # Missing and NaN mean that nothing was measured: the curve has a gap there.
            if value is not None and not (isinstance(value, float) and math.isnan(value)):
                finite_number(f"{name}: {key}", value, -LARGEST_DRAWN, LARGEST_DRAWN)


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
