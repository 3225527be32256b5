"""The layers of the package: who may import whom, and what `import swingup` must not bring along."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import swingup

ROOT = Path(swingup.__file__).parent
LAYERS = {
    "text": -1, "errors": 0, "version": 0, "types": 0, "settings": 2, "fetch": 0, "other_names": 0, "foreign": 1,
    "checks": 1, "files": 1, "robots": 2, "arrays": 2, "table": 2, "yaml_map": 2, "physics": 3, "plants": 4,
    "policy": 4,
    "policy.numpy_backend": 5, "policy.c_backend": 5, "policy.onnx_backend": 5, "policy.javascript_backend": 5,
    "policy.jax_backend.observation": 5,
    "policy.realaigym": 6, "policy.cloudpendulum": 6, "runtime": 6, "tasks": 6,
    "areapo": 7, "control": 7, "policy.jax_backend": 8,
    "control.registry": 9, "benchmark": 10, "drawing": 10, "identification": 10,
    "learner": 11, "gym": 11, "gymnax": 11, "refine": 11, "realaigym": 11,
    "report": 12, "rehearsal": 12, "sweep": 12, "cli": 13,
}  # fmt: skip
"""Every part of the package and its layer: imports go to a lower layer or stay at home. A part is a module or a
package at the top; where a name with dots is given, that part of it stands by itself."""

ONE_PLACE = {
    "optax": {"areapo", "refine"},
    "gymnasium": {"gym", "learner"},
    "PIL": {"drawing", "report"},
    "matplotlib": {"report"},
    "bokeh": {"report"},
    "onnx": {"policy.onnx_backend"},
    "jinja2": {"report"},
    "scipy": {"control", "benchmark", "identification"},
    "tyro": {"cli"},
    "rich": {"cli"},
    "tensorboardX": {"learner"},
    "yaml": {"yaml_map"},
    "distributed": {"sweep"},
    "optuna": {"sweep"},
}
"""Third-party packages that only these parts may import."""


def imports(path):
    """Absolute names of the modules that a file imports."""
    package = ["swingup", *path.relative_to(ROOT).parent.parts]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            name = ".".join([*base, *([node.module] if node.module else [])])
            yield from (f"{name}.{alias.name}" for alias in node.names)


def part(words):
    """The longest name in LAYERS that a module's name, without the package's, begins with."""
    names = [".".join(words[:length]) for length in range(len(words), 0, -1)]
    return next((name for name in names if name in LAYERS), words[0])


def home_of(path):
    return part(path.relative_to(ROOT).with_suffix("").parts)


FILES = [path for path in sorted(ROOT.rglob("*.py")) if path.parent != ROOT or not path.stem.startswith("__")]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_go_down(path):
    home = home_of(path)
    for name in imports(path):
        words = name.split(".")
        if words[0] == "swingup":
            target = part(words[1:])
            assert target == home or LAYERS[target] < LAYERS[home], f"{home} imports {name}"
        assert home in ONE_PLACE.get(words[0], {home}), f"{home} imports {name}"


def test_every_part_has_a_layer():
    assert {home_of(path) for path in FILES} == set(LAYERS)


def test_controllers_know_nothing_of_the_learner():
    for path in (ROOT / "control").glob("*.py"):
        assert not any("areapo" in name for name in imports(path))


def test_import_is_light():
    heavy = ("jax", "equinox", "gymnasium", "matplotlib", "PIL")
    code = f"import sys, swingup; print([name for name in {heavy} if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


ONLY_NUMPY = """
import sys
class Only:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in {*sys.stdlib_module_names, "numpy", "swingup"}:
            raise ModuleNotFoundError(f"{name} is not there", name=name)
sys.meta_path.insert(0, Only())
import numpy as np
"""
"""Everything else is blocked."""


def test_policies_need_numpy_alone():
    """The room's base and all back ends but JAX's can be imported, and write what they write, by NumPy alone."""
    folder = ROOT / "policy"
    paths = [path for path in folder.rglob("*.py") if "jax_backend" not in path.parts and path.stem != "__init__"]
    names = [".".join(path.relative_to(ROOT.parent).with_suffix("").parts) for path in sorted(paths)]
    assert {f"swingup.policy.{name}" for name in ("file", "settings", "shipped", "realaigym")} < set(names)
    code = f"""{ONLY_NUMPY}
import importlib, logging
logging.getLogger("swingup").setLevel("ERROR")  # a name that changed its meaning says so
for name in {names}:
    importlib.import_module(name)
from swingup.policy.shipped import SHIPPED_POLICIES, load_policy
from swingup.policy.c_backend.header import c_header
from swingup.policy.javascript_backend.page import policy_data
for robot in ("acrobot", "pendubot"):
    for name in SHIPPED_POLICIES:
        policy = load_policy(name, robot)
        assert c_header(policy) and policy_data(policy)
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.parametrize("name", ["", ".runtime", ".realaigym"])
def test_numpy_is_enough(name):
    code = f"""{ONLY_NUMPY}
import swingup{name}
from swingup.realaigym import load_controller
print(load_controller("adaptive", "acrobot").get_control_output(np.zeros(4), 0.0).dtype)
try:
    load_controller("tvlqr", "acrobot")
except swingup.SwingupError as error:
    print(error)
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.stderr == ""
    dtype, refusal = result.stdout.splitlines()
    assert dtype == "float64"
    assert refusal.startswith("controller 'tvlqr' needs equinox: install swingup with its dependencies")


def test_the_public_names_exist():
    for name in swingup.__all__:
        assert getattr(swingup, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = swingup.nothing
