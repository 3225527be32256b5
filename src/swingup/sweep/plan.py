"""The runs of a sweep: every combination of alternatives with every seed."""

import itertools
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..areapo.config import config_from_dict
from ..areapo.words import format_value
from ..common.checks import whole_number
from ..common.errors import SwingupError
from ..learner.presets import get_preset
from ..learner.run_settings import RunSettings
from .jobs import Job
from .space import Range, parse_space

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
    length = common_length(base, grid.get("preset", [base["preset"]]), frames)
    jobs: list[Job] = []
    for values in itertools.product(*grid.values()):
        chosen = dict(zip(grid, values, strict=True))
        words = [f"{name}={format_value(value)}" for name, value in chosen.items()]
        jobs += plan_variant(base, chosen, seeds, Path(out) / (",".join(words) or "base"), length)
    for path, count in Counter(job.folder for job in jobs).items():
        if count > 1:
            raise SwingupError(f"{path} would hold {count} runs: give each alternative and each seed once")
    return jobs


def common_length(base: Mapping[str, Any], presets: Sequence[str], frames: int | None) -> int:
    """The length of the runs: ``frames``, or that of all these presets.

    Raises:
        SwingupError: ``frames`` is no length, or missing where the presets differ.
    """
    if frames is not None:
        return whole_number("frames", frames, 1)
    # One length for all: a table of runs of different lengths would compare lengths.
    known = {name: get_preset(name, _is_of_pendulum(base)).frames for name in presets}
    if len(set(known.values())) > 1:
        lengths = ", ".join(f"{name} {length:,}" for name, length in known.items())
        raise SwingupError(f"presets have runs of different lengths ({lengths} frames): give --frames")
    return next(iter(known.values()))


def plan_variant(
    base: Mapping[str, Any], chosen: Mapping[str, Any], seeds: Sequence[int], folder: Path, frames: int
) -> list[Job]:
    """The jobs of one choice of settings: one for each seed, in folders of their own below ``folder``.

    Raises:
        SwingupError: the settings cannot work, for themselves or together.
    """
    words = " ".join(f"{name}={format_value(value)}" for name, value in chosen.items())
    preset = chosen.get("preset", base["preset"])
    changes = {name: value for name, value in chosen.items() if name != "preset"}
    config = config_from_dict(vars(get_preset(preset, _is_of_pendulum(base)).config) | changes)
    jobs = []
    for seed in seeds:
        settings = RunSettings(**{**base, "preset": preset, "seed": seed, "seeds": 1}, config=config)
        # Absolute, since workers may have another working directory.
        jobs.append(Job(words, settings.as_dict(), str(folder.absolute() / f"seed-{seed}"), frames))
    return jobs


def _is_of_pendulum(base: Mapping[str, Any]) -> bool:
    return base.get("robot") is not None


def parse_grid(assignments: Sequence[str]) -> dict[str, list[Any]]:
    """Alternatives from words like ``learning_rate=3e-4,5e-4`` or ``policy_layers=64x64,128x128``.

    Raises:
        SwingupError: a word is no assignment or has a range, a name is unknown, or a value is of another type.
    """
    grid: dict[str, list[Any]] = {}
    for name, values in parse_space(assignments).items():
        if isinstance(values, Range):
            raise SwingupError(f"--set {name}={values} is a range: give --trials to search it, or alternatives")
        grid[name] = values
    return grid
