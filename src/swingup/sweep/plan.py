"""The runs of a sweep: every combination of alternatives with every seed."""

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..areapo.config import check_hyperparameter, check_value, config_from_dict, format_value, parse_value
from ..common.checks import whole_number
from ..common.errors import SwingupError
from ..common.text import quoted
from ..learner.presets import choose_preset, get_preset, preset_name
from ..learner.run_settings import RunSettings, default_intervals
from ..plant.plant import LEADERBOARD, PlantLike, load_plant
from ..plant.robots import ROBOTS
from .jobs import Job

MOST_RUNS = 10_000
"""More runs than this are taken for a typing error."""


def base_settings(
    env: str, preset: str | None = None, plant: PlantLike = LEADERBOARD, **intervals: int | None
) -> dict[str, Any]:
    """Fields of :class:`.RunSettings` that all runs of a sweep share: all but seed and hyperparameters.

    Args:
        env: ``acrobot``, ``pendubot`` or a Gymnasium id, also ``your.module:Task-v0``.
        preset: named settings; by default those of the task.
        plant: the robot's pendulum.
        intervals: ``evaluate_every``, ``checkpoint_every`` and ``evaluation_episodes``; None for the defaults.

    Raises:
        SwingupError: the environment has no name, or there is no such preset or plant.
    """
    if not isinstance(env, str):
        raise SwingupError(f"env = {quoted(env)}: runs have processes of their own: name a Gymnasium id")
    robot = env if env in ROBOTS else None
    task = {"robot": robot, "env": None if robot else env, "preset": choose_preset(preset, env)}
    given = {name: value for name, value in intervals.items() if value is not None}
    return {**task, "plant": load_plant(plant), **default_intervals(robot), **given}


def plan_jobs(
    base: Mapping[str, Any],
    grid: Mapping[str, Sequence[Any]],
    seeds: Sequence[int],
    out: str | Path,
    frames: int | None = None,
) -> list[Job]:
    """The jobs of a sweep: every combination of the grid with every seed.

    Args:
        base: what all runs share, from :func:`base_settings`.
        grid: the alternatives by the name of a hyperparameter, or ``preset``.
        seeds: the seeds.
        out: folder of the sweep, in which each run has its own.
        frames: length of the runs; by default the preset's.

    Raises:
        SwingupError: a setting is unknown or cannot work, there are too many runs, two are the same, or the presets
            have runs of different lengths.
    """
    count = math.prod(map(len, grid.values())) * len(seeds)
    if count > MOST_RUNS:
        raise SwingupError(f"this sweep has {count:,} runs: choose at most {MOST_RUNS:,}")
    length = common_length(base, grid.get("preset", ()), frames)
    jobs: list[Job] = []
    for values in itertools.product(*grid.values()):
        chosen = dict(zip(grid, values, strict=True))
        jobs += plan_variant(base, chosen, seeds, Path(out) / (describe(chosen, ",") or "base"), length)
    if len({job.folder for job in jobs}) < len(jobs):
        raise SwingupError("two runs of the sweep are the same: give each alternative and each seed once")
    return jobs


def common_length(base: Mapping[str, Any], presets: Sequence[str], frames: int | None) -> int:
    """The length of the runs: ``frames``, or that of all these presets, by default the base's.

    Raises:
        SwingupError: ``frames`` is not a length, or missing where the presets differ.
    """
    if frames is not None:
        return whole_number("frames", frames, 1)
    # One length for all: a table of runs of different lengths would compare lengths.
    lengths = {get_preset(name).frames for name in presets or [base["preset"]]}
    if len(lengths) > 1:
        raise SwingupError(f"these presets train for {sorted(lengths)} frames: give --frames for all of them")
    return lengths.pop()


def plan_variant(
    base: Mapping[str, Any], chosen: Mapping[str, Any], seeds: Sequence[int], folder: Path, frames: int
) -> list[Job]:
    """The jobs of one choice of settings: one for each seed, in folders of their own below ``folder``.

    Raises:
        SwingupError: the settings cannot work, for themselves or together.
    """
    preset = chosen.get("preset", base["preset"])
    changes = {name: value for name, value in chosen.items() if name != "preset"}
    config = config_from_dict(vars(get_preset(preset).config) | changes)
    jobs = []
    for seed in seeds:
        settings = RunSettings(**{**base, "preset": preset, "seed": seed, "seeds": 1}, config=config)
        # Absolute, since workers may have another working directory.
        jobs.append(Job(describe(chosen), settings.as_dict(), str(folder.absolute() / f"seed-{seed}"), frames))
    return jobs


def describe(chosen: Mapping[str, Any], separator: str = " ") -> str:
    """Settings as words like ``learning_rate=0.001``."""
    return separator.join(f"{name}={format_value(value)}" for name, value in chosen.items())


def split_assignments(assignments: Sequence[str]) -> dict[str, str]:
    """The text of what varies by name, from words like ``learning_rate=3e-4,5e-4``; a repeated name adds to it.

    Raises:
        SwingupError: a word is not an assignment.
    """
    texts: dict[str, str] = {}
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        if not equals:
            raise SwingupError(
                f"--set {quoted(assignment)}: write NAME=VALUE,VALUE with a hyperparameter's name or preset"
            )
        name = name.replace("-", "_")
        texts[name] = f"{texts[name]},{text}" if name in texts else text
    return texts


def parse_alternatives(name: str, text: str) -> list[Any]:
    """The alternatives of a hyperparameter, or of ``preset``, that commas separate.

    Raises:
        SwingupError: the name is unknown, or a value cannot work.
    """
    if name == "preset":
        return [preset_name(part) for part in text.split(",")]
    check_hyperparameter(name, ["preset"])
    if ":" in text:
        raise SwingupError(f"{name}={text} is a range: give --trials to search it, or alternatives")
    values = [parse_value(name, part) for part in text.split(",")]
    for value in values:
        check_value(name, value)
    return values
