"""Tables of boards as text for a terminal, JSON, CSV or Markdown."""

import csv
import io
import json
import re
from collections.abc import Callable, Sequence

from ..benchmark.columns import COLUMNS
from ..benchmark.leaderboard import ON_ROBOT, OURS, Row, Table
from ..common.text import one_line, printable
from ..report.log_report import Part
from .arguments import plant_note
from .output import tell, tell_table

LONGEST_CELL = 1000
"""Characters of a Markdown cell; longer texts are cut."""


def show_tables(tables: Sequence[Table]) -> None:
    """Print tables for people."""
    for table in tables:
        headings = ["Controller", "Source", *(COLUMNS[name].heading for name in table.columns)]
        rows = [[row.controller, row.source, *_cells(table, row)] for row in table.rows]
        ours = [index for index, row in enumerate(table.rows) if row.source == OURS]
        tell_table(headings, rows, texts=2, title=_title(table), bold=ours)
        tell(*_remarks(table))


def show_parts(parts: Sequence[Part], notes: Sequence[str]) -> None:
    """Print the tables of a report about logs, and its notes."""
    for part in parts:
        for table in part.tables:
            tell_table(table.heads, table.rows, title=part.title)
    tell(*notes)


def tables_as_csv(tables: Sequence[Table]) -> str:
    """One table for all boards, with the columns of each."""
    rows = [row for table in tables for row in table.as_dicts()]
    columns = list(dict.fromkeys(name for row in rows for name in row if name != "remark"))
    text = io.StringIO()
    writer = csv.DictWriter(text, [*columns, "remark"], lineterminator="\n")
    writer.writeheader()
    # Line ends in a name are quoted; escape sequences would reach the terminal that shows the table.
    writer.writerows({name: _csv_cell(value) for name, value in row.items()} for row in rows)
    return text.getvalue().rstrip("\n")


TABLE_FORMATS: dict[str, Callable[[Sequence[Table]], str]] = {
    "json": lambda tables: json.dumps([row for table in tables for row in table.as_dicts()], indent=2),
    "csv": tables_as_csv,
    "markdown": lambda tables: "\n\n".join(map(_markdown, tables)),
}
"""Texts of several tables: one list of rows, one table with the columns of all, or a table each."""


def _markdown(table: Table) -> str:
    def line(cells: Sequence[str], mark: str = "") -> str:
        return "| " + " | ".join(f"{mark}{_markdown_text(text)}{mark}" for text in cells) + " |"

    heads = ["Controller", "Source", *(COLUMNS[name].title for name in table.columns)]
    rule = "|---|---|" + "---:|" * len(table.columns)
    rows = [
        line([row.controller, row.source, *_cells(table, row)], "**" if row.source == OURS else "")
        for row in table.rows
    ]
    remarks = [f"\n{_markdown_text(remark)}" for remark in _remarks(table)]
    return "\n".join([f"### {_title(table)}\n", line(heads), rule, *rows, *remarks])


def _csv_cell(value: object) -> object:
    return "\n".join(map(printable, value.split("\n"))) if isinstance(value, str) else value


def _markdown_text(text: str) -> str:
    """Text in one line that Markdown and HTML show as it is."""
    safe = one_line(text, LONGEST_CELL).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"([\\`*_|\[\]])", r"\\\1", safe)


def _cells(table: Table, row: Row) -> list[str]:
    return [COLUMNS[name].show(row.values[name]) for name in table.columns]


def _remarks(table: Table) -> list[str]:
    remarks = [f"{row.controller}: {row.remark}" for row in table.rows if row.remark]
    if any(row.source == ON_ROBOT for row in table.rows):
        remarks.append(f"Rows of source {ON_ROBOT!r} were measured on the real robot; ours are simulated.")
    return remarks if table.note is None else [*remarks, table.note]


def _title(table: Table) -> str:
    seed = "" if table.seed is None else f", seed {table.seed}"
    return f"Board {table.board}, {table.robot}{seed}{plant_note(table.plant, table.robot)}"
