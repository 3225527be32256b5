"""The wheel: everything that the package needs is inside, and it works where there is no checkout."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import swingup

ROOT = Path(swingup.__file__).parents[2]
PACKAGE = ROOT / "src" / "swingup"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (ROOT / "pyproject.toml").exists(), reason="only a checkout can be built"),
]

OUTSIDE = """
import json

import swingup
from swingup.cli import main
from swingup.runtime import load_controller

assert main("export ar-eapo --robot acrobot --to realaigym --out entry".split()) == 0
assert main("export ar-eapo --robot acrobot --to c --out policy.h".split()) == 0
scores = [
    swingup.evaluate(controller, "acrobot").criteria.score
    for controller in (swingup.get_controller("ar-eapo", "acrobot"), swingup.baseline("tvlqr-score", "acrobot"))
]
torque = load_controller("ar-eapo", "pendubot")([0.1, 0.0, 0.0, 0.0], 0.0)
print(json.dumps([swingup.__file__, scores, torque.tolist()]))
"""


def run(*command, **options):
    """What a command prints; its errors, if it fails."""
    result = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, **options)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Built from a copy of the sources, so that an older build in the checkout plays no part."""
    pytest.importorskip("build")
    folder = tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    shutil.copytree(ROOT / "src", folder / "src", ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
    run(sys.executable, "-m", "build", "--wheel", folder)
    (path,) = (folder / "dist").glob("*.whl")
    return path


def test_every_file_of_the_package_is_in_the_wheel(wheel):
    inside = {name for name in zipfile.ZipFile(wheel).namelist() if name.startswith("swingup/")}
    files = (path for path in PACKAGE.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    ours = {f"swingup/{path.relative_to(PACKAGE).as_posix()}" for path in files}
    assert inside == ours
    for ending in ("py.typed", ".npz", ".csv", ".yml", "export/assets/policy.h", "report/assets/page.html"):
        assert any(name.endswith(ending) for name in inside), ending


def test_the_wheel_works_without_the_checkout(wheel, tmp_path):
    target = tmp_path / "site"
    run(sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", target, wheel)
    # The dependencies come from this environment; its own swingup, which may be the checkout's, comes later.
    code = f"import sys; sys.path.insert(0, {str(target)!r})\n{OUTSIDE}"
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    kept["XDG_CACHE_HOME"] = str(tmp_path / "cache")
    printed = run(sys.executable, "-c", code, cwd=tmp_path, env=kept)
    home, scores, torque = json.loads(printed.splitlines()[-1])
    assert Path(home).is_relative_to(target)
    assert scores == pytest.approx([0.708, 0.710], abs=0.005)
    assert len(torque) == 2
    assert (tmp_path / "entry" / "con_swingup.py").exists()
    assert (tmp_path / "policy.h").exists()
