"""The progress of every command, on standard error: a bar on a terminal, elsewhere a line now and then."""

import time
from contextlib import AbstractContextManager

from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar
from rich.table import Column

from ..common.text import duration, printable

SECONDS_BETWEEN_LINES = 10.0
"""Where there is no terminal for a bar."""


class Progress(AbstractContextManager["Progress"]):
    """Shows a stage of a command, how much of it is finished, the time left, and figures."""

    def __init__(self) -> None:
        """Nothing is shown before the first stage."""
        self._console = Console(stderr=True)
        text = TextColumn(
            "{task.description}", markup=False, table_column=Column(no_wrap=True, overflow="ellipsis")
        )
        self._bar = Bar(
            BarColumn(bar_width=8, table_column=Column(width=8)),
            text,
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
