"""The progress of a run as one value, with exactly the content of a checkpoint, and its report after each chunk."""

import math
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from ..areapo.state import LearnerState
from ..common.checks import finite_number, is_number, whole_number
from ..common.errors import MALFORMED, SwingupError, one_line
from .metrics import Row, shown_rate
from .run_settings import RunSettings, run_settings_from_dict

Rank = tuple[bool, float]
"""Whether a policy has a score, and the score, or else its reward rate: the greater, the better."""
UNRANKED: Rank = (False, -math.inf)


@dataclass(frozen=True)
class TrainingProgress:
    """The state of training after some iterations."""

    state: LearnerState  # State of the learner; of several seeds, with a leading axis
    best: tuple[Rank, ...]  # Rank of each seed's best policy
    iterations: int = 0
    seconds: float = 0.0  # Time spent so far, compilation and files included (s)

    @property
    def best_seed(self) -> int:
        """Index of the seed with the best policy; 0 before the first evaluation."""
        return max(range(len(self.best)), key=self.best.__getitem__)

    def metadata(self, settings: RunSettings) -> dict[str, Any]:
        """The metadata of a checkpoint."""
        return {
            "settings": settings.as_dict(),
            "iterations": self.iterations,
            "seconds": self.seconds,
            "best": [list(rank) for rank in self.best],
        }


def rank(score: Any, reward_rate: Any) -> Rank:
    """The rank of a policy by its score, or else its reward rate.

    A task that is scored by episodes of training has no score while no episode ends; policies are then compared by
    their reward rates. Any score ranks above any rate: the reward of a step and the return of an episode do not
    compare.
    """
    if is_number(score):
        return True, float(score)
    return (False, float(reward_rate)) if is_number(reward_rate) else UNRANKED


def score_of(best: Rank) -> float | None:
    """The score in a rank; None where there is none yet."""
    return best[1] if best[0] else None


def read_progress(
    state: LearnerState, metadata: dict[str, Any], settings: RunSettings, source: str
) -> TrainingProgress:
    """The progress that a checkpoint holds; errors name its source."""
    try:
        saved = run_settings_from_dict(metadata["settings"])
        # JSON has no infinities: that of a seed without an evaluation was written as null.
        best = tuple(
            UNRANKED if value is None else (bool(scored), finite_number("best", value, -math.inf, math.inf))
            for scored, value in metadata["best"]
        )
        iterations = whole_number("iterations", metadata["iterations"], 0)
        seconds = finite_number("seconds", metadata["seconds"], 0.0)
    except (*MALFORMED, SwingupError) as error:
        raise SwingupError(f"{source} is malformed ({one_line(error, 200)}): delete it or restore it") from error
    # What the environments hold is theirs: infinite may be right there.
    learned = {name: value for name, value in vars(state).items() if name not in ("task_states", "key")}
    if not is_finite(learned):
        raise SwingupError(f"{source} holds weights or statistics that are not finite: delete it or restore it")
    # A checkpoint is trusted only with the settings that it was written under: shapes alone may agree.
    if saved.as_dict() != settings.as_dict() or len(best) != settings.seeds:
        raise SwingupError(f"{source} is of another configuration than config.json: restore one of them")
    return TrainingProgress(state, best, iterations, seconds)


def is_finite(tree: Any) -> bool:
    """Whether all numbers of a pytree of arrays are finite."""
    return all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(tree))


@dataclass(frozen=True)
class TrainingReport:
    """The progress of a run after a chunk; its text is one line."""

    frames: int
    """Frames of each seed so far."""
    frames_per_second: float
    """Frames of all seeds together in a second, since the last report, evaluation and files included."""
    rows: tuple[Row, ...]
    """The row of each seed in metrics.jsonl."""
    best_score: float | None
    """Best score of any seed so far."""

    @property
    def best(self) -> Row:
        """The row of the seed whose policy is the best in this report."""
        return max(self.rows, key=lambda row: rank(row.score, row.evaluation.reward_rate))

    @property
    def score(self) -> float | None:
        """Score of that seed; None where no episode ended that gives one."""
        return self.best.score

    def __str__(self) -> str:
        row = self.best
        rate = row.evaluation.success_rate
        success = "" if rate is None else f"successes {rate:.0%}, "
        return (
            f"{self.frames:,} frames, {self.frames_per_second:.0f}/s, reward {shown_rate(row.reward)}, "
            f"gain {shown_rate(row.gain)}, resets per 1,000 steps {shown_rate(row.resets_per_1000_steps)}, "
            f"{success}score {shown_rate(row.score)}, best {shown_rate(self.best_score)}"
        )
