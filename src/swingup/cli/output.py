"""What commands print: lines that are safe for a terminal, JSON and tables; and progress, on standard error."""

import contextlib
import json
import shlex
import shutil
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.measure import Measurement
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar
from rich.table import Column, Table

from ..common.errors import duration, printable

PROGRAM = "swingup"
MAX_WIDTH = 1000
"""Maximum width of a table in a file or a pipe (characters)."""
SECONDS_BETWEEN_LINES = 10.0
"""Time between two lines of progress where no terminal shows a bar."""


def tell(*lines: str) -> None:
    """Print lines of results; names in them may come from anywhere."""
    for line in lines:
        print(printable(line))


def tell_json(result: Mapping[str, Any] | Sequence[Mapping[str, Any]], indent: int | None = None) -> None:
    """Print a result as one JSON object, or several as a list."""
    print(json.dumps(result, indent=indent))


def tell_table(
    headings: Sequence[str],
    rows: Sequence[Sequence[str]],
    texts: int = 1,
    title: str = "",
    bold: Sequence[int] = (),
) -> None:
    """Print a table: ``texts`` columns of text, then columns of numbers; ``bold`` has the indices of bold rows.

    Headings and texts may be cut where a terminal is narrow, numbers never.
    """
    table = Table(title=escape(printable(title)) or None, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for column, heading in enumerate(headings):
        number = column >= texts
        longest = max((len(row[column]) for row in rows), default=0) if number else None
        table.add_column(escape(heading), justify="right" if number else "left", no_wrap=True, min_width=longest)
    for index, row in enumerate(rows):
        table.add_row(*(escape(printable(cell)) for cell in row), style="bold" if index in bold else "")
    console = Console()
    needed = Measurement.get(console, console.options.update(max_width=MAX_WIDTH), table)
    # A file or a pipe has no width to keep to: there no heading is cut.
    console.width = max(console.width, needed.minimum if console.is_terminal else needed.maximum)
    console.print(table)


def foreign_prints_apart() -> contextlib.AbstractContextManager[object]:
    """Foreign controllers print to standard error, so that their lines do not mix with results."""
    return contextlib.redirect_stdout(sys.stderr)


def program_typed() -> str:
    """The program as it can be typed: its name, its path where no active environment has it, or the module."""
    started = Path(sys.argv[0])
    if started.name != PROGRAM:
        return f"{shlex.quote(sys.executable)} -m {PROGRAM}"
    found = shutil.which(PROGRAM)
    return PROGRAM if found and Path(found).resolve() == started.resolve() else shlex.quote(str(started))


class Progress:
    """Shows a stage of a command, how much of it is finished, the time left, and figures."""

    def __init__(self) -> None:
        """Nothing is shown before the first stage."""
        self._console = Console(stderr=True)
        column = Column(no_wrap=True, overflow="ellipsis")
        self._bar = Bar(
            BarColumn(bar_width=8, table_column=Column(width=8)),
            TextColumn("{task.description}", markup=False, table_column=column),
            console=self._console,
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
            disable=not self._console.is_terminal,
        )
        self._task = self._bar.add_task("", total=None, visible=False)
        self._stage, self._begun, self._first = "", 0.0, 0
        self._shown = time.monotonic()

    def __enter__(self) -> "Progress":
        """Show the bar."""
        self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Remove the bar."""
        self._bar.stop()

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """No bar while something else is shown."""
        self._bar.stop()
        try:
            yield
        finally:
            self._bar.start()

    def __call__(self, stage: str, done: int, total: int, figures: str = "") -> None:
        """Say where a stage stands; the last line of a stage with figures stays."""
        now = time.monotonic()
        if stage != self._stage:
            self._stage, self._begun, self._first = stage, now, done
        left = ""
        if done > self._first:
            left = f", {duration((now - self._begun) * (total - done) / (done - self._first))} left"
        line = f"{stage}: {done:,} of {total:,}{left}  {figures}".rstrip()
        self._bar.update(self._task, total=total, completed=done, description=printable(line), visible=True)
        due = now - self._shown >= SECONDS_BETWEEN_LINES and not self._console.is_terminal
        if due or (figures and done >= total):
            self._shown = now
            self.log(line)

    def log(self, line: str) -> None:
        """Print a line that stays."""
        self._console.print(printable(line), soft_wrap=True, highlight=False, markup=False)
