"""Rehearsals of exported folders: the judge's scores, real time, guards, and folders that misbehave."""

import dataclasses
import json
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import swingup
from refusals import refusal
from swingup import load_policy, rehearse
from swingup.benchmark.boards import PERFORMANCE
from swingup.cli import main
from swingup.export.cloudpendulum import CloudPendulumController
from swingup.export.folder import cloudpendulum_guard, cloudpendulum_notes, export_folder
from swingup.loop.resolve import resolve
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD
from swingup.policy.guard import GuardSettings
from swingup.policy.numpy_backend import numpy_controller
from swingup.policy.pendulum import policy_plant
from swingup.rehearsal.process import Folder, FolderController, FolderProcess, find_folder
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
    assert len(found.timing.calls) == rules.steps
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


def test_a_run_that_the_guard_stopped_is_lost_though_it_stays_up(tmp_path):
    """A folder that lies at the top and is stopped there: a guard whose clock is watched closely."""
    folder = export(tmp_path / "entry", "realaigym", GuardSettings(velocity_limit=2.0))
    easy = dataclasses.replace(BRIEF, height=-2.0, limits=None)  # everything is up
    found = rehearse(folder, LEADERBOARD, "none", board=easy, duration=0.6)
    [run] = found.result.runs
    assert (run.success, run.score, run.criteria.success) == (False, 0.0, False)
    assert found.stops[0]["time"] < 0.6


def test_a_fault_on_a_spoilt_sample_ends_the_rehearsal(tmp_path):
    body = "assert x[2] == x[2]; return [0.0, 0.5]"
    domain = resolve(domain={"plant": "C.1", "spoilt": 0.05})
    told = refusal(rehearse, write_folder(tmp_path / "fake", body), domain=domain, duration=0.4, seeds=1)
    assert "raised AssertionError" in told


def test_a_deadline_is_the_loops_own_period(tmp_path, monkeypatch):
    periods = []
    wait = FolderController._wait
    monkeypatch.setattr(FolderController, "_wait", lambda *given: periods.append(given[2]) or wait(*given))
    domain = resolve(domain={"plant": "C.1", "period": 0.005})
    rehearse(write_folder(tmp_path / "fake"), domain=domain, duration=0.1, real_time=True)
    assert periods == [pytest.approx(0.005)] * 20


@pytest.mark.slow
def test_the_command_in_real_time(tmp_path, capsys):
    folder, rows = export(tmp_path / "entry", "realaigym"), tmp_path / "run.csv"
    begin = time.monotonic()
    options = ["--plant", "A.0", "--duration", "0.1", "--real-time", "--json", "--save", str(rows)]
    assert main(["rehearse", str(folder), *options]) == 0
    # 50 periods of 2 ms.
    assert time.monotonic() - begin > 0.098
    told = json.loads(capsys.readouterr().out)
    assert (told["runs"], told["stops"], told["details"][0]["cause"]) == (1, [None], "no swing-up")
    assert told["periods"]["p50"] >= 0.002
    assert told["calls"]["maximum"] >= told["calls"]["p99"] >= told["calls"]["p50"] > 0 <= told["missed_deadlines"]
    assert "made for a plant 'leaderboard'" in told["difference"]
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
        return np.array([0.0, self.calls[-1]]), 1e-4


def test_torques_are_held_while_a_slow_answer_is_awaited():
    process, dt = Slow(), 0.004
    controller = FolderController(process, dt)
    torques = [controller.get_control_output(np.zeros(4), step * dt)[1] for step in range(6)]
    # The call at step 1 is answered in step 3: steps 1 and 2 keep step 0's torque, and are not called again.
    assert process.calls == [0.0, dt, 4 * dt, 5 * dt]
    assert torques == [0.0, 0.0, 0.0, dt, 4 * dt, 5 * dt]
    assert controller.timing.missed_deadlines == 2
    periods = controller.timing.periods
    assert min(periods) >= 0.999 * dt
    assert periods[1] >= 2.999 * dt
    assert max(process.waits) <= dt


def test_cloudpendulums_client_gives_no_time_and_gets_a_list():
    times = iter([100.0, 100.002, 7.0, 7.002])
    inside, plain = (load_controller("ar-eapo", "acrobot", guard=True) for _ in range(2))
    cloud = CloudPendulumController(inside, lambda: next(times))
    states = [[0.1, -0.2, 0.5, 0.3], [0.101, -0.199, 0.5, 0.3]]
    expected = [plain(x, 0.002 * step) for step, x in enumerate(states)]
    for _ in range(2):  # another run, by a clock of another origin
        for x, torques in zip(states, expected, strict=True):
            u = cloud.get_control_output([SimpleNamespace(position=x[i], velocity=x[2 + i]) for i in (0, 1)])
            assert [type(each) for each in u] == [float, float]
            assert u == pytest.approx(torques, abs=1e-9)
        cloud.reset()
    assert (cloud.fault, cloud.robot.name) == (None, "acrobot")


def test_the_cells_limits():
    policy = load_policy("adaptive", "acrobot")
    assert [note.split()[3] for note in cloudpendulum_notes(policy)] == ["0.5", "6"]  # N m
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


