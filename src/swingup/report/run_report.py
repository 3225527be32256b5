"""The page of runs: what was trained and how, what the best policies reach, and their learning curves."""

from collections.abc import Sequence
from pathlib import Path

from ..learner.card import best_policy, facts
from ..learner.metrics import METRICS_FILE, MISSING, read_metrics
from .figure import Figure
from .figures import curves_figure, make_labels
from .log_report import LogReport, Part, Table


def learning_curves(runs: Sequence[str | Path]) -> Figure:
    """The metrics of runs, from their folders or from files of metrics."""
    files = [_metrics_file(run) for run in runs]
    return curves_figure(dict(zip(make_labels(files), map(read_metrics, files), strict=True)))


def curves_part(runs: Sequence[str | Path]) -> Part:
    """The metrics of runs as a part of a page."""
    note = "Reward rate and resets are the exploring policy's. A dot is an evaluation, the line the best so far."
    return Part("Learning curves", note, figure=learning_curves(runs))


def report_runs(runs: Sequence[str | Path]) -> LogReport:
    """Lay out runs, each in its folder: facts of the best policies, and the learning curves."""
    files, curves = [_metrics_file(run) for run in runs], curves_part(runs)
    names, found = make_labels(files), [facts(best_policy(file.parent)) for file in files]
    keys = dict.fromkeys(key for each in found for key in each)
    rows = [[key, *(each.get(key, MISSING) for each in found)] for key in keys]
    best = Part("Best policies", "By the score of their evaluations.", [Table(["", *names], rows)])
    return LogReport(", ".join(names), "Training runs by swingup.", [best, curves], pendulums=False)


def _metrics_file(run: str | Path) -> Path:
    return Path(run) / METRICS_FILE if Path(run).is_dir() else Path(run)
