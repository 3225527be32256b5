"""The wheel: everything that the package needs is inside, and it works where there is no checkout."""

import os
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
import json, sys
import swingup
from swingup.export.realaigym import export_realaigym
from swingup.runtime import load_controller

controller = swingup.get_controller("ar-eapo", "acrobot")
result = swingup.evaluate(controller, "acrobot")
table = swingup.evaluate(swingup.baseline("tvlqr-score", "acrobot"), "acrobot")
torque = load_controller("ar-eapo", "pendubot")([0.1, 0.0, 0.0, 0.0], 0.0)
print(json.dumps([swingup.__file__, result.criteria.score, table.criteria.score, torque.tolist()]))
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Built by ``python -m build --wheel`` in an environment of its own, from a copy of nothing but the sources."""
    pytest.importorskip("build")
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(ROOT)],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    (path,) = folder.glob("*.whl")
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
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", target, wheel],
        check=True, capture_output=True,
    )  # fmt: skip
    # Dependencies come from this environment; its own swingup, which may be the checkout, does not.
    code = f"import sys; sys.path.insert(0, {str(target)!r})\n{OUTSIDE}"
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=kept, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    import json

    home, learned, baseline, torque = json.loads(result.stdout)
    assert Path(home).is_relative_to(target)
    assert learned == pytest.approx(0.708, abs=0.005)
    assert baseline == pytest.approx(0.710, abs=0.005)
    assert len(torque) == 2
