"""A trial of a search: the runs of its seeds, their scores on the way, and what came of it."""

import math
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ..benchmark.interval import interquartile_mean
from ..learner.metrics import METRICS_FILE, read_metrics
from .jobs import Job, JobOutcome, outcome_of, prune
from .study import RUNGS, place_of

if TYPE_CHECKING:
    from optuna.study import Study
    from optuna.trial import Trial

State = Literal["complete", "pruned", "failed"]
ERROR = "error"
"""The user attribute of a trial that says why it has no score."""


@dataclass(frozen=True)
class TrialRow:
    """A trial that has ended."""

    trial: int
    """Its number, which its folder has as well."""
    state: State
    score: float
    """Interquartile mean of its seeds' last scores; of a pruned trial the last one that was seen."""
    settings: str
    """What varies, as text."""
    error: str = ""
    """The reason why there is no score; empty where there is one."""


class RunningTrial:
    """A trial whose runs are on the executor."""

    def __init__(self, trial: "Trial", jobs: list[Job], futures: "list[Future[JobOutcome]]") -> None:
        """A trial and the futures of its jobs."""
        self.trial, self.jobs, self.futures = trial, jobs, futures
        self._rung, self._pruned = 0, False

    def report(self) -> bool:
        """Tell the study the intermediate scores that all seeds have, and end the runs if it expects no more.

        Returns:
            Whether all runs have ended.
        """
        # Before the scores are read, so that those of a run that has ended are complete.
        done = all(future.done() for future in self.futures)
        scores = [rung_scores(job) for job in self.jobs]
        for rung in range(self._rung + 1, RUNGS):
            if self._pruned or any(rung not in each for each in scores):
                continue
            self.trial.report(interquartile_mean([each[rung] for each in scores]), rung)
            self._rung = rung
            if not done and self.trial.should_prune():
                self._pruned = True
                for job in self.jobs:
                    prune(job)
        return done

    def finish(self, study: "Study") -> TrialRow:
        """Tell the study what came of the trial.

        Raises:
            SwingupError: the executor lost its workers.
        """
        outcomes = [outcome_of(future, job) for future, job in zip(self.futures, self.jobs, strict=True)]
        settings, scores = self.jobs[0].variant, [outcome.score for outcome in outcomes]
        error = next((outcome.error for outcome in outcomes if outcome.error), "")
        if not error and any(outcome.pruned for outcome in outcomes):
            return end_trial(study, self.trial, settings, "pruned")
        if not error and all(map(math.isfinite, scores)):
            return end_trial(study, self.trial, settings, "complete", interquartile_mean(scores))
        return end_trial(study, self.trial, settings, "failed", error=error or "its score is no number")


def end_trial(
    study: "Study", trial: "Trial", settings: str, state: State, score: float | None = None, error: str = ""
) -> TrialRow:
    """Tell the study the state of a trial, its score where it is complete, or why it failed."""
    from optuna.trial import TrialState

    if error:
        trial.set_user_attr(ERROR, error)
    states = {"complete": TrialState.COMPLETE, "pruned": TrialState.PRUNED, "failed": TrialState.FAIL}
    ended = study.tell(trial, score, states[state])
    value = math.nan if ended.value is None else ended.value
    return TrialRow(place_of(trial), state, value, settings, error)


def rung_scores(job: Job) -> dict[int, float]:
    """A run's scores by the tenths of its length: of each, the first report at or after its end."""
    path = Path(job.folder) / METRICS_FILE
    scores: dict[int, float] = {}
    for row in read_metrics(path) if path.exists() else []:
        score: Any = row.get("score")
        if isinstance(score, int | float):
            scores.setdefault(RUNGS * row["frames"] // job.frames, float(score))
    return scores
