"""Swing-ups in RealAIGym's CSV format: exact round trips, gains that act as they should, and what is refused."""

import numpy as np
import pytest

import swingup
from refusals import refusal
from swingup.benchmark.trajectory_file import load_trajectory
from swingup.controllers.baselines.baselines import shipped_reference
from swingup.controllers.baselines.tracking import RiccatiController
from swingup.controllers.swingups.trajectory_csv import load_reference_csv, save_reference_csv


def test_round_trip(tmp_path, robot):
    reference = shipped_reference(robot)[0]
    save_reference_csv(tmp_path / "r.csv", reference)
    read = load_reference_csv(tmp_path / "r.csv", robot)
    assert read.dt == pytest.approx(reference.dt, rel=1e-12)
    for name in ("states", "torque", "gains"):
        np.testing.assert_array_equal(getattr(read, name), getattr(reference, name))
    # The judge reads the same file as a run.
    swingup.score(load_trajectory(tmp_path / "r.csv"), robot)


def test_gains_act_as_realaigyms_controller_has_them(tmp_path, robot, x64):
    """u = tau - K (x_des - x), by the columns of the file alone."""
    reference = shipped_reference(robot)[0]
    save_reference_csv(tmp_path / "r.csv", reference)
    with (tmp_path / "r.csv").open() as file:
        names = file.readline().strip().split(",")
    table = dict(zip(names, np.loadtxt(tmp_path / "r.csv", delimiter=",", skiprows=1).T, strict=True))
    controller = RiccatiController(reference.dt, reference.states, reference.torque, reference.gains, 6.0, robot)
    for row in (0, 100, 400):
        x = reference.states[row] + np.array([0.01, -0.02, 0.1, 0.2])
        desired = np.array([table[name][row] for name in ("pos1", "pos2", "vel1", "vel2")])
        expected = [
            table[f"tau{joint}"][row] - np.array([table[f"K{joint}{k}"][row] for k in (1, 2, 3, 4)]) @ (desired - x)
            for joint in (1, 2)
        ]
        np.testing.assert_allclose(controller(None, row * reference.dt, x)[1], expected, rtol=1e-9, atol=1e-12)


REFUSED = {
    "times are not evenly spaced from 0 on": ["0,1,2,3,4,0,1", "0.1,1,2,3,4,0,1", "0.3,1,2,3,4,0,1"],
    "torque on the passive joint 1: it is not for": ["0,1,2,3,4,1,0", "0.1,1,2,3,4,0,1", "0.2,1,2,3,4,0,1"],
    "has 1 complete rows: at least 3": ["0,1,2,3,4,0,1"],
}


@pytest.mark.parametrize("named", REFUSED)
def test_what_is_refused(tmp_path, named):
    (tmp_path / "r.csv").write_text("\n".join(["time, pos1, pos2, vel1, vel2, tau1, tau2", *REFUSED[named]]))
    assert named in refusal(load_reference_csv, tmp_path / "r.csv", "acrobot")


def test_without_gains_and_by_other_names(tmp_path):
    path = tmp_path / "r.csv"
    head = "time,pos_des1,pos_des2,vel_des1,vel_des2,tau_des1,tau_des2,K11,K12"
    path.write_text("\n".join([head, *(f"{0.1 * k},1,2,3,{k},5,0,7,8" for k in range(4))]))
    read = load_reference_csv(path, "pendubot")
    np.testing.assert_array_equal(read.states[:, 3], range(4))
    np.testing.assert_array_equal(read.torque, 5)
    assert not read.gains.any()
