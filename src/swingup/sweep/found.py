"""What a search has found: its trials, and the best one as settings to train with."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..areapo.words import format_value
from ..common.arrays import finite
from ..common.files import write_atomically
from ..learner.run_settings import run_settings_from_dict
from .search_plan import SearchPlan
from .study import chosen_values, latest_trials
from .trials import ERROR, State, TrialRow

if TYPE_CHECKING:
    from optuna.study import Study

SEARCH_FILE, BEST_FILE = "search.json", "best.json"


@dataclass(frozen=True)
class BestTrial:
    """The trial with the best score, and how to train with its hyperparameters."""

    trial: int
    score: float
    preset: str
    hyperparameters: dict[str, Any]
    """What the search chose, as keywords of :class:`swingup.AREAPO`."""
    folder: str
    """The trial's runs, with their policies."""
    command: str
    """Trains its first seed again."""


@dataclass(frozen=True)
class SearchResult:
    """The trials of a search that have ended."""

    rows: list[TrialRow]
    best: BestTrial | None
    """None if no trial is complete."""


def write_found(plan: SearchPlan, result: SearchResult) -> None:
    """Write ``search.json`` and, once there is a best trial, ``best.json``.

    Raises:
        SwingupError: a file cannot be written.
    """
    write_atomically(plan.out / SEARCH_FILE, as_json([asdict(row) for row in result.rows]))
    if result.best is not None:
        write_atomically(plan.out / BEST_FILE, as_json(asdict(result.best)))


def as_json(content: Any) -> bytes:
    """JSON, in which null stands for what is no number."""
    return (json.dumps(finite(content), indent=2) + "\n").encode()


def found(plan: SearchPlan, study: "Study") -> SearchResult:
    """The trials that have ended, in the order of their numbers, and the best of them."""
    rows, best = [], None
    states: dict[str, State] = {"COMPLETE": "complete", "PRUNED": "pruned", "FAIL": "failed"}
    for place, trial in sorted(latest_trials(study).items()):
        if trial.state.name not in states:
            continue
        words = " ".join(f"{name}={format_value(value)}" for name, value in trial.params.items())
        score = float("nan") if trial.value is None else trial.value
        row = TrialRow(place, states[trial.state.name], score, words, trial.user_attrs.get(ERROR, ""))
        rows.append(row)
        if row.state == "complete" and (best is None or score > best[0].score):
            best = (row, trial)
    return SearchResult(rows, None if best is None else _best(plan, best[0], chosen_values(best[1].params)))


def _best(plan: SearchPlan, row: TrialRow, chosen: dict[str, Any]) -> BestTrial:
    job = plan.jobs(chosen, row.trial)[0]
    settings = run_settings_from_dict(job.settings)
    return BestTrial(
        trial=row.trial,
        score=row.score,
        preset=settings.preset,
        hyperparameters={name: value for name, value in chosen.items() if name != "preset"},
        folder=str(Path(job.folder).parent),
        command=settings.command(plan.frames),
    )
