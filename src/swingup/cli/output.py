"""What commands print: lines that are safe for a terminal, one JSON object, and progress on standard error."""

import contextlib
import json
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.measure import Measurement
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from ..benchmark.leaderboard import RowProgress
from ..common.text import duration

SECONDS_BETWEEN_LINES = 10.0
"""Between lines of progress where there is no terminal for a bar."""


WIDEST = 1000
"""No table needs more columns of text than this."""


def printable(text: str) -> str:
    """The text with line ends, escape sequences and broken characters written out as Python's escapes."""
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


def tell(*lines: str) -> None:
    """Print lines of results; names in them may come from anywhere."""
    for line in lines:
        print(printable(line))


def log(line: str) -> None:
    """Print a line of progress, which is not a result, on standard error."""
    print(printable(line), file=sys.stderr, flush=True)


def show_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table with words in its first column and numbers in the others."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column(headings[0], no_wrap=True)
    for heading in headings[1:]:
        table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*map(escape, row))
    console = Console()
    if not console.is_terminal:  # a file or a pipe has no width to keep to
        console.width = WIDEST
        console.width = Measurement.get(console, console.options, table).maximum
    console.print(table)


def tell_json(result: Mapping[str, Any] | Sequence[Mapping[str, Any]], indent: int | None = None) -> None:
    """Print a result as one JSON object, or several as a list."""
    print(json.dumps(result, indent=indent))


def foreign_prints_apart() -> contextlib.AbstractContextManager[object]:
    """Foreign controllers print to standard error, so that their lines do not mix with results."""
    return contextlib.redirect_stdout(sys.stderr)


def to_last(seed: int, seeds: int) -> str:
    """The end of "seed 3 to 5", empty for a single seed."""
    return f" to {seed + seeds - 1}" if seeds > 1 else ""


def aligned(title: str, value: str, extra: str = "", width: int = 8) -> str:
    """One row of a result: its title, its value, and a remark in brackets."""
    return f"  {title:<26}{value:>{width}}{f'   ({extra})' if extra else ''}"


@contextlib.contextmanager
def progress_shown() -> Iterator[RowProgress]:
    """Shows (label, finished, total): a bar on a terminal, elsewhere a line now and then."""
    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=12),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    bar = Progress(
        *columns,
        console=console,
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
        disable=not console.is_terminal,
    )
    with bar:
        task = bar.add_task("", total=None, visible=False)
        label, begun, shown = "", 0.0, time.monotonic()

        def tell_progress(name: str, done: int, total: int) -> None:
            nonlocal label, begun, shown
            now = time.monotonic()
            if name != label:
                label, begun = name, now
                bar.reset(task, total=total, description=escape(printable(name)), visible=True)
            bar.update(task, total=total, completed=done)
            if now - shown >= SECONDS_BETWEEN_LINES and not console.is_terminal:
                shown = now
                left = f", {duration((now - begun) * (total - done) / done)} left" if done else ""
                line = f"{printable(name)}: {done} of {total}{left}"
                console.print(line, soft_wrap=True, highlight=False, markup=False)

        yield tell_progress
