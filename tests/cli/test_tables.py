import pytest

from swingup.benchmark.columns import COLUMNS
from swingup.benchmark.leaderboard import Board, published_rows
from swingup.cli.tables import show
from swingup.physics.parameters import ROBOTS


@pytest.mark.parametrize("measure", ["performance", "robustness"])
@pytest.mark.parametrize("terminal", [True, False], ids=["narrow terminal", "pipe"])
def test_a_narrow_console_cuts_headings_and_no_number(measure, terminal, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setenv("TTY_COMPATIBLE", str(int(terminal)))
    monkeypatch.setenv("NO_COLOR", "1")
    board = Board("acrobot", measure, "v2", None, tuple(published_rows(ROBOTS["acrobot"], measure, "v2")))
    show([board])
    text = capsys.readouterr().out
    for row in board.rows:
        numbers = [COLUMNS[name].show(row.values[name]) for name in board.columns]
        assert [row.controller, row.source, *numbers] in [
            [line[: len(row.controller)], *line[len(row.controller) :].split()]
            for line in map(str.strip, text.splitlines())
        ]
    assert ("…" in text) is terminal
