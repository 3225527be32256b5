"""The commands export and plant: what they write runs where it is meant to, and bad input leaves nothing."""

import dataclasses
import os
import runpy
from pathlib import Path

import numpy as np
import pytest

from policies import lone_policy
from policy.references import task_policy
from swingup import load_plant, load_policy
from swingup.cli import main
from swingup.controllers.baselines.baselines import Design, shipped_reference
from swingup.controllers.stack.policy import save_controller
from swingup.controllers.swingups.reference import load_reference
from swingup.policy.file import write_network
from swingup.rehearsal.process import find_folder


@pytest.mark.parametrize(
    ("source", "message"),
    [("folder", "such as folder/best.safetensors"), ("mine:Controller", "a controller of your own")],
)
def test_what_is_no_policy_is_named(source, message, tmp_path, capsys):
    (tmp_path / "folder").mkdir()
    assert main(["export", source, "--robot", "acrobot", "--to", "c", "--out", "policy.h"]) == 2
    assert message in capsys.readouterr().err


def test_a_folder_does_not_hide_a_shipped_policy_and_a_law_is_exported_again(run):
    Path("adaptive").mkdir()
    run("export adaptive --robot acrobot --to c --out adaptive.h")
    run("export lqr --robot acrobot --plant C.1 --to realaigym --out entry --name held")
    law = str(find_folder("entry").policy)
    run("export", law, "--to", "c", "--out", "law.h")
    assert "swingup_control" in Path("law.h").read_text()
    assert main(["export", law, "--to", "onnx", "--out", "law.onnx"]) == 2
    assert not Path("law.onnx").exists()


def test_zeros_that_are_given_are_subtracted(run):
    run("export adaptive --robot pendubot --zero1 0.04 --zero2=-0.03 --to c --out policy.h")
    assert "swingup_zeros[2] = {4.e-02, -3.e-02}" in Path("policy.h").read_text()


def test_the_folder_that_one_stands_in_stays(run):
    Path("entry").mkdir()
    os.chdir("entry")
    run("export adaptive --robot pendubot --to realaigym --out .")
    assert sorted(os.listdir()) == ["con_swingup.py", "readmes", "swingup_controller"]


def test_a_policy_file_and_the_entrys_names(run, tmp_path):
    source = tmp_path / "mine.safetensors"
    save_controller(source, *lone_policy("ar-eapo", "pendubot"))
    told = run("export mine.safetensors --to realaigym --out e --username Ada --name twin_2")
    assert told.endswith("e/con_twin_2.py\n")
    copied, own = (load_policy(tmp_path / file) for file in ("e/twin_2_controller/policy.safetensors", source))
    np.testing.assert_array_equal(copied.network.head.weight, own.network.head.weight)
    assert copied.metadata["frames"] == own.metadata["frames"]
    assert (tmp_path / "e/readmes/twin_2.md").read_text().startswith("# swingup, pendubot")
    entry = runpy.run_path("e/con_twin_2.py")
    config = entry["leaderboard_config"]
    assert config.keys() == {"csv_path", "name", "simple_name", "short_description", "readme_path", "username"}
    values = ("twin_2", "swingup AR-EAPO", "twin_2/sim_swingup.csv", "readmes/twin_2.md", "Ada")
    names = ("name", "simple_name", "csv_path", "readme_path", "username")
    assert tuple(config[name] for name in names) == values
    assert len(config["short_description"]) <= 100
    assert "," not in config["short_description"]
    assert entry["robot"] == "pendubot"


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
        assert {name: found[name] for name in plant.values()} == pytest.approx(plant.values(), rel=1e-12)
    assert any("l2 = 0.31 m is the distance of frame 'tip'" in note for note in found["notes"])
    # 6 N m over (0.6 · 0.2 + 0.6256 (0.2 + 0.2557)) 9.81 N m.
    assert "plant mine.urdf, torque/gravity 1.51" in run("evaluate acrobot --controller lqr --plant mine.urdf")


def test_a_shipped_swing_up_is_written_at_once(run):
    expected = shipped_reference("pendubot", "score")[0].torque
    for file in ("a.csv", "a.safetensors"):
        run(f"export tvlqr-score --robot pendubot --to trajectory --out {file}")
    np.testing.assert_array_equal(np.genfromtxt("a.csv", delimiter=",", names=True)["tau1"], expected)
    np.testing.assert_array_equal(load_reference("a.safetensors")[0].torque, expected)


def test_a_swing_up_that_does_not_come_up_is_not_written(run, monkeypatch, tmp_path, capsys):
    hanging = shipped_reference("acrobot")[0]
    hanging = dataclasses.replace(hanging, states=0.0 * hanging.states)
    monkeypatch.setattr(Design, "compute", lambda self, problem, seed: (hanging, {}))
    words = "export tvlqr --robot acrobot --to trajectory --seed 3 --out up.csv"
    assert main(words.split()) == 2
    assert "no swing-up of the acrobot was found with seed 3" in capsys.readouterr().err
    assert not (tmp_path / "up.csv").exists()


def test_a_folder_for_cloudpendulum(run, tmp_path):
    told = run("export adaptive --robot acrobot --to cloudpendulum --out cell").splitlines()
    assert told[0].endswith("cell/controller_swingup.py")
    assert told[2].startswith("it may command 6 N m at the elbow")
    assert '"velocity_limit": 50.0' in (tmp_path / "cell/controller_swingup.py").read_text()
    readme = (tmp_path / "cell/README.md").read_text()
    assert readme.startswith("# swingup for CloudPendulum, acrobot")
    assert "@" not in readme


def test_graphs_and_headers(run, tmp_path):
    pytest.importorskip("onnx", reason="onnx is not installed")
    for form, start in (("onnx", b"\x08"), ("c", b"/*")):
        told = run(f"export --robot acrobot --to {form} --out {form}")
        assert (tmp_path / form).read_bytes().startswith(start)
        assert ("without estimator, identifier, regulator and a safety guard" in told) == (form == "onnx")


def test_a_policy_of_another_task(run, tmp_path, capsys):
    """A folder and headers; what belongs to pendulums is refused, and nothing is left."""
    own = task_policy("discrete")
    write_network("best.safetensors", own.network, own.metadata)
    assert run("export best.safetensors --to numpy --out folder").endswith("folder/policy_swingup.py\n")
    action, _ = runpy.run_path("folder/policy_swingup.py")["policy"].predict(np.zeros(4))
    assert action == own.predict(np.zeros(4))[0]
    for precision, number in ("double", "double"), ("single", "float"):
        run(f"export best.safetensors --to c --precision {precision} --out policy.h")
        assert f"{number} observation[4];" in (tmp_path / "policy.h").read_text()
    for words, named in (
        ("realaigym --out other", "form realaigym is not for 'discrete': use numpy"),
        ("onnx --out other --precision single", "--precision single goes with --to c"),
        ("c --out other --braking 0.1", "--braking is of pendulums, and best.safetensors of 'discrete'"),
        ("c --out other --no-guard", "--no-guard is of pendulums"),
        ("c --out other --robot acrobot", "is of 'discrete', not of a pendulum"),
        ("c --out other --estimator", "--estimator goes with a baseline's controller: leave it out"),
    ):
        assert main(f"export best.safetensors --to {words}".split()) == 2
        assert named in capsys.readouterr().err
        assert not (tmp_path / "other").exists()
