"""Fixtures of the commands' tests."""

import dataclasses
import json

import pytest

from swingup.benchmark.boards import BOARDS
from swingup.cli import main


@pytest.fixture(autouse=True)
def surroundings(tmp_path, monkeypatch, own_signals):
    """An empty working folder, from which modules can be imported."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.fixture
def run(capsys):
    """Runs a command and returns its standard output."""

    def run_command(words, *more, status=0):
        assert main([*words.split(), *more]) == status
        return capsys.readouterr().out

    return run_command


@pytest.fixture
def run_json(run):
    return lambda *words: json.loads(run(*words, "--json"))


@pytest.fixture
def change_boards(monkeypatch):
    def change(names, **fields):
        for name in names.split():
            monkeypatch.setitem(BOARDS, name, dataclasses.replace(BOARDS[name], **fields))

    return change


@pytest.fixture
def entrants(monkeypatch):
    """Names the built-in controllers that enter the leaderboards."""
    return lambda *names: monkeypatch.setattr("swingup.benchmark.leaderboard.default_entrants", lambda board: names)
