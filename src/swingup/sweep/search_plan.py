"""The plan of a search: what varies, and the runs of each trial."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..common.checks import whole_number
from ..learner.run_settings import check_gru
from .jobs import Job
from .plan import MOST_RUNS, common_length, plan_variant
from .space import Range, Space, as_words, check_space


@dataclass(frozen=True)
class SearchPlan:
    """What is searched."""

    base: Mapping[str, Any]
    """Fields of :class:`.RunSettings` that all runs share, without seed and config."""
    space: Space
    """What varies."""
    out: Path
    """The folder of the search."""
    frames: int
    """Length of each run."""
    seed: int = 0
    """The first seed, from which the suggestions follow as well."""
    seeds: int = 1
    """How many seeds each trial trains."""

    def jobs(self, chosen: Mapping[str, Any], place: int) -> list[Job]:
        """The runs of a trial.

        Raises:
            SwingupError: these settings cannot work together.
        """
        seeds = range(self.seed, self.seed + self.seeds)
        return plan_variant(self.base, chosen, seeds, self.out / f"trial-{place}", self.frames)

    def as_dict(self) -> dict[str, Any]:
        """As JSON values: what a search that goes on must have in common with its beginning."""
        shared = {"frames": self.frames, "seed": self.seed, "seeds": self.seeds, "set": as_words(self.space)}
        return shared | {"settings": self.jobs({}, 0)[0].settings}


def plan_search(
    base: Mapping[str, Any],
    space: Mapping[str, Any],
    out: str | Path,
    frames: int | None = None,
    seed: int = 0,
    seeds: int = 1,
) -> SearchPlan:
    """Check what is searched, before anything is written.

    Raises:
        SwingupError: a setting is unknown or cannot work.
    """
    checked = check_space(space)
    presets = checked.get("preset", [base["preset"]])
    widths = checked.get("gru_width", [])
    # What goes with no other setting fails here, not trial by trial.
    for width in [int(widths.high)] if isinstance(widths, Range) else widths:
        check_gru(base.get("robot"), width)
    length = common_length(base, presets if isinstance(presets, list) else [], frames)
    seeds = whole_number("seeds", seeds, 1, MOST_RUNS)
    seed = whole_number("seed", seed, 0, 2**32 - seeds)
    plan = SearchPlan(base, checked, Path(out).absolute(), length, seed, seeds)
    plan.as_dict()
    return plan
