"""The search of the command ``sweep``, with ``--trials``: a line for each trial, and the best of them."""

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..sweep.executors import workers_for
from ..sweep.found import SEARCH_FILE, SearchResult
from ..sweep.search import run_search
from ..sweep.search_plan import SearchPlan
from ..sweep.trials import TrialRow

SHOWN = 10
"""Trials in the table: the best ones."""


def show_search(
    plan: SearchPlan, trials: int, pruning: bool, scheduler: str | None, workers: int | None, json: bool
) -> int:
    """Run a search, show its trials as they end, and print the best ones or JSON.

    Raises:
        SwingupError: the search cannot run.
    """
    console = Console(stderr=True)

    def tell(row: TrialRow) -> None:
        outcome = row.error or ("pruned" if row.state == "pruned" else f"{row.score:.6g}")
        text = f"trial {row.trial}, {row.settings}: {outcome}"
        console.print(escape(text), soft_wrap=True, highlight=False)

    with workers_for(scheduler, workers) as pool:
        result = run_search(plan, trials, pool.executor, pool.count, pruning, tell)
    if json:
        print((plan.out / SEARCH_FILE).read_text(encoding="utf-8"), end="")
    else:
        _show(result)
    return 0 if result.best is not None else 1


def _show(result: SearchResult) -> None:
    complete = sorted((row for row in result.rows if row.state == "complete"), key=lambda row: -row.score)
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("Trial", justify="right")
    table.add_column("Settings", no_wrap=True)
    table.add_column("Score", justify="right")
    for row in complete[:SHOWN]:
        table.add_row(str(row.trial), escape(row.settings), f"{row.score:.4g}")
    console = Console()
    console.print(table)
    counts = [f"{sum(row.state == state for row in result.rows)} {state}" for state in ("pruned", "failed")]
    console.print(f"{len(complete)} trials complete, {', '.join(counts)}", highlight=False)
    if result.best is not None:
        console.print("The best one again, with another --seed or more --frames:", highlight=False)
        console.print(escape(result.best.command), soft_wrap=True, highlight=False)
