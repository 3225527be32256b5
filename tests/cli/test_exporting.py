"""The command export: what it writes runs where it is meant to, and bad input leaves nothing."""

import ast
import subprocess
import sys

import numpy as np
import pytest

import swingup
from policies import lone_policy
from swingup.benchmark.rollout import Trajectory
from swingup.cli import main
from swingup.controllers.registry import get_controller
from swingup.controllers.stack.controller import save_controller

RUN = """
import sys

class Only:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in {{*sys.stdlib_module_names, "numpy", "swingup_controller", "con_swingup"}}:
            raise ModuleNotFoundError(f"{{name}} is not there", name=name)

sys.meta_path.insert(0, Only())
sys.path.insert(0, {folder!r})
import numpy as np
from con_swingup import controller, leaderboard_config
from swingup_controller.plant.equations import acceleration, lump
from swingup_controller.plant.plant import LEADERBOARD

assert not [name for name in sys.modules if name.partition(".")[0] in ("jax", "equinox", "swingup", "yaml")]
print(leaderboard_config)
plant, dt, limit = lump(LEADERBOARD), 0.002, 6.0 * np.array({driven})

def rates(x, u):
    sines = np.sin(x[0]), np.sin(x[1]), np.sin(x[0] + x[1])
    return np.array([*x[2:], *acceleration(plant, sines, np.cos(x[1]), x[2:], u)])

x, rows = np.zeros(4), []
controller.reset()
controller.init()
for step in range(5000):
    u = controller.get_control_output(x=x, t=step * dt)
    rows.append([step * dt, *x, *u])
    u = np.clip(u, -limit, limit)
    k1 = rates(x, u)
    k2 = rates(x + dt / 2 * k1, u)
    k3 = rates(x + dt / 2 * k2, u)
    x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + rates(x + dt * k3, u))
np.save({rows!r}, rows)
"""


@pytest.mark.slow
def test_a_folder_for_realaigym_needs_numpy_alone(tmp_path, robot, capsys):
    folder, rows = tmp_path / "entry", str(tmp_path / "rows.npy")
    assert main(["export", "ar-eapo", "--robot", robot.name, "--to", "realaigym", "--out", str(folder)]) == 0
    assert capsys.readouterr().out.strip() == str(folder / "con_swingup.py")
    code = RUN.format(folder=str(folder), rows=rows, driven=list(robot.actuation))
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stderr) == (0, "")
    table = np.load(rows)
    trajectory = Trajectory(time=table[:, 0], x=table[:, 1:5], u=table[:, 5:])
    judged = swingup.judge(get_controller("ar-eapo", robot), robot).criteria
    assert swingup.score(trajectory, robot).score == pytest.approx(judged.score, abs=1e-4)

    config = ast.literal_eval(result.stdout)
    assert set(config) == {"csv_path", "name", "simple_name", "short_description", "readme_path", "username"}
    assert config["csv_path"] == "swingup/sim_swingup.csv"
    assert config["simple_name"] == "swingup AR-EAPO"
    assert len(config["short_description"]) <= 100
    assert "," not in config["short_description"]
    assert (folder / config["readme_path"]).read_text().startswith(f"# swingup, {robot.name}")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["entry", "rows.npy"]


def test_an_entry_names_the_kind_of_its_policy(tmp_path):
    folder = tmp_path / "entry"
    assert main(["export", "adaptive", "--robot", "acrobot", "--to", "realaigym", "--out", str(folder)]) == 0
    entry = (folder / "con_swingup.py").read_text()
    assert '"simple_name": "swingup distilled"' in entry
    assert '"One network distilled from teachers' in entry


