"""What commands print: lines that are safe for a terminal, one JSON object, and tables."""

import contextlib
import json
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.measure import Measurement
from rich.table import Table

from ..common.text import printable

WIDEST = 1000
"""No table needs more columns of text than this."""


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
    """Print a table with so many columns of ``texts`` at the left, and numbers, and with ``bold`` rows.

    Headings and texts may be cut where a terminal is narrow, numbers never.
    """
    table = Table(title=title or None, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for column, heading in enumerate(headings):
        if column < texts:
            table.add_column(heading, no_wrap=True)
        else:
            longest = max((len(row[column]) for row in rows), default=0)
            table.add_column(heading, justify="right", no_wrap=True, min_width=longest)
    for index, row in enumerate(rows):
        table.add_row(*(escape(printable(cell)) for cell in row), style="bold" if index in bold else "")
    console = Console()
    needed = Measurement.get(console, console.options.update(max_width=WIDEST), table)
    # A file or a pipe has no width to keep to: there no heading is cut.
    console.width = max(console.width, needed.minimum if console.is_terminal else needed.maximum)
    console.print(table)


def foreign_prints_apart() -> contextlib.AbstractContextManager[object]:
    """Foreign controllers print to standard error, so that their lines do not mix with results."""
    return contextlib.redirect_stdout(sys.stderr)


def aligned(title: str, value: str, extra: str = "") -> str:
    """One row of a result: its title, its value, and a remark in brackets."""
    return f"  {title:<26}{value:>12}{f'   ({extra})' if extra else ''}"
