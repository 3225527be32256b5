"""A policy's run with one thing wrong, and what its log says."""

import json

import numpy as np
import pytest

from swingup.benchmark.diagnosis import diagnose
from swingup.benchmark.rollout import Scenario
from swingup.benchmark.runner import run_one
from swingup.cli import main
from swingup.controllers.baselines.baselines import feedback_policy
from swingup.controllers.interface import PythonController
from swingup.export.folder import export_folder
from swingup.plant.files import load_plant
from swingup.policy.feedback import policy_controller
from swingup.policy.numpy_backend import load_controller
from swingup.rehearsal.process import find_folder

SIGN = np.array([1.0, -1.0, 1.0, -1.0])  # the elbow's encoder counts the other way


def record(path, sign, seconds=2.0):
    """The log of `adaptive` on the acrobot of design C.1 in a loop without flaws."""
    controller, rows = load_controller("adaptive", "acrobot"), []

    def act(x, t):
        u = controller(sign * x, t)
        rows.append([t, *(sign * x), *u])
        return u

    run_one(PythonController(act), Scenario(load_plant("C.1"), substeps=2), 0.002, int(seconds / 0.002))
    head = "time,pos_meas1,pos_meas2,vel_meas1,vel_meas2,tau_con1,tau_con2"
    # The first calls try the controller.
    np.savetxt(path, rows[-int(seconds / 0.002) :], delimiter=",", header=head, comments="")
    return path


@pytest.fixture(scope="module")
def reversed_encoder(tmp_path_factory):
    return record(tmp_path_factory.mktemp("log") / "run.csv", SIGN)


def test_a_reversed_encoder_is_named(reversed_encoder, capsys, tmp_path):
    page = tmp_path / "page.html"
    words = ["diagnose", str(reversed_encoder), "--plant", "C.1", "--quick", "--json", "--out", str(page)]
    assert main(words) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["named"] == "encoder 2 reversed"
    assert found["causes"][0]["sure"] == "certain"
    assert not any("torques are those" in note for note in found["notes"])
    assert "encoder 2 reversed" in page.read_text(encoding="utf-8")


@pytest.mark.slow
def test_simulations_fail_with_the_cause_alone(reversed_encoder):
    cause = diagnose(reversed_encoder, "adaptive", "C.1").causes[0]
    assert cause.confirmed


def test_a_run_of_another_policy_is_noted(reversed_encoder):
    found = diagnose(reversed_encoder, "global", "C.1", robot="acrobot", simulate=False)
    assert any("torques are those" in note for note in found.notes)


def test_a_feedback_law_is_diagnosed_as_a_policy_is(tmp_path, monkeypatch):
    """By its file and by its folder: the LQR's first torques are the log's. A name alone is designed anew."""
    monkeypatch.chdir(tmp_path)
    plant = load_plant("C.1").frictionless()
    law = feedback_policy("lqr", "acrobot", plant)
    export_folder(law, "entry", "realaigym", "held")
    found, rows = policy_controller(law), []

    def act(x, t):
        u = found(x, t)
        rows.append([t, *x, *u])
        return u

    start = np.array([np.pi + 0.02, 0.0, 0.0, 0.0])
    run_one(PythonController(act), Scenario(plant, substeps=2, start=start), 0.002, 1000)
    head = "time,pos_meas1,pos_meas2,vel_meas1,vel_meas2,tau_con1,tau_con2"
    np.savetxt("run.csv", rows[-1000:], delimiter=",", header=head, comments="")
    assert main(["diagnose", "run.csv", "--policy", "entry", "--quick", "--json"]) == 0
    assert diagnose("run.csv", find_folder("entry").policy, simulate=False).own
    assert main(["diagnose", "run.csv", "--policy", "lqr", "--robot", "acrobot"]) == 2
    # Such a law is for any rate: a run at 250 Hz that falls has other causes.
    rows.clear()
    run_one(PythonController(act), Scenario(plant, substeps=4, start=start + 0.6), 0.004, 500)
    np.savetxt("fall.csv", rows[-500:], delimiter=",", header=head, comments="")
    fallen = diagnose("fall.csv", find_folder("entry").policy, simulate=False)
    assert fallen.failure is not None
    assert "rate" not in [each.name for each in fallen.causes]
