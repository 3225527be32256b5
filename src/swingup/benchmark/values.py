"""The values that boards show: names and units, intervals over seeds, and the mean of the middle half of them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, stdev
from typing import Any

PERFORMANCE = ("swingup_time", "energy", "torque_cost", "torque_smoothness", "velocity_cost", "score")
"""Columns of a board of swing-ups in a perfect loop."""


@dataclass(frozen=True)
class Column:
    """One criterion or score."""

    label: str
    heading: str  # The label in short lines, for narrow tables
    unit: str  # As the paper prints it; none for scores
    form: str  # Format of its numbers

    @property
    def title(self) -> str:
        """The label with its unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    def show(self, value: float | None) -> str:
        """A value as the paper prints it; a dash where there is nothing to measure."""
        return "–" if value is None else format(value, self.form)


COLUMNS = {
    "swingup_time": Column("Swing-up time", "Time\n[s]", "s", ".2f"),
    "energy": Column("Energy", "Energy\n[J]", "J", ".2f"),
    # Units as printed. By their definitions the torque cost is in N² m² s, the velocity cost in rad²/s.
    "torque_cost": Column("Torque cost", "Torque\ncost", "N²m²", ".2f"),
    "torque_smoothness": Column("Torque smoothness", "Smooth-\nness", "Nm", ".4f"),
    "velocity_cost": Column("Velocity cost", "Velocity\ncost", "m²/s²", ".2f"),
    "score": Column("Score", "Score", "", ".3f"),
    "model": Column("Model", "Model\n[%]", "%", ".1f"),
    "velocity_noise": Column("Velocity noise", "Vel.\nnoise", "%", ".1f"),
    "torque_noise": Column("Torque noise", "Torq.\nnoise", "%", ".1f"),
    "torque_response": Column("Torque step response", "Torq.\nresp.", "%", ".1f"),
    "delay": Column("Time delay", "Time\ndelay", "%", ".1f"),
    "perturbations": Column("Perturbations", "Per-\nturb.", "%", ".1f"),
    "swingups": Column("Swing-ups", "Swing-\nups", "%", ".0f"),
    "best": Column("Best score", "Best\nscore", "", ".3f"),
}


Interval = tuple[float, float]


def mean_interval(values: Sequence[float], lowest: float, highest: float) -> Interval:
    """Student's 95 % interval of the mean of two or more values, one a seed, cut to what is possible."""
    from scipy.stats import t  # imported here: slow to load, and only several seeds need it

    reach = float(t.ppf(0.975, len(values) - 1)) * stdev(values) / math.sqrt(len(values))
    return max(lowest, fmean(values) - reach), min(highest, fmean(values) + reach)


def share_interval(successes: int, number: int) -> Interval:
    """Wilson's 95 % interval of a share of successes."""
    from scipy.stats import binomtest  # imported here: slow to load

    interval = binomtest(successes, number).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def interquartile_mean(scores: Any, axis: int | None = None) -> Any:
    """Mean of the middle half: a quarter, rounded down, is left out at each end.

    Source: Agarwal et al., Deep RL at the edge of the statistical precipice (arXiv 2108.13264), section 4.
    """
    from scipy.stats import trim_mean  # imported here: slow to load

    return trim_mean(scores, 0.25, axis)


def interquartile_interval(scores: Sequence[float]) -> Interval | None:
    """95 % percentile bootstrap interval of the interquartile mean; None for fewer than two scores."""
    from scipy.stats import bootstrap  # imported here: slow to load

    if len(scores) < 2:
        return None
    found = bootstrap((scores,), interquartile_mean, method="percentile", rng=0).confidence_interval
    return float(found.low), float(found.high)
