import csv
import io

import pytest

from swingup.benchmark.boards import BOARDS
from swingup.benchmark.columns import COLUMNS
from swingup.benchmark.leaderboard import Row, Table, published_rows
from swingup.cli.tables import TABLE_FORMATS, show_tables
from swingup.plant.robots import ROBOTS


@pytest.mark.parametrize("measure", ["performance", "robustness"])
@pytest.mark.parametrize("terminal", [True, False], ids=["narrow terminal", "pipe"])
def test_a_narrow_console_cuts_headings_and_no_number(measure, terminal, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setenv("TTY_COMPATIBLE", str(int(terminal)))
    monkeypatch.setenv("NO_COLOR", "1")
    board = Table(
        "acrobot", measure, BOARDS[measure].columns, None, tuple(published_rows(ROBOTS["acrobot"], measure))
    )
    show_tables([board])
    text = capsys.readouterr().out
    for row in board.rows:
        numbers = [COLUMNS[name].show(row.values[name]) for name in board.columns]
        assert [row.controller, row.source, *numbers] in [
            [line[: len(row.controller)], *line[len(row.controller) :].split()]
            for line in map(str.strip, text.splitlines())
        ]
    assert ("…" in text) is terminal


NAME = "a\nb\x1b[31m|<b>`*=1\udcff"


@pytest.fixture
def hostile():
    """A board on which a controller's name and remark would break tables and terminals."""
    row = Row(NAME, "ours", {"score": 0.5}, remark=NAME)
    return [Table("acrobot", "uptime", ("score",), 0, (row,))]


def test_hostile_names_in_markdown_are_text(hostile):
    lines = TABLE_FORMATS["markdown"](hostile).splitlines()
    shown = "a b\\\\x1b\\[31m\\|&lt;b&gt;\\`\\*=1\\\\udcff"
    assert f"| **{shown}** | **ours** | **0.500** |" in lines
    assert lines[-1] == f"{shown}: {shown}"


def test_line_ends_in_csv_are_quoted_and_escape_sequences_written_out(hostile):
    (row,) = csv.DictReader(io.StringIO(TABLE_FORMATS["csv"](hostile)))
    assert row["controller"] == row["remark"] == "a\nb\\x1b[31m|<b>`*=1\\udcff"


def test_hostile_names_on_a_terminal_are_one_line(hostile, capsys):
    show_tables(hostile)
    text = capsys.readouterr().out
    assert "\x1b" not in text
    assert "a\\nb\\x1b[31m|<b>`*=1\\udcff: a\\nb" in text
