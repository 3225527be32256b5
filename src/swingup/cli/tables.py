"""Boards as text for a terminal, JSON, CSV or Markdown."""

import csv
import io
import json
import re
from collections.abc import Callable, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.measure import Measurement
from rich.table import Table

from ..benchmark.board_rows import ON_ROBOT, OURS, Row
from ..benchmark.columns import COLUMNS
from ..benchmark.leaderboard import Board
from ..common.text import one_line
from .arguments import plant_note
from .output import printable

WIDEST = 1000
"""No table needs more columns of text than this."""
LONGEST_CELL = 1000
"""Characters of a Markdown cell; longer texts are cut."""


def show_boards(boards: Sequence[Board]) -> None:
    """Print boards for people."""
    for board in boards:
        table = Table(title=_title(board), title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
        table.add_column("Controller", no_wrap=True)
        table.add_column("Source", no_wrap=True)
        for name in board.columns:
            # Headings may be cut where a terminal is narrow, numbers never.
            longest = max(len(COLUMNS[name].show(row.values[name])) for row in board.rows)
            table.add_column(escape(COLUMNS[name].heading), justify="right", min_width=longest)
        for row in board.rows:
            style = "bold" if row.source == OURS else ""
            table.add_row(escape(printable(row.controller)), row.source, *_cells(board, row), style=style)
        console = Console()
        needed = Measurement.get(console, console.options.update(max_width=WIDEST), table)
        # A file or a pipe has no width to keep to: there no cell is cut.
        console.width = max(console.width, needed.minimum if console.is_terminal else needed.maximum)
        console.print(table)
        for remark in _remarks(board):
            console.print(escape(printable(remark)), soft_wrap=True, highlight=False)


def boards_as_json(boards: Sequence[Board]) -> str:
    """One list of rows."""
    return json.dumps([row for board in boards for row in board.as_dicts()], indent=2)


def boards_as_csv(boards: Sequence[Board]) -> str:
    """One table for all boards, with the columns of each."""
    rows = [row for board in boards for row in board.as_dicts()]
    columns = list(dict.fromkeys(name for row in rows for name in row if name != "remark"))
    text = io.StringIO()
    writer = csv.DictWriter(text, [*columns, "remark"], lineterminator="\n")
    writer.writeheader()
    # Line ends in a name are quoted; escape sequences would reach the terminal that shows the table.
    writer.writerows({name: _csv_cell(value) for name, value in row.items()} for row in rows)
    return text.getvalue().rstrip("\n")


def boards_as_markdown(boards: Sequence[Board]) -> str:
    """One table for each board."""
    return "\n\n".join(_markdown(board) for board in boards)


TABLE_FORMATS: dict[str, Callable[[Sequence[Board]], str]] = {
    "json": boards_as_json,
    "csv": boards_as_csv,
    "markdown": boards_as_markdown,
}


def _markdown(board: Board) -> str:
    def line(cells: Sequence[str], mark: str = "") -> str:
        return "| " + " | ".join(f"{mark}{_markdown_text(text)}{mark}" for text in cells) + " |"

    heads = ["Controller", "Source", *(COLUMNS[name].title for name in board.columns)]
    rule = "|---|---|" + "---:|" * len(board.columns)
    rows = [
        line([row.controller, row.source, *_cells(board, row)], "**" if row.source == OURS else "")
        for row in board.rows
    ]
    remarks = [f"\n{_markdown_text(remark)}" for remark in _remarks(board)]
    return "\n".join([f"### {_title(board)}\n", line(heads), rule, *rows, *remarks])


def _csv_cell(value: object) -> object:
    return "\n".join(map(printable, value.split("\n"))) if isinstance(value, str) else value


def _markdown_text(text: str) -> str:
    """Text in one line that Markdown and HTML show as it is."""
    safe = one_line(text, LONGEST_CELL).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"([\\`*_|\[\]])", r"\\\1", safe)


def _cells(board: Board, row: Row) -> list[str]:
    return [COLUMNS[name].show(row.values[name]) for name in board.columns]


def _remarks(board: Board) -> list[str]:
    remarks = [f"{row.controller}: {row.remark}" for row in board.rows if row.remark]
    if any(row.source == ON_ROBOT for row in board.rows):
        remarks.append(f"Rows of source {ON_ROBOT!r} were measured on the real robot; ours are simulated.")
    return remarks if board.note is None else [*remarks, board.note]


def _title(board: Board) -> str:
    seed = "" if board.seed is None else f", seed {board.seed}"
    plant, measure = plant_note(board.plant, board.robot), board.measure.capitalize().replace("_", " ")
    return f"{measure} scores of the {board.robot} (rules {board.rules}{seed}{plant})"
