"""A folder that misbehaves ends a rehearsal in one line that says what it did."""

import numpy as np
import pytest

from swingup.cli import main
from swingup.common.errors import SwingupError
from swingup.rehearsal.folder import Folder, find_folder
from swingup.rehearsal.process import FolderProcess

LOADING, CALLING = 30.0, 5.0
"""For a busy machine (s); what must hang has less."""


def write_folder(folder, body="return [0.0, 0.5]", head="", name="con_fake.py", arguments="x, t"):
    """A folder whose controller's call has this body."""
    folder.mkdir(exist_ok=True)
    lines = ["import os, signal, sys, time", head, "class Controller:", '    robot = "acrobot"']
    lines += [f"    def get_control_output(self, {arguments}):", f"        {body}", "controller = Controller()"]
    (folder / name).write_text("\n".join(lines))
    return folder


def start(folder, **limits):
    return FolderProcess(find_folder(folder), simulated_clock=True, **({"loading": LOADING} | limits))


def call(folder, **limits):
    """The answer to one call at t = 1 s."""
    with start(folder, **({"calling": CALLING} | limits)) as process:
        process.send(1.0, np.arange(4.0))
        return process.receive()


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("os._exit(3)", "its call at t = 1 s ended its process, with status 3: correct it there"),
        (
            "os.kill(os.getpid(), signal.SIGKILL)",
            "its call at t = 1 s ended its process, by SIGKILL: correct it there",
        ),
        ("raise ValueError('no\\nluck')", "its call at t = 1 s raised ValueError (no luck): correct it there"),
        ("sys.exit(4)", "its call at t = 1 s raised SystemExit (4): correct it there"),
        ("print('hello')", "it printed 'hello\\n' at t = 1 s: a loop must not wait for that: correct it there"),
        (
            "return [1.0, 2.0, 3.0]",
            "it gave a torque at t = 1 s that is of shape (3,): two real numbers [u1, u2] are",
        ),
        ("return None", "it gave a torque at t = 1 s that is None: two real numbers [u1, u2] are needed"),
    ],
)
def test_a_bad_call_is_one_line(body, message, tmp_path):
    with pytest.raises(SwingupError) as caught:
        call(write_folder(tmp_path / "fake", body))
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    ("head", "message"),
    [
        ("import nothing_of_that_name", "its import raised ModuleNotFoundError (No module named 'nothing_of_that"),
        ("sys.exit()", "its import raised SystemExit"),
        ("os._exit(0)", "its import ended its process, with status 0"),
    ],
)
def test_a_bad_import_is_one_line(head, message, tmp_path):
    with pytest.raises(SwingupError) as caught:
        call(write_folder(tmp_path / "fake", head=head))
    assert str(caught.value).startswith(message)


def test_a_hang_ends_at_the_time_limit(tmp_path):
    folder = write_folder(tmp_path / "fake", "time.sleep(60)")
    with pytest.raises(SwingupError, match=r"t = 1 s did not end within 0\.05 s: it hangs, or is far too slow"):
        call(folder, calling=0.05)
    folder = write_folder(tmp_path / "fake", head="time.sleep(60)")
    with pytest.raises(SwingupError, match=r"its import did not end within 0\.05 s"):
        call(folder, loading=0.05)


def test_a_good_folder_answers_by_numpy_alone_and_prints_where_nothing_waits(tmp_path, capfd):
    folder = write_folder(tmp_path / "fake", "return [x[0], x[3] + t]", head="print('imported')")
    with start(folder) as process:
        process.send(1.0, np.arange(4.0))
        reply = process.receive()
        assert reply.u.tolist() == [0.0, 4.0]
        assert (reply.seconds < CALLING, reply.stopped) == (True, False)
        assert process.facts["robot"] == "acrobot"
        assert process.facts["packages"] == ["numpy"]
        assert process.guard_report() == {"guard": False, "stopped": None}
    assert process._process.returncode is not None
    assert capfd.readouterr() == ("", "imported\n")
    assert [path.name for path in folder.iterdir()] == ["con_fake.py"]  # no compiled copies


def test_an_answer_that_is_not_there_yet(tmp_path):
    with start(write_folder(tmp_path / "fake", "time.sleep(0.1); return (0, t)")) as process:
        process.send(2.0, np.zeros(4))
        assert process.receive(0.001) is None
        assert process.receive().u.tolist() == [0.0, 2.0]


def test_folders_are_recognised_by_their_files(tmp_path):
    first = write_folder(tmp_path / "a").resolve()
    assert find_folder(first) == find_folder(first / "con_fake.py") == Folder(first / "con_fake.py", "realaigym")
    second = write_folder(tmp_path / "b", name="controller_x.py").resolve()
    assert find_folder(second) == Folder(second / "controller_x.py", "cloudpendulum")
    write_folder(tmp_path / "b", name="con_x.py")
    with pytest.raises(
        SwingupError, match=r"holds 2 controllers: name a file in it, con_x\.py or controller_x\.py"
    ):
        find_folder(second)
    assert find_folder(second / "controller_x.py").form == "cloudpendulum"
    with pytest.raises(SwingupError, match="holds no controller: a folder of swingup export has con_"):
        find_folder(tmp_path)
    with pytest.raises(SwingupError, match="no such folder: none; swingup export"):
        find_folder("none")


@pytest.mark.parametrize(
    ("body", "options", "message"),
    [
        ("return [0.0, float('nan')]", (), "it gave a torque that is not finite at t = 0 s: correct it there"),
        ("raise ValueError('no luck')", (), "its call at t = 0 s raised ValueError (no luck): correct it there"),
        ("return 0", ("--robot", "pendubot"), "con_fake.py is for the acrobot, not the pendubot"),
        ("return 0", ("--duration", "0"), "duration = 0.0: use a positive number up to 600 s"),
        ("return 0", ("--timeout", "-1"), "timeout = -1.0: use a positive number"),
        ("return 0", ("--plant", "C.2"), "unknown plant 'C.2'"),
        ("return 0", ("--save", "none/x.csv"), "cannot write none/x.csv"),
    ],
)
def test_the_command_says_it_in_one_line(body, options, message, tmp_path, capfd):
    folder = write_folder(tmp_path / "fake", body)
    assert main(["rehearse", str(folder), *(options or ("--plant", "C.1", "--domain", "none"))]) == 2
    error = capfd.readouterr().err
    assert message in error
    assert error.count("\n") == 1
