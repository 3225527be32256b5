"""Rehearsals of exported folders: the judge's scores, real time, and what a guard did."""

import dataclasses
import json
import time

import numpy as np
import pytest

import swingup
from swingup.benchmark.boards import PERFORMANCE
from swingup.cli import main
from swingup.export.cloudpendulum import CloudPendulumController
from swingup.export.folder import cloudpendulum_guard, cloudpendulum_notes, export_folder
from swingup.plant.plant import LEADERBOARD, load_plant
from swingup.policy.guard.settings import GuardSettings
from swingup.policy.numpy_backend.controller import numpy_controller
from swingup.policy.plant_facts import policy_plant
from swingup.policy.shipped import load_policy
from swingup.rehearsal.loop import FolderController, PacedController
from swingup.rehearsal.process import Reply
from swingup.rehearsal.rehearse import rehearse
from swingup.runtime import load_controller

BRIEF = dataclasses.replace(PERFORMANCE, duration=1.5)


def export(folder, form, guard=None, name="ar-eapo"):
    """A shipped policy of the acrobot as a folder."""
    policy = dataclasses.replace(load_policy(name, "acrobot"), guard=guard)
    return export_folder(policy, folder, form).parent


@pytest.fixture(scope="module")
def judged():
    return swingup.judge(load_controller("ar-eapo", "acrobot"), "acrobot", BRIEF)


@pytest.mark.parametrize("form", ["realaigym", "cloudpendulum"])
def test_a_folder_scores_as_its_policy_does_in_the_judge(form, judged, tmp_path):
    """The second form moves alike at the start: it differs in how it is called."""
    whole = form == "realaigym"
    rules = BRIEF if whole else dataclasses.replace(BRIEF, duration=0.4)
    found = rehearse(export(tmp_path / "entry", form), LEADERBOARD, "none", board=rules)
    result = found.result
    assert (result.successes, len(result.runs)) == (int(whole), 1)
    assert (found.folder.form, result.robot, found.facts["packages"]) == (form, "acrobot", ["numpy"])
    assert result.criteria.score == pytest.approx(judged.criteria.score if whole else 0.0, abs=1e-9)
    np.testing.assert_allclose(result.trajectory.x, judged.trajectory.x[: rules.steps], atol=1e-9)
    assert len(found.calls) == rules.steps
    assert found.difference is None


def test_a_guard_that_stops_the_folder_is_reported(tmp_path):
    folder = export(tmp_path / "entry", "realaigym", GuardSettings(velocity_limit=2.0))
    found = rehearse(folder, LEADERBOARD, "none", board=BRIEF, duration=0.6)
    stopped, rows, tip = found.stops[0], found.result.trajectory, found.result.tip
    assert "velocity is beyond the limit" in stopped["why"]
    # The loop is perfect: the guard sees the very state that passes its limit.
    assert tip.failure == f"swinging up, the elbow passes 2 rad/s at t = {stopped['time']:.3f} s"
    assert (tip.cause, found.limits[1], found.result.successes) == ("beyond a limit", 2.0, 0)
    after = rows.u[np.asarray(rows.time) >= stopped["time"]]
    assert len(after) > 10
    assert not np.any(after)


@pytest.mark.slow
def test_the_command_in_real_time(tmp_path, capsys):
    folder, rows = export(tmp_path / "entry", "realaigym"), tmp_path / "run.csv"
    begin = time.monotonic()
    options = ["--plant", "A.0", "--duration", "0.1", "--real-time", "--json", "--save", str(rows)]
    assert main(["rehearse", str(folder), *options]) == 0
    # 50 periods of 2 ms.
    assert time.monotonic() - begin > 0.098
    told = json.loads(capsys.readouterr().out)
    assert (told["runs"], told["stops"], told["details"][0]["cause"]) == (1, [None], "never up")
    assert told["periods"]["p50"] >= 0.002
    assert told["calls"]["longest"] >= told["calls"]["p99"] >= told["calls"]["p50"] > 0
    assert told["missed"] >= 0
    assert told["difference"].startswith("the policy was made for a plant 'leaderboard' with ")
    assert told["domain"]["name"] == "A.0 in the loop of recorded"
    assert len(rows.read_text().splitlines()) == 51


