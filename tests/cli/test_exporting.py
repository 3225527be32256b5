"""The commands export and plant: what they write runs where it is meant to, and bad input leaves nothing."""

import ast
import subprocess
import sys

import numpy as np
import pytest

import swingup
from policies import lone_policy
from swingup.cli import main
from swingup.controllers.baselines.baselines import shipped_reference
from swingup.controllers.registry import get_controller
from swingup.controllers.stack.controller import save_controller
from swingup.controllers.swingups.reference import load_reference
from swingup.controllers.swingups.trajectory_csv import load_reference_csv
from swingup.plant.plant import load_plant
from swingup.policy.shipped import load_policy

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

assert not [name for name in sys.modules if name.partition(".")[0] in ("jax", "equinox", "swingup", "yaml")]
print(leaderboard_config)
controller.reset()
controller.init()
np.save({rows!r}, [controller.get_control_output(x=row[1:], t=row[0]) for row in np.load({rows!r})])
"""
"""The torques of an entry, of which NumPy alone may be there, at the times and states of a file."""


@pytest.mark.slow
def test_a_folder_for_realaigym_needs_numpy_alone(tmp_path, robot, capsys):
    folder, rows = tmp_path / "entry", str(tmp_path / "rows.npy")
    assert main(["export", "ar-eapo", "--robot", robot.name, "--to", "realaigym", "--out", str(folder)]) == 0
    assert capsys.readouterr().out.strip() == str(folder / "con_swingup.py")
    judged = swingup.judge(get_controller("ar-eapo", robot), robot).trajectory
    np.save(rows, np.column_stack([judged.time, judged.x]))
    code = RUN.format(folder=str(folder), rows=rows)
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stderr) == (0, "")
    np.testing.assert_allclose(np.load(rows), judged.u, atol=1e-4)
    config = ast.literal_eval(result.stdout)
    assert set(config) == {"csv_path", "name", "simple_name", "short_description", "readme_path", "username"}
    assert (config["csv_path"], config["simple_name"]) == ("swingup/sim_swingup.csv", "swingup AR-EAPO")
    assert len(config["short_description"]) <= 100
    assert "," not in config["short_description"]
    assert (folder / config["readme_path"]).read_text().startswith(f"# swingup, {robot.name}")


def test_a_policy_file_and_the_entrys_names(run, tmp_path):
    source = tmp_path / "mine.safetensors"
    save_controller(source, *lone_policy("ar-eapo", "pendubot"))
    run("export mine.safetensors --to realaigym --out e --username Ada --name twin_2")
    copied, own = (load_policy(tmp_path / file) for file in ("e/twin_2_controller/policy.safetensors", source))
    np.testing.assert_array_equal(copied.network.head.weight, own.network.head.weight)
    assert copied.metadata["frames"] == own.metadata["frames"]
    assert (tmp_path / "e/readmes/twin_2.md").exists()
    entry = (tmp_path / "e/con_twin_2.py").read_text()
    for line in ('"username": "Ada"', 'name = "twin_2"', "from twin_2_controller.export.", 'robot = "pendubot"'):
        assert line in entry


def test_a_folder_for_cloudpendulum(run, tmp_path):
    told = run("export adaptive --robot acrobot --to cloudpendulum --out cell").splitlines()
    assert told[0].endswith("cell/controller_swingup.py")
    assert told[2].startswith("it may command 6 N m at the elbow, and CloudPendulum's motors give 0.15: train one")
    entry = (tmp_path / "cell/controller_swingup.py").read_text()
    assert '"velocity_limit": 50.0' in entry
    assert "def ControllerType(" in entry
    readme = (tmp_path / "cell/README.md").read_text()
    assert readme.startswith("# swingup for CloudPendulum, acrobot")
    assert "@" not in readme


def test_graphs_and_headers(run, tmp_path):
    pytest.importorskip("onnx", reason="onnx is not installed")
    for form, start in (("onnx", b"\x08"), ("c", b"/*")):
        told = run(f"export --robot acrobot --to {form} --out {form}")
        assert (tmp_path / form).read_bytes().startswith(start)
        assert ("without estimator, identifier, regulator and a safety guard" in told) == (form == "onnx")


def test_the_guard_of_an_export(run, tmp_path):
    """On by default and in the entry, for its owner to change; left out for simulations."""
    base = "export ar-eapo --robot acrobot --to"
    run(f"{base} realaigym --out guarded --velocity-limit 25 --braking 0.1")
    run(f"{base} realaigym --out bare --no-guard")
    guarded, bare = ((tmp_path / name / "con_swingup.py").read_text() for name in ("guarded", "bare"))
    assert '"velocity_limit": 25.0,' in guarded
    assert '"braking": 0.1,' in guarded
    assert "guard = False" in bare
    for flag, has in ("", 1), ("--no-guard", 0):
        run(f"{base} c --out policy.h {flag}")
        assert f"#define SWINGUP_HAS_GUARD {has}" in (tmp_path / "policy.h").read_text()


def test_a_plant_is_shown_and_written_in_each_format(run, run_json):
    out = run("plant C.1 --set l2=0.31 tl1=0 --set m1=0.6 --out mine.yml mine.urdf mine.xml")
    assert "length (m) l1, l2 0.2 0.31" in " ".join(out.split())
    assert "wrote mine.xml: use it with --plant mine.xml" in out
    plant = load_plant("C.1").changed(l2=0.31, tl1=0.0, m1=0.6)
    for ending in ("yml", "urdf", "xml"):
        found = run_json("plant", f"mine.{ending}")
        assert {name: found[name] for name in plant.values()} == plant.values()
    assert any("l2 = 0.31 m is the distance of frame 'tip'" in note for note in found["notes"])
    # 6 N m over (0.6 · 0.2 + 0.6256 (0.2 + 0.2557)) 9.81 N m.
    assert "plant mine.urdf, torque/gravity 1.51" in run("evaluate acrobot --controller lqr --plant mine.urdf")


def test_a_shipped_swing_up_is_written_at_once(run):
    expected = shipped_reference("pendubot", "score")[0].torque
    for file in ("a.csv", "a.safetensors"):
        run(f"export tvlqr-score --robot pendubot --to trajectory --out {file}")
    np.testing.assert_array_equal(load_reference_csv("a.csv", "pendubot").torque, expected)
    np.testing.assert_array_equal(load_reference("a.safetensors")[0].torque, expected)
