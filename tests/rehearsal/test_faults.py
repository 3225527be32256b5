"""A folder that misbehaves ends a rehearsal in one line that says what it did."""

import numpy as np

from refusals import refusal
from swingup.cli import main
from swingup.rehearsal.folder import Folder, find_folder
from swingup.rehearsal.process import FolderProcess

LOADING_TIME, CALLING_TIME = 30.0, 5.0
"""For a busy machine (s); what must hang has less."""


def write_folder(folder, body="return [0.0, 0.5]", head="", name="con_fake.py", arguments="x, t"):
    """A folder whose controller's call has this body."""
    folder.mkdir(exist_ok=True)
    lines = ["import os, signal, sys, time", head, "class Controller:", '    robot = "acrobot"']
    lines += [f"    def get_control_output(self, {arguments}):", f"        {body}", "controller = Controller()"]
    (folder / name).write_text("\n".join(lines))
    return folder


def start(folder, **limits):
    return FolderProcess(find_folder(folder), simulated_clock=True, **({"loading": LOADING_TIME} | limits))


def call(folder, **limits):
    """The answer to one call at t = 1 s."""
    with start(folder, **({"calling": CALLING_TIME} | limits)) as process:
        process.send(1.0, np.arange(4.0))
        return process.receive()


CALLS = {
    "os._exit(3)": "its call at t = 1 s ended its process, with status 3",
    "os.kill(os.getpid(), signal.SIGKILL)": "its call at t = 1 s ended its process, by SIGKILL",
    "raise ValueError('no\\nluck')": "its call at t = 1 s raised ValueError (no luck)",
    "print('hello')": "it printed 'hello\\n' at t = 1 s",
    "return [1.0, 2.0, 3.0]": "it gave a torque at t = 1 s that is of shape (3,)",
}
IMPORTS = {
    "import nothing_of_that_name": "its import raised ModuleNotFoundError (No module named 'nothing_of_that",
    "os._exit(0)": "its import ended its process, with status 0",
}


def test_a_bad_call_or_import_is_one_line(tmp_path):
    cases = [({"body": body}, message) for body, message in CALLS.items()]
    cases += [({"head": head}, message) for head, message in IMPORTS.items()]
    for parts, message in cases:
        assert refusal(call, write_folder(tmp_path / "fake", **parts)).startswith(message)


def test_a_hang_ends_at_the_time_limit(tmp_path):
    folder = write_folder(tmp_path / "fake", "time.sleep(60)")
    assert "its call at t = 1 s did not end within 0.05 s" in refusal(call, folder, calling=0.05)
    folder = write_folder(tmp_path / "fake", head="time.sleep(60)")
    assert "its import did not end within 0.05 s" in refusal(call, folder, loading=0.05)


def test_a_good_folder_answers_by_numpy_alone_and_prints_where_nothing_waits(tmp_path, capfd):
    folder = write_folder(tmp_path / "fake", "return [x[0], x[3] + t]", head="print('imported')")
    with start(folder) as process:
        process.send(1.0, np.arange(4.0))
        reply = process.receive()
        assert reply.u.tolist() == [0.0, 4.0]
        assert reply.seconds < CALLING_TIME
        assert process.facts["robot"] == "acrobot"
        assert process.facts["packages"] == ["numpy"]
        assert (process.facts["guard"], process.stop()) == (False, None)
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
    assert find_folder(second / "controller_x.py").form == "cloudpendulum"
    for path, named in ((second, "holds 2 controllers"), (tmp_path, "holds no controller"), ("none", "none")):
        assert named in refusal(find_folder, path)


def test_the_command_says_it_in_one_line(tmp_path, capfd):
    on_c1 = ["--plant", "C.1", "--domain", "none"]
    for body, options, message in (
        ("return [0.0, float('nan')]", on_c1, "it gave a torque that is not finite at t = 0 s"),
        ("return 0", ["--robot", "pendubot"], "con_fake.py is for the acrobot, not the pendubot"),
        ("return 0", ["--duration", "0"], "duration = 0.0"),
        ("return 0", ["--timeout", "-1"], "timeout = -1.0"),
        ("return 0", ["--save", "none/x.csv"], "cannot write none/x.csv"),
    ):
        assert main(["rehearse", str(write_folder(tmp_path / "fake", body)), *options]) == 2
        error = capfd.readouterr().err
        assert message in error
        assert error.count("\n") == 1
