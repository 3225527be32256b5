"""A run's policy files: their names, and the rank of the best one on disk."""

from pathlib import Path
from typing import Any

from ..common.errors import SwingupError
from ..common.text import one_line
from ..policy.file import read_network
from .progress import UNRANKED, Rank, rank
from .run_settings import MALFORMED, RunSettings

BEST, LAST = "best.safetensors", "last.safetensors"


def seed_file(name: str, settings: RunSettings, index: int) -> str:
    """File of a seed's best or last policy; with several seeds best.safetensors is the best of all."""
    return name if settings.seeds == 1 else name.replace(".", f"-{settings.seed + index}.")


def best_on_disk(folder: Path, settings: RunSettings, measure: str) -> list[Rank]:
    """Rank of each seed's best policy file, which may be newer than the checkpoint; a foreign one is refused."""
    if settings.seeds > 1:
        # Only to refuse a foreign file: the best of all is one of the seeds' best policies.
        _rank_on_disk(folder / BEST, settings, measure)
    return [
        _rank_on_disk(folder / seed_file(BEST, settings, index), settings, measure)
        for index in range(settings.seeds)
    ]


def result_on_disk(path: Path, measure: str) -> dict[str, Any]:
    """The result of the evaluation under which a policy file was written."""
    try:
        return dict(read_network(path)[1]["scores"][measure])
    except (KeyError, TypeError, ValueError) as error:
        raise SwingupError(f"{path} holds no result of {measure}: train again") from error


def _rank_on_disk(path: Path, settings: RunSettings, measure: str) -> Rank:
    if not path.exists():
        return UNRANKED
    try:
        # Loaded whole: a file with sound metadata and damaged weights is not a best policy.
        metadata = read_network(path)[1]
        trained_on = metadata.get("robot", settings.robot)
        if trained_on != settings.robot:
            raise SwingupError(f"it is for {one_line(trained_on, 40)}")
        found = rank(metadata["scores"][measure])
        if found == UNRANKED:
            raise SwingupError(f"it has no score of {measure}")
        return found
    except (SwingupError, *MALFORMED) as error:
        reason = one_line(error, 200)
        raise SwingupError(f"{path} is not a policy of this run ({reason}): move it away to resume") from error
