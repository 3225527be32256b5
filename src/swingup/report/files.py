"""What pictures are made from: files read and checked, trajectories checked, and names for the legend."""

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..benchmark.rollout import Trajectory
from ..benchmark.rules import CRITERIA
from ..errors import SwingupError
from ..learner.metrics import METRICS_FILE, read_metrics
from ..physics.parameters import ROBOTS, Robot

PLOTTED = ("reward", "score")
"""What learning curves show of a row of metrics."""

LARGEST_DRAWN = 1e15
"""Counts and scores beyond this are mistakes, and matplotlib's axes could not hold them."""

_Rows = tuple[np.ndarray, np.ndarray, np.ndarray]


def check_suffix(path: str | Path, known: Sequence[str]) -> str:
    """The suffix of an output file, in lower case.

    Raises:
        SwingupError: it is not among the known ones.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in known:
        raise SwingupError(f"cannot write {path}: its name must end in {' or '.join(known)}")
    return suffix


def check_trajectory(name: str, trajectory: Trajectory) -> _Rows:
    """Time (s) (N,), states (N, 4) and torques (N m) (N, 2) of a trajectory, in float64.

    Raises:
        SwingupError: the shapes are others, it is shorter than three rows, a value is not finite or the time does
            not increase.
    """
    time, x, u = (np.asarray(part, np.float64) for part in (trajectory.time, trajectory.x, trajectory.u))
    if time.size < 3 or time.shape != (time.size,) or x.shape != (time.size, 4) or u.shape != (time.size, 2):
        shapes = f"{time.shape}, {x.shape} and {u.shape}"
        raise SwingupError(
            f"{name}: time, x and u have shapes {shapes}: pass (N,), (N, 4) and (N, 2), N of 3 or more"
        )
    if not all(np.isfinite(part).all() for part in (time, x, u)):
        raise SwingupError(f"{name} holds values that are not finite: end it before them")
    if np.any(np.diff(time) <= 0):
        raise SwingupError(f"{name}: its time does not increase: keep one run a trajectory, in order")
    return time, x, u


def infer_robot(name: str | Path, trajectory: Trajectory) -> Robot:
    """The robot whose driven joint is the only one with torque.

    Raises:
        SwingupError: both joints have torque, or neither.
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
        result = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise SwingupError(f"cannot read {path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise SwingupError(f"{path} is not JSON: write it with swingup robustness --json") from error
    check_robustness(str(path), result)
    return dict(result)


def check_robustness(name: str, result: Any) -> None:
    """Refuse what is not the object of ``Robustness.as_dict``.

    Raises:
        SwingupError: it is no object, has none of the criteria, or a percentage, interval or score is out of range.
    """
    remedy = "write it with swingup robustness --json"
    if not isinstance(result, Mapping) or all(result.get(each) is None for each in CRITERIA):
        raise SwingupError(f"{name} holds no robustness score: {remedy}")
    intervals = result.get("intervals", {})
    if not isinstance(intervals, Mapping):
        raise SwingupError(f"{name}: intervals = {intervals!r:.40} are no object: {remedy}")
    for criterion, largest in {**dict.fromkeys(CRITERIA, 100.0), "overall": 1.0}.items():
        value, interval = result.get(criterion), intervals.get(criterion)
        if value is not None and not _is_real(value, 0.0, largest):
            raise SwingupError(f"{name}: {criterion} = {value!r:.40} is not from 0 to {largest:g}: {remedy}")
        pair = isinstance(interval, Sequence) and len(interval) == 2
        if interval is not None and not (pair and all(_is_real(end, 0.0, largest) for end in interval)):
            raise SwingupError(f"{name}: interval of {criterion} = {interval!r:.40} is no pair: {remedy}")


def read_curve(path: str | Path) -> list[dict[str, Any]]:
    """Read the rows of a ``metrics.jsonl``.

    Raises:
        SwingupError: the file cannot be read, holds no row, or a value that is no number.
    """
    rows = read_metrics(path)
    check_curve(str(path), rows)
    return rows


def check_curve(name: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Refuse rows of metrics that cannot be drawn.

    Raises:
        SwingupError: there is no row, none has a score or a reward, or a value is no number.
    """
    if not rows:
        raise SwingupError(f"{name} has no rows of metrics: give the {METRICS_FILE} of a run that reported once")
    if not any(row.get(key) is not None for row in rows for key in PLOTTED):
        raise SwingupError(f"{name} has neither {' nor '.join(PLOTTED)} in its rows: give a run's {METRICS_FILE}")
    for row in rows:
        if not isinstance(row.get("seed"), int | str | None):
            raise SwingupError(f"{name}: seed = {row['seed']!r:.40} is no number: remove or mend its row")
        for key in ("frames", *PLOTTED):
            value = row.get(key, None if key in PLOTTED else "missing")
            # A reward may be NaN, or absent, where nothing was measured: the curve has a gap there.
            if not (_is_real(value) or (key in PLOTTED and (value is None or value != value))):
                raise SwingupError(f"{name}: {key} = {value!r:.40} is no finite number: remove or mend its row")


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


def _is_real(value: Any, low: float = -math.inf, high: float = math.inf) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and low <= value <= high and abs(value) < LARGEST_DRAWN
