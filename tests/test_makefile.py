"""The Makefile: what it runs, and what it says where an installation fails. A fake Python makes environments."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

import swingup

ROOT = Path(swingup.__file__).parents[2]

pytestmark = [
    pytest.mark.skipif(not (ROOT / "Makefile").exists(), reason="the Makefile is only in a checkout"),
    pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed"),
]

PYTHON = """#!/bin/sh
[ "$1" = -c ] && exit 0
[ -z "$NO_VENV" ] || { mkdir -p "$3"; exit 1; }
mkdir -p "$3/bin"
printf '#!/bin/sh\\necho "pip: $*"\\nexit ${PIP_STATUS:-0}\\n' > "$3/bin/python"
printf '#!/bin/sh\\necho "swingup: $*"\\n' > "$3/bin/swingup"
chmod +x "$3/bin/python" "$3/bin/swingup"
"""
"""Makes an environment whose pip succeeds or fails as asked."""


@pytest.fixture
def make(tmp_path):
    """Runs make in a folder of its own; the environment's variables are arguments."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / "python").write_text(PYTHON)
    (tmp_path / "python").chmod(0o755)

    def run(*words, **variables):
        # Neither a make around this one nor its variables count, as in make VENV=.venv313 test.
        outer = "MAKE", "VENV", "PYTHON"
        kept = {name: value for name, value in os.environ.items() if not name.startswith(outer)}
        python = [] if any(word.startswith("PYTHON=") for word in words) else ["PYTHON=./python"]
        command = ["make", *python, *words]
        return subprocess.run(
            command, cwd=tmp_path, env=kept | variables, capture_output=True, text=True, check=False
        )

    return run


def test_make_installs_once_and_shows_a_training(make):
    first = make()
    assert first.returncode == 0, first.stderr
    assert "pip: -m pip install" in first.stdout
    assert first.stdout.splitlines()[-1] == "swingup: demo acrobot"
    # A variable of the shell is not one of make's.
    second = make("FRAMES=1000", ROBOT="ur5")
    assert second.stdout == "swingup: demo acrobot --frames 1000\n"
    assert make("ROBOT=pendubot").stdout == "swingup: demo pendubot\n"
    assert make("leaderboard").stdout.splitlines()[-1] == "swingup: leaderboard"


def test_a_failed_installation_says_what_to_do_and_is_not_ready(make, tmp_path):
    for _ in range(2):  # the second one starts again: what the first one left is no foreign environment
        failed = make(PIP_STATUS="1")
        assert failed.returncode == 2
        told, end = failed.stderr.splitlines()
        assert told.startswith("make: '.venv/bin/python -m pip install ")
        for remedy in ("HTTPS_PROXY=", "PIP_INDEX_URL=", "PIP_FIND_LINKS=", "make PYTHON="):
            assert remedy in told
        assert end.startswith("make: *** ")
        assert "swingup:" not in failed.stdout
        assert not (tmp_path / ".venv" / ".ready").exists()
    assert make().returncode == 0


def test_without_venv_or_python_the_remedy_is_another_python(make):
    failed = make(NO_VENV="1")
    assert failed.returncode == 2
    assert failed.stderr.startswith(
        "make: './python -m venv .venv' failed: install venv (Debian: python3-venv), or"
    )
    absent = make("PYTHON=python0.1")
    assert absent.returncode == 2
    assert absent.stderr.startswith("make: there is no python0.1: make PYTHON=python3.")
    assert make().returncode == 0


def test_a_foreign_environment_stays(make, tmp_path):
    (tmp_path / ".venv").mkdir()
    failed = make()
    assert failed.returncode == 2
    assert ".venv is there and was not made by this Makefile" in failed.stderr
    assert make("clean").returncode == 2
    assert list((tmp_path / ".venv").iterdir()) == []
