"""A run's policy files: their names, where their policies come from, and the score of the best one on disk."""

import logging
import math
from pathlib import Path
from typing import Any

from ..common.checks import finite_number
from ..common.errors import SwingupError
from ..common.text import one_line
from ..common.version import __version__
from ..policy.file import read_network
from .progress import TrainingProgress
from .run_settings import RunSettings

BEST, LAST = "best.safetensors", "last.safetensors"

_LOGGER = logging.getLogger(__name__)


def best_name(settings: RunSettings, index: int) -> str:
    """File of a seed's best policy; with several seeds best.safetensors is the best of all."""
    return BEST if settings.seeds == 1 else f"best-{settings.seed + index}.safetensors"


def last_name(settings: RunSettings, index: int) -> str:
    """File of a seed's last policy."""
    return LAST if settings.seeds == 1 else f"last-{settings.seed + index}.safetensors"


def provenance(
    settings: RunSettings, progress: TrainingProgress, goal: int, index: int, scores: dict[str, Any]
) -> dict[str, Any]:
    """The origin of a seed's policy, and its scores by the names of their measures."""
    return {
        "version": __version__,
        "preset": settings.preset,
        "command": settings.command(goal),
        "seed": settings.seed + index,
        "frames": progress.iterations * settings.config.rollout_size,
        "seconds": round(progress.seconds, 1),
        "hyperparameters": settings.as_dict()["config"],
        "scores": scores,
    }


def best_scores_on_disk(folder: Path, settings: RunSettings, measure: str) -> list[float]:
    """Score of each seed's best policy file, which may be newer than the checkpoint; -inf without one.

    A damaged or foreign file is set aside, with a line in the log: it must neither keep the run from resuming
    nor be overwritten.
    """
    if settings.seeds > 1:
        # Only to set a foreign file aside: the score of the best of all is one of the seeds' scores.
        _score_on_disk(folder / BEST, settings, measure)
    return [
        _score_on_disk(folder / best_name(settings, index), settings, measure) for index in range(settings.seeds)
    ]


def result_on_disk(path: Path, measure: str) -> dict[str, Any]:
    """The result of the evaluation under which a policy file was written.

    Raises:
        SwingupError: the file cannot be read, or holds no result of this measure.
    """
    try:
        return dict(read_network(path)[1]["scores"][measure])
    except (KeyError, TypeError, ValueError) as error:
        raise SwingupError(f"{path} holds no result of {measure}: train again") from error


def _score_on_disk(path: Path, settings: RunSettings, measure: str) -> float:
    if not path.exists():
        return -math.inf
    try:
        # Loaded whole: a file with sound metadata and damaged weights is no best policy.
        metadata = read_network(path)[1]
        trained_on = metadata.get("robot", settings.robot)
        if trained_on != settings.robot:
            raise SwingupError(f"it is a policy for {one_line(trained_on, 40)}")
        return finite_number("score", metadata["scores"][measure]["score"])
    except (SwingupError, KeyError, TypeError, AttributeError) as error:
        aside = _set_aside(path)
        reason = str(error) if isinstance(error, SwingupError) else "it holds no score of this run's measure"
        _LOGGER.warning("swingup: %s is no policy of this run (%s): moved to %s", path, reason, aside.name)
        return -math.inf


def _set_aside(path: Path) -> Path:
    """Rename a file to a name that nothing has and no run writes."""
    number = 1
    while (aside := path.with_name(f"{path.name}.aside-{number}")).exists():
        number += 1
    try:
        return path.rename(aside)
    except OSError as error:
        raise SwingupError(f"cannot move {path} aside: {error.strerror}; move it away to resume") from error
