"""The commands that write a plant and a baseline's swing-up."""

import numpy as np

from swingup.controllers.baselines.baselines import shipped_reference
from swingup.controllers.swingups.reference import load_reference
from swingup.controllers.swingups.trajectory_csv import load_reference_csv
from swingup.plant.plant import load_plant


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
    expected = shipped_reference("pendubot", "score")[0]
    for file, load in {
        "a.csv": lambda path: load_reference_csv(path, "pendubot"),
        "a.safetensors": load_reference,
    }.items():
        run(f"export tvlqr-score --robot pendubot --to trajectory --out {file}")
        found = load(file)
        np.testing.assert_array_equal((found if file == "a.csv" else found[0]).torque, expected.torque)
