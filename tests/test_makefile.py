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
        command = ["make", "PYTHON=./python", *words]
        return subprocess.run(
            command, cwd=tmp_path, env=kept | variables, capture_output=True, text=True, check=False
        )

    return run


def test_make_installs_once_and_shows_a_training(make):
    assert make().stdout.splitlines()[-1] == "swingup: demo acrobot"
    # A variable of the shell is not one of make's.
    assert make("FRAMES=1000", ROBOT="ur5").stdout == "swingup: demo acrobot --frames 1000\n"


def test_what_fails_says_what_to_do_and_a_foreign_environment_stays(make, tmp_path):
    for variables, remedy in ({"PIP_STATUS": "1"}, "PIP_INDEX_URL="), ({"NO_VENV": "1"}, "python3-venv"):
        failed = make(**variables)
        assert failed.returncode == 2
        assert remedy in failed.stderr
        assert "swingup:" not in failed.stdout
    shutil.rmtree(tmp_path / ".venv")
    (tmp_path / ".venv").mkdir()
    assert ".venv is there and was not made by this Makefile" in make().stderr
    assert make("clean").returncode == 2
    assert list((tmp_path / ".venv").iterdir()) == []