def test_a_policy_file_and_its_username(tmp_path):
    source = tmp_path / "mine.safetensors"
    save_controller(source, *lone_policy("ar-eapo", "pendubot"))
    options = ["--to", "realaigym", "--out", str(tmp_path / "e"), "--username", "Ada", "--name", "twin_2"]
    assert main(["export", str(source), *options]) == 0
    assert (tmp_path / "e/twin_2_controller/policy.safetensors").read_bytes() == source.read_bytes()
    assert (tmp_path / "e/readmes/twin_2.md").exists()
    entry = (tmp_path / "e/con_twin_2.py").read_text()
    assert '"username": "Ada"' in entry
    assert 'name = "twin_2"' in entry
    assert "from twin_2_controller.export.realaigym" in entry
    assert 'robot = "pendubot"' in entry


def test_a_folder_for_cloudpendulum(tmp_path, capsys):
    folder = tmp_path / "cell"
    assert main(["export", "adaptive", "--robot", "acrobot", "--to", "cloudpendulum", "--out", str(folder)]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0] == str(folder / "controller_swingup.py")
    assert told[2].startswith("it may command 6 N m at the elbow, and CloudPendulum's motors give 0.15: train one")
    entry = (folder / "controller_swingup.py").read_text()
    assert '"velocity_limit": 50.0' in entry
    assert "def ControllerType(" in entry
    readme = (folder / "README.md").read_text()
    assert readme.startswith("# swingup for CloudPendulum, acrobot")
    assert "@" not in readme
    assert sorted(path.name for path in folder.iterdir()) == [
        "README.md",
        "controller_swingup.py",
        "swingup_controller",
    ]


def test_graphs_and_headers(tmp_path, capsys):
    pytest.importorskip("onnx", reason="onnx is not installed")
    for form, start in (("onnx", b"\x08"), ("c", b"/*")):
        out = tmp_path / form
        assert main(["export", "--robot", "acrobot", "--to", form, "--out", str(out)]) == 0
        assert out.read_bytes().startswith(start)
        said = "alone, without estimator, identifier, regulator and a safety guard"
        assert (said in capsys.readouterr().out) == (form == "onnx")


def test_the_guard_of_an_export(tmp_path):
    """On by default and in the entry, for its owner to change; left out for simulations."""
    base = ["export", "ar-eapo", "--robot", "acrobot", "--to"]
    assert main([*base, "realaigym", "--out", "guarded", "--velocity-limit", "25", "--braking", "0.1"]) == 0
    assert main([*base, "realaigym", "--out", "bare", "--no-guard"]) == 0
    entries = [(tmp_path / name / "con_swingup.py").read_text() for name in ("guarded", "bare")]
    assert '"velocity_limit": 25.0,' in entries[0]
    assert '"braking": 0.1,' in entries[0]
    assert "guard = False" in entries[1]
    assert main([*base, "c", "--out", "guarded.h"]) == 0
    assert main([*base, "c", "--out", "bare.h", "--no-guard"]) == 0
    assert "#define SWINGUP_HAS_GUARD 1" in (tmp_path / "guarded.h").read_text()
    assert "#define SWINGUP_HAS_GUARD 0" in (tmp_path / "bare.h").read_text()


FAULTY = """
import sys
sys.path.insert(0, {folder!r})
import numpy as np
from con_swingup import controller

print(controller.get_control_output(x=[0.1, 0.0, 0.0, 0.0], t=0.0), controller.fault)
print(controller.get_control_output(x=[0.1, np.nan, 0.0, 0.0], t=0.002), controller.fault)
print(controller.get_control_output(x=[0.1, 0.0, 0.0, 0.0], t=0.004))
"""


def test_an_exported_folder_stops_at_a_fault(tmp_path):
    folder = tmp_path / "entry"
    assert main(["export", "ar-eapo", "--robot", "acrobot", "--to", "realaigym", "--out", str(folder)]) == 0
    code = FAULTY.format(folder=str(folder))
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    first, second, third = result.stdout.splitlines()
    assert first.endswith("None")
    said = "[0. 0.] a measured angle or velocity is not a finite number (elbow, nan, at t = 0.002 s)"
    assert (second, third) == (said, "[0. 0.]")
