"""The fixed scoring of predictions: errors after 0.1, 0.25 and 0.5 s, over windows that no model can choose.

Windows of 0.5 s start every 0.1 s where a joint is faster than 1 rad/s. A prediction starts from the smoothed
measurement, and its start is never optimised. It is compared with the smoothed measurement. The error is the root
mean square over all windows and both joints.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ..log.recording import Recording
from ..log.windows import INTERVAL, Windows, cut_windows, join
from .prediction import Setting, predict

HORIZONS = (0.1, 0.25, 0.5)
"""s"""
LENGTH = max(HORIZONS)
LARGEST_ERROR = 1e3
"""An error that is larger or not finite counts as this (rad, rad/s)."""

Errors = Mapping[str, Mapping[str, float | None]]
"""By horizon and quantity: {"0.1": {"angle": rad, "velocity": rad/s}, ...}; None where there are no windows."""


def score_windows(recordings: Sequence[Recording]) -> Windows:
    """The windows that the scoring looks at."""
    return join([cut_windows(recording, LENGTH, log=log) for log, recording in enumerate(recordings)])


def prediction_errors(
    setting: Setting, models: Float[np.ndarray, "logs 15"], windows: Windows
) -> Float[np.ndarray, "windows outputs 4"]:
    """Predicted minus smoothed states; each log has its model."""
    errors = np.zeros_like(windows.reference)
    for log in np.unique(windows.log):
        rows = np.flatnonzero(windows.log == log)
        part = windows.take(rows)
        errors[rows] = predict(setting, models[log], part) - part.reference
    return np.clip(np.nan_to_num(errors, nan=LARGEST_ERROR), -LARGEST_ERROR, LARGEST_ERROR)


def summarise(errors: Float[np.ndarray, "windows outputs 4"]) -> Errors:
    """Root mean squares by horizon, of angles (rad) and velocities (rad/s)."""
    summary = {}
    for horizon in HORIZONS:
        output = round(horizon / INTERVAL) - 1
        parts = {"angle": errors[:, output, :2], "velocity": errors[:, output, 2:]}
        summary[f"{horizon:g}"] = {
            name: float(np.sqrt(np.mean(part**2))) if part.size else None for name, part in parts.items()
        }
    return summary
