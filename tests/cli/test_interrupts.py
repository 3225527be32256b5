"""Ctrl-C ends every command within seconds, also where KeyboardInterrupt is lost or a compiled program runs."""

import signal
import subprocess
import sys
import time

import pytest

LOSES_IT = """
import signal, time
from swingup import cli
cli.GRACE = 0.2
signal.signal(signal.SIGINT, lambda *_: None)
cli._end_soon_after_interrupts()
print("ready", flush=True)
while True:
    time.sleep(1.0)
"""
COMMANDS = {
    "refine acrobot --out x.safetensors": (5.0, 20.0, 40.0),
    "refine acrobot --recipe adapt --policy global --out x.safetensors": (10.0, 60.0, 120.0),
    "evaluate acrobot --board robustness --seeds 9 --controller tvlqr": (3.0, 8.0),
    "train acrobot --out r --frames 100000000": (5.0, 60.0),
    "sweep acrobot --seeds 2 --workers 1 --out s": (5.0, 30.0),
}
"""Commands, and when Ctrl-C comes (s)."""


def pressed(process):
    """The exit status after Ctrl-C."""
    with process:
        process.send_signal(signal.SIGINT)
        try:
            return process.wait(timeout=60)  # on a busy machine; on an idle one it takes 5 s at most
        finally:
            process.kill()


def start(words, tmp_path, **streams):
    return subprocess.Popen([sys.executable, *words], cwd=tmp_path, **streams)


def test_an_interrupt_that_is_lost_ends_the_command(tmp_path):
    process = start(["-c", LOSES_IT], tmp_path, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout.readline() == "ready\n"
    assert pressed(process) == 130


@pytest.mark.slow
@pytest.mark.parametrize("words", COMMANDS)
def test_ctrl_c_ends_every_command(tmp_path, words):
    for number, moment in enumerate(COMMANDS[words]):
        folder = tmp_path / str(number)
        folder.mkdir()
        process = start(["-m", "swingup", *words.split()], folder, stderr=subprocess.DEVNULL)
        time.sleep(moment)
        assert process.poll() is None, f"{words} ended before {moment} s"
        assert pressed(process) == 130, f"{words} after {moment} s"
