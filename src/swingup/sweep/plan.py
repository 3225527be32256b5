"""The runs of a sweep: every combination of alternatives with every seed."""

import itertools
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..areapo.config import check_hyperparameter, config_from_dict
from ..areapo.words import format_value, parse_value
from ..checks import whole_number
from ..errors import SwingupError
from ..learner.presets import get_preset
from ..learner.run_settings import RunSettings
from ..text import quoted
from .jobs import Job

Grid = Mapping[str, Sequence[Any]]
"""Alternatives of each setting: names of the hyperparameters, or ``preset``."""

MOST_RUNS = 10_000
"""More runs than this are taken for a typing error."""


def plan_jobs(
    base: Mapping[str, Any], grid: Grid, seeds: Sequence[int], out: str | Path, frames: int | None = None
) -> list[Job]:
    """The jobs of a sweep: every combination of the grid with every seed.

    Args:
        base: fields of :class:`.RunSettings` that all runs share, without seed and config.
        grid: the alternatives.
        seeds: the seeds.
        out: folder of the sweep, in which each run has its own.
        frames: length of the runs; by default the preset's.

    Raises:
        SwingupError: a setting is unknown or cannot work, there are too many runs, two are the same, or the presets
            have runs of different lengths.
    """
    count = math.prod(map(len, grid.values())) * len(seeds)
    if count > MOST_RUNS:
        raise SwingupError(
            f"this sweep has {count:,} runs, of at most {MOST_RUNS:,}: choose fewer seeds or alternatives"
        )
    # One length for all: a table of runs of different lengths would compare lengths.
    presets = {name: get_preset(name).frames for name in grid.get("preset", [base["preset"]])}
    if frames is None and len(set(presets.values())) > 1:
        lengths = ", ".join(f"{name} {length:,}" for name, length in presets.items())
        raise SwingupError(f"presets have runs of different lengths ({lengths} frames): give --frames")
    jobs: list[Job] = []
    for values in itertools.product(*grid.values()):
        chosen = dict(zip(grid, values, strict=True))
        words = [f"{name}={format_value(value)}" for name, value in chosen.items()]
        preset = chosen.pop("preset", base["preset"])
        config = config_from_dict(vars(get_preset(preset).config) | chosen)
        for seed in seeds:
            settings = RunSettings(**{**base, "preset": preset, "seed": seed, "seeds": 1}, config=config)
            # Absolute, since workers may have another working directory.
            folder = Path(out).absolute() / (",".join(words) or "base") / f"seed-{seed}"
            length = presets[preset] if frames is None else whole_number("frames", frames, 1)
            jobs.append(Job(" ".join(words), settings.as_dict(), str(folder), length))
    for path, count in Counter(job.folder for job in jobs).items():
        if count > 1:
            raise SwingupError(f"{path} would hold {count} runs: give each alternative and each seed once")
    return jobs


def parse_grid(assignments: Sequence[str]) -> dict[str, list[Any]]:
    """Alternatives from words like ``learning_rate=3e-4,5e-4`` or ``policy_layers=64x64,128x128``.

    Raises:
        SwingupError: a word is no assignment, a name is unknown, or a value is of another type.
    """
    grid: dict[str, list[Any]] = {}
    for assignment in assignments:
        name, equals, values = assignment.partition("=")
        name = name.replace("-", "_")
        if not equals:
            raise SwingupError(
                f"--set {quoted(assignment)}: write NAME=VALUE,VALUE with a hyperparameter's name or preset"
            )
        try:
            if name != "preset":
                check_hyperparameter(name, ["preset"])
            alternatives = [text if name == "preset" else parse_value(name, text) for text in values.split(",")]
        except SwingupError as error:
            raise SwingupError(f"--set {quoted(assignment)}: {error}") from error
        grid.setdefault(name, []).extend(alternatives)
    return grid