LOADING_TIME, CALLING_TIME = 30.0, 5.0
"""For a busy machine (s); what must hang has less."""


def write_folder(folder, body="return [0.0, 0.5]", head="", name="con_fake.py"):
    folder.mkdir(exist_ok=True)
    lines = ["import os, signal, sys, time", head, "class Controller:", '    robot = "acrobot"']
    lines += ["    def get_control_output(self, x, t):", f"        {body}", "controller = Controller()"]
    (folder / name).write_text("\n".join(lines))
    return folder


def start(folder, **limits):
    return FolderProcess(find_folder(folder), simulated_clock=True, **({"loading": LOADING_TIME} | limits))


def call(folder, **limits):
    """The answer to one call at t = 1 s."""
    with start(folder, **({"calling": CALLING_TIME} | limits)) as process:
        process.send(1.0, np.arange(4.0))
        return process.receive()


FAULTS = {
    "its call at t = 1 s ended its process, with status 3": {"body": "os._exit(3)"},
    "its call at t = 1 s ended its process, by SIGKILL": {"body": "os.kill(os.getpid(), signal.SIGKILL)"},
    "its call at t = 1 s raised ValueError (no luck)": {"body": "raise ValueError('no\\nluck')"},
    "it printed 'hello\\n' at t = 1 s": {"body": "print('hello')"},
    "it gave a torque at t = 1 s that is of shape (3,)": {"body": "return [1.0, 2.0, 3.0]"},
    "its import raised ModuleNotFoundError (No module named 'nothing_such'": {"head": "import nothing_such"},
    "its import ended its process, with status 0": {"head": "os._exit(0)"},
}


def test_what_a_foreign_controller_has_under_the_guards_names_is_no_fault(tmp_path):
    folder = write_folder(tmp_path / "fake", body="self.fault = self.guard = False; return [0.0, 0.5]")
    with start(folder) as process:
        process.send(1.0, np.arange(4.0))
        assert process.receive()[0].tolist() == [0.0, 0.5]
        assert process.stop() is None


def test_a_bad_call_or_import_is_one_line(tmp_path):
    for message, parts in FAULTS.items():
        assert refusal(call, write_folder(tmp_path / "fake", **parts)).startswith(message)


def test_a_run_may_end_before_its_last_answer(tmp_path):
    head = "import subprocess; child = subprocess.Popen(['sleep', '60'])"
    body = "time.sleep(0.1); return [0.0, float(child.pid)]"
    with start(write_folder(tmp_path / "fake", body, head), calling=CALLING_TIME) as process:
        process.send(0.0, np.zeros(4))
        pid = int(process.receive()[0][1])
        process.send(0.1, np.zeros(4))
        assert process.receive(0.0) is None
        assert process.stop() is None
    # What the folder started ends with it, perhaps as a zombie that nobody has waited for.
    status, end = Path(f"/proc/{pid}/stat"), time.monotonic() + 20.0
    while (lives := status.exists() and status.read_text().split()[2] != "Z") and time.monotonic() < end:
        time.sleep(0.05)
    assert not lives


def test_a_hang_ends_at_the_time_limit_and_a_late_answer_comes(tmp_path):
    folder = write_folder(tmp_path / "fake", "time.sleep(60)")
    assert "its call at t = 1 s did not end within 0.05 s" in refusal(call, folder, calling=0.05)
    folder = write_folder(tmp_path / "fake", head="time.sleep(60)")
    assert "its import did not end within 0.05 s" in refusal(call, folder, loading=0.05)
    with start(write_folder(tmp_path / "fake", "time.sleep(0.1); return (0, t)")) as process:
        process.send(2.0, np.zeros(4))
        assert process.receive(0.001) is None
        assert process.receive()[0].tolist() == [0.0, 2.0]


def test_a_good_folder_answers_by_numpy_alone_and_prints_where_nothing_waits(tmp_path, capfd):
    folder = write_folder(tmp_path / "fake", "return [x[0], x[3] + t]", head="print('imported')")
    with start(folder) as process:
        process.send(1.0, np.arange(4.0))
        u, seconds = process.receive()
        assert u.tolist() == [0.0, 4.0]
        assert seconds < CALLING_TIME
        assert process.facts["robot"] == "acrobot"
        assert process.facts["packages"] == ["numpy"]
        assert (process.facts["guard"], process.stop()) == (False, None)
    assert process._process.returncode is not None
    assert capfd.readouterr() == ("", "imported\n")
    assert [path.name for path in folder.iterdir()] == ["con_fake.py"]  # no compiled copies


def test_folders_are_recognised_by_their_files(tmp_path):
    first = write_folder(tmp_path / "a").resolve()
    assert find_folder(first) == find_folder(first / "con_fake.py") == Folder(first / "con_fake.py", "realaigym")
    second = write_folder(tmp_path / "b", name="controller_x.py").resolve()
    assert find_folder(second) == Folder(second / "controller_x.py", "cloudpendulum")
    write_folder(tmp_path / "b", name="con_x.py")
    assert find_folder(second / "controller_x.py").form == "cloudpendulum"
    for path, named in ((second, "holds 2 controllers"), (tmp_path, "holds no controller"), ("none", "none")):
        assert named in refusal(find_folder, path)
