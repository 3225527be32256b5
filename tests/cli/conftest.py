"""Fixtures of the commands' tests."""

import signal

import pytest


@pytest.fixture
def surroundings(tmp_path, monkeypatch):
    """An empty working folder; signal handlers as they were; no compilation cache outside of the test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in handlers.items():
        signal.signal(number, handler)
