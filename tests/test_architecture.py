"""The layers of the package: who may import whom, and what `import swingup` must not bring along."""

import ast
import functools
import itertools
import re
import subprocess
import sys
from pathlib import Path

import swingup

ROOT = Path(swingup.__file__).parent
LAYERS = {
    "plant": [{"common"}, {"plant"}, {"dynamics", "drawing"}],
    "policy": [{"policy"}, {"export"}, {"runtime"}],
    "loop": [{"loop"}, {"tasks", "continuing"}, {"gym", "gymnax"}],
    "control": [{"identification"}, {"areapo"}, {"controllers"}],
    "judge": [{"benchmark"}, {"rehearsal"}],
    "learn": [{"learner"}, {"refine"}],
    "tools": [{"report", "sweep"}, {"cli"}],
}
"""Every folder and module at the top of the package, from the lowest layer to the highest."""

ORDER = {name: place for place, beside in enumerate(itertools.chain(*LAYERS.values())) for name in beside}
"""Imports go to a lower place or stay at home."""

ONE_PLACE = {
    "optax": {"areapo", "refine"}, "gymnasium": {"gym", "continuing", "learner"}, "PIL": {"drawing", "report"},
    "matplotlib": {"report"}, "onnx": {"export"}, "jinja2": {"report"}, "tensorboardX": {"learner"},
    "scipy": {"controllers", "benchmark", "identification"}, "tyro": {"cli"}, "rich": {"cli", "learner"},
    "IPython": {"learner"}, "yaml": {"common"},
    "distributed": {"sweep"}, "optuna": {"sweep"}, "mujoco": {"plant"},
}  # fmt: skip
"""Third-party packages that only these parts may import."""


FILES = [path for path in sorted(ROOT.rglob("*.py")) if path.parent != ROOT or not path.stem.startswith("__")]


@functools.cache
def trees():
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in FILES}


def imports(path):
    """Absolute names of the modules that a file imports."""
    package = ["swingup", *path.relative_to(ROOT).parent.parts]
    for node in ast.walk(trees()[path]):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            name = ".".join([*base, *([node.module] if node.module else [])])
            yield from (f"{name}.{alias.name}" for alias in node.names)


def home_of(path):
    return path.relative_to(ROOT).with_suffix("").parts[0]


def is_allowed(path, name):
    home, (first, *rest) = home_of(path), name.split(".")
    if first != "swingup":
        return home in ONE_PLACE.get(first, {home})
    if home == "controllers" and rest[0] == "areapo":  # controllers know the learner's networks in one place
        return "stack" in path.parts
    return rest[0] == home or ORDER[rest[0]] < ORDER[home]


def test_imports_go_down():
    assert {home_of(path) for path in FILES} == set(ORDER)
    wrong = [(str(path), name) for path in FILES for name in imports(path) if not is_allowed(path, name)]
    assert wrong == []


def test_the_page_draws_the_layers():
    page = (Path(__file__).parents[1] / "docs/architecture.md").read_text(encoding="utf-8")
    drawn = [line.split("  ") for line in page.split("```")[1].strip("\n").splitlines()]
    drawn = {layer: {name.strip() for name in names if name.strip() in ORDER} for layer, *names in drawn}
    assert list(drawn.items())[::-1] == [(layer, set().union(*parts)) for layer, parts in LAYERS.items()]


def test_no_two_folders_import_from_one_another():
    """Not within a layer either: ``controllers/baselines`` and ``controllers/swingups``, for example.

    A file that lies beside folders counts as a folder of its own: ``controllers/interface.py`` is below
    ``controllers/baselines``, and ``controllers/registry.py`` above it.
    """
    parents = {path.parent.parent for path in FILES}
    modules = {"swingup." + ".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in FILES}

    def folder(path):
        return path if path.parent in parents else path.parent

    pairs = {
        (folder(path), folder(modules[module]))
        for path in FILES
        for name in imports(path)
        for module in (name, name.rpartition(".")[0])
        if module in modules and modules[module].parent != path.parent
    }
    assert len(pairs) > 50
    assert {pair for pair in pairs if pair[::-1] in pairs} == set()


def test_a_plant_and_its_base_parameters_are_named_once():
    plant, base, found = {"m1", "m2", "l1", "l2", "r1", "r2"}, {"A", "B", "m2r2", "k", "cf1", "Ir"}, []
    for path, tree in trees().items():
        for node in ast.walk(tree):
            fields = node.body if isinstance(node, ast.ClassDef) else []
            if plant <= {each.target.id for each in fields if isinstance(each, ast.AnnAssign)}:
                found.append(f"{path.relative_to(ROOT)}: {node.name}")
            entries = node.elts if isinstance(node, ast.Tuple) else []
            if base <= {each.value for each in entries if isinstance(each, ast.Constant)}:
                found.append(f"{path.relative_to(ROOT)}: base parameters")
    assert found == ["plant/base_parameters.py: base parameters", "plant/plant.py: Plant"]


def test_what_is_simulated_is_answered_in_one_place():
    """Functions that make a plant or a domain of a name or a file: the resolver and the reader of plants' files."""
    found = {
        f"{path.relative_to(ROOT)}: {node.name}"
        for path, tree in trees().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
        and node.returns is not None and {"Plant", "Domain"} & set(re.findall(r"\w+", ast.unparse(node.returns)))
        and any(re.search("PlantLike|Options", ast.unparse(each.annotation or each)) for each in node.args.args)
    }  # fmt: skip
    commands = {f"cli/arguments.py: {name}" for name in ("plant_of", "facts_of")}  # as resolve reads options
    assert found == {"loop/resolve.py: resolve", "plant/files.py: load_plant", *commands}


ONLY_NUMPY = """
import importlib, sys
class Only:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in {*sys.stdlib_module_names, "numpy", "swingup"}:
            raise ModuleNotFoundError(f"{name} is not there", name=name)
sys.meta_path.insert(0, Only())
import numpy as np
import swingup
for name in sys.argv[1:]:
    importlib.import_module(name)
from swingup.policy.shipped import SHIPPED_POLICIES, load_policy
from swingup.export.c_header import c_header
from swingup.export.javascript import policy_data
from swingup.runtime import load_controller
for name in SHIPPED_POLICIES:
    policy = load_policy(name, "acrobot")
    assert c_header(policy) and policy_data(policy)
controller = swingup.RealAIGymController(load_controller("adaptive", "acrobot"))
print(controller.get_control_output(np.zeros(4), 0.0).dtype)
"""
"""Everything else is blocked."""


def test_the_package_and_its_policies_need_numpy_alone():
    """What is light, the base of the policies and all back ends but JAX's can be imported, act and write."""
    paths = [path for path in FILES if home_of(path) in ("policy", "export") and path.stem != "__init__"]
    names = [".".join(path.relative_to(ROOT.parent).with_suffix("").parts) for path in paths]
    command = [sys.executable, "-c", ONLY_NUMPY, "swingup.runtime", *names]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (result.stdout, result.stderr) == ("float64\n", "")


def test_the_public_names_exist():
    assert all(getattr(swingup, name) for name in swingup.__all__)
    assert not hasattr(swingup, "nothing")
