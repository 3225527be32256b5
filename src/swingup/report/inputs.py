"""What figures are made of: files and trajectories, checked, and their names for the legend."""

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..benchmark.rules import CRITERIA
from ..common.checks import finite_number, whole_number
from ..common.errors import SwingupError
from ..common.files import read_bytes
from ..common.text import quoted
from ..learner.metrics import METRICS_FILE

CURVE_KEYS = ("reward", "score")
"""The values of a row of metrics that learning curves show; a run has one of them."""

RESETS_KEY = "termination_rate"
"""A further one, of tasks whose steps may be cut at random."""

LARGEST_DRAWN = 1e15
"""No count or score is larger; matplotlib's axes cannot show numbers near the largest of floating point."""

LARGEST_RESULT = 1_000_000
"""Most bytes of a file with a robustness score; the command writes about a thousand."""

ROBUSTNESS_REMEDY = "write it with swingup evaluate --board robustness --json"


def read_robustness(path: str | Path) -> Any:
    """Read the JSON object of one robustness score."""
    try:
        return json.loads(read_bytes(path, LARGEST_RESULT))
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
