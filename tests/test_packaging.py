"""Version, pins, wheel and source distribution, which agree, hold all of the package and work; and the Makefile."""

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

import swingup

ROOT = Path(swingup.__file__).parents[2]
PACKAGE = ROOT / "src" / "swingup"

pytestmark = pytest.mark.skipif(not (ROOT / "pyproject.toml").exists(), reason="only a checkout can be built")


def test_one_version_and_pins_that_the_package_allows():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert project["version"] == citation["version"] == swingup.__version__

    def requirements(texts):
        for requirement in map(Requirement, texts):
            if requirement.name == project["name"]:
                for extra in requirement.extras:
                    yield from requirements(project["optional-dependencies"][extra])
            else:
                yield requirement

    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = dict(line.split("==") for line in lines if not line.startswith("#"))
    pins = {re.sub(r"[-_.]+", "-", name).lower(): version.strip() for name, version in pins.items()}
    asked = [*requirements(project["dependencies"]), *requirements(project["optional-dependencies"]["dev"])]
    assert len(asked) > 25
    for requirement in asked:
        pin = pins[re.sub(r"[-_.]+", "-", requirement.name).lower()]
        assert requirement.specifier.contains(pin), f"{requirement} against {pin}"


OUTSIDE = """
import json

import swingup
from swingup.cli import main
from swingup.runtime import load_controller

assert main("export adaptive --robot acrobot --to realaigym --out entry".split()) == 0
assert main("export adaptive --robot acrobot --to c --out policy.h".split()) == 0
scores = [
    swingup.judge(controller, "acrobot").criteria.score
    for controller in (swingup.get_controller("ar-eapo", "acrobot"), swingup.baseline("tvlqr-score", "acrobot"))
]
torque = load_controller("adaptive", "pendubot")([0.1, 0.0, 0.0, 0.0], 0.0)
print(json.dumps([swingup.__file__, scores, torque.tolist()]))
"""


def run(*command, **options):
    """What a command prints; its errors, if it fails."""
    result = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, **options)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def distributions(tmp_path_factory):
    """Wheel and source distribution, built from a copy, so that an older build in the checkout plays no part."""
    pytest.importorskip("build")
    folder = tmp_path_factory.mktemp("built")
    for name in ("pyproject.toml", "MANIFEST.in", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    for name in ("src", "tests"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
    run(sys.executable, "-m", "build", folder)
    (wheel,), (source,) = ((folder / "dist").glob(pattern) for pattern in ("*.whl", "*.tar.gz"))
    return wheel, source


def ours():
    files = (path for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return {path.relative_to(PACKAGE.parent).as_posix() for path in files}


@pytest.mark.slow
def test_both_hold_every_file_of_the_package_and_nothing_else(distributions):
    inside = {name for name in zipfile.ZipFile(distributions[0]).namelist() if ".dist-info/" not in name}
    assert inside == ours()
    with tarfile.open(distributions[1]) as archive:
        names = {file.name.partition("/")[2] for file in archive if file.isfile()}
    inside = {name for name in names if ".egg-info/" not in name}
    built_by = {"LICENSE", "MANIFEST.in", "PKG-INFO", "README.md", "pyproject.toml", "setup.cfg"}
    assert inside == built_by | {f"src/{name}" for name in ours()}


@pytest.mark.slow
def test_the_wheel_works_without_the_checkout(distributions, tmp_path):
    target = tmp_path / "site"
    options = ["--quiet", "--no-deps", "--no-index", "--target", target]
    run(sys.executable, "-m", "pip", "install", *options, distributions[0])
    # The dependencies come from this environment; its own swingup, which may be the checkout's, comes later.
    code = f"import sys; sys.path.insert(0, {str(target)!r})\n{OUTSIDE}"
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    printed = run(sys.executable, "-c", code, cwd=tmp_path, env=kept | {"XDG_CACHE_HOME": str(tmp_path / "cache")})
    home, scores, torque = json.loads(printed.splitlines()[-1])
    assert Path(home).is_relative_to(target)
    assert scores == pytest.approx([0.638, 0.710], abs=0.005)
    assert len(torque) == 2
    assert all((tmp_path / name).exists() for name in ("entry/con_swingup.py", "policy.h"))


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
    """Runs make in a folder of its own, where a fake Python makes environments; variables are arguments."""
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    shutil.copy(ROOT / "Makefile", tmp_path)
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / "python").write_text(PYTHON)
    (tmp_path / "python").chmod(0o755)

    def run(*words, **variables):
        # Neither a make around this one nor its variables count, as in make VENV=.venv313 test.
        outer = "MAKE", "VENV", "PYTHON"
        kept = {name: value for name, value in os.environ.items() if not name.startswith(outer)}
        command, streams = ["make", "PYTHON=./python", *words], {"capture_output": True, "text": True}
        return subprocess.run(command, cwd=tmp_path, env=kept | variables, check=False, **streams)

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