class Slow:
    """Stands in for a process whose second answer takes two and a half periods."""

    def __init__(self):
        self.calls, self.waits = [], []

    def send(self, t, x):
        self.calls.append(t)
        self.left = 2 if len(self.calls) == 2 else 0

    def receive(self, wait):
        self.waits.append(wait)
        if self.left:
            self.left -= 1
            return None
        return Reply(np.array([0.0, self.calls[-1]]), 1e-4)


def test_torques_are_held_while_a_slow_answer_is_awaited():
    process, dt = Slow(), 0.004
    controller = FolderController(process)
    paced = PacedController(controller, process, dt)
    torques = [paced.get_control_output(np.zeros(4), step * dt)[1] for step in range(6)]
    # The call at step 1 is answered in step 3: steps 1 and 2 keep step 0's torque, and are not called again.
    assert process.calls == [0.0, dt, 4 * dt, 5 * dt]
    assert torques == [0.0, 0.0, 0.0, dt, 4 * dt, 5 * dt]
    assert controller.timing.missed == 2
    periods = controller.timing.periods
    assert min(periods) >= 0.999 * dt
    assert periods[1] >= 2.999 * dt
    assert max(process.waits) <= dt


class Motor:
    def __init__(self, position, velocity):
        self.position, self.velocity = position, velocity


def test_cloudpendulums_client_gives_no_time_and_gets_a_list():
    times = iter([100.0, 100.002, 100.004, 7.0, 7.002])
    inside, plain = (load_controller("ar-eapo", "acrobot", guard=True) for _ in range(2))
    cloud = CloudPendulumController(inside, lambda: next(times))
    states = [[0.1, -0.2, 0.5, 0.3], [0.101, -0.199, 0.5, 0.3], [0.102, -0.198, 0.5, 0.3]]

    def ask(x):
        u = cloud.get_control_output([Motor(x[0], x[2]), Motor(x[1], x[3])])
        assert [type(each) for each in u] == [float, float]
        return u

    first = [ask(x) for x in states]
    expected = [plain(x, 0.002 * step).tolist() for step, x in enumerate(states)]
    np.testing.assert_allclose(first, expected, atol=1e-9)
    # Another run, by a clock of another origin.
    cloud.reset()
    np.testing.assert_allclose([ask(x) for x in states[:2]], first[:2], atol=1e-9)
    assert (cloud.fault, cloud.robot.name) == (None, "acrobot")


def test_the_cells_limits():
    policy = load_policy("adaptive", "acrobot")
    assert [note[:36] for note in cloudpendulum_notes(policy)] == [
        "it may command 0.5 N m at the should",
        "it may command 6 N m at the elbow, a",
    ]
    cell = policy_plant(load_plant("cloudpendulum"), policy.robot)
    cell = dataclasses.replace(cell, cf1=0.16, cf2=0.12)
    identifier = dataclasses.replace(policy.identifier, passive_limit=0.005)
    fits = dataclasses.replace(policy, plant=cell, torque_limit=0.05, identifier=identifier)
    assert cloudpendulum_notes(fits) == []
    controller = numpy_controller(fits, guard=cloudpendulum_guard(fits.period))
    assert controller.guard.settings.velocity_limit == 50.0
    # The compensation of C.1's friction exceeds what the cell's plant allows.
    torques = [controller(np.array([1.0, 1.0 + 0.08 * step, 40.0, 40.0]), 0.002 * step) for step in range(5)]
    assert np.abs(torques).max(axis=0) == pytest.approx([0.005, 0.13])
