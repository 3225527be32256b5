"""The other end of ``child.py``: an exported folder's controller in a process of its own, behind timeouts."""

import json
import math
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np

from ..common.errors import SwingupError, one_line
from .folder import Folder

LOADING_TIME = 60.0
"""Longest time in which a folder may be imported (s); a cold disk and a busy machine take seconds."""
CALLING_TIME = 2.0
"""Longest time of a call (s), after which it counts as hung."""


class FolderProcess(AbstractContextManager["FolderProcess"]):
    """A running folder. Use it in a ``with`` statement: the process ends with it."""

    def __init__(
        self, folder: Folder, simulated_clock: bool, loading: float = LOADING_TIME, calling: float = CALLING_TIME
    ) -> None:
        """Start the process and import the folder in it.

        Import and calls may take ``loading`` and ``calling`` (s). With a simulated clock a controller that measures
        the time itself is given the simulation's.
        """
        if os.name != "posix":
            raise SwingupError("a rehearsal needs a POSIX system to share a connection: run it on Linux or macOS")
        self._calling, self._doing = calling, "its import"
        self._connection, theirs = multiprocessing.Pipe()
        # As on a robot: no paths from this environment, this package not beside the program, no caches written.
        command = [sys.executable, "-E", "-P", "-B", str(Path(__file__).with_name("child.py")), str(folder.entry)]
        # Closed here once the child has it: else its end would not show as the end of the connection.
        with theirs:
            # Prints go to standard error: standard output may be this program's JSON. In a session of its own: an
            # interrupt from the keyboard is for the rehearsal, which ends the process.
            self._process = subprocess.Popen(
                [*command, "simulated" if simulated_clock else "real", str(theirs.fileno())],
                stdin=subprocess.DEVNULL, stdout=2, cwd=folder.entry.parent, start_new_session=True,
                pass_fds=[theirs.fileno()],
            )  # fmt: skip
        try:
            self.facts = self._describe(loading)
            """What the folder says about itself."""
        except BaseException:
            self.close()
            raise

    def __exit__(self, *reason: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process, whatever it does."""
        # A folder may ignore anything milder.
        self._process.kill()
        self._process.wait()
        self._connection.close()

    def send(self, t: float, x: np.ndarray) -> None:
        """Call the controller with the state x (4,) (rad, rad/s) at time t (s); ``receive`` has the answer."""
        self._doing = f"its call at t = {t:g} s"
        self._send([t, x.tolist()])
        self._sent = time.perf_counter()

    def receive(self, wait: float = math.inf) -> tuple[np.ndarray, float] | None:
        """The torques (2,) (N m) and the call's own time (s); None if they are not there ``wait`` s from now."""
        end = self._sent + self._calling
        # Also without time left: an answer that is there must not count as missed.
        if time.perf_counter() + wait < end and not self._connection.poll(max(0.0, wait)):
            return None
        answer = self._answer(end, self._calling)
        return np.array(answer["u"]), answer["seconds"]

    def stop(self) -> dict[str, Any] | None:
        """When (s) and why a safety guard has stopped the controller, if it has."""
        self._doing = "its report"
        found: dict[str, Any] | None = self._describe(self._calling)["stopped"]
        return found

    def _describe(self, timeout: float) -> dict[str, Any]:
        self._send(None)
        return self._answer(time.perf_counter() + timeout, timeout)

    def _send(self, message: Any) -> None:
        try:
            self._connection.send_bytes(json.dumps(message).encode())
        except ConnectionError:
            # A fault may have been told before the process ended; else its end is the fault.
            self._answer(time.perf_counter() + 1.0, 1.0)

    def _answer(self, end: float, timeout: float) -> dict[str, Any]:
        """The next answer, which must be there before ``end``, within ``timeout`` s."""
        if not self._connection.poll(max(0.0, end - time.perf_counter())):
            raise SwingupError(f"{self._doing} did not end within {timeout:g} s: it hangs, or is far too slow")
        try:
            answer: dict[str, Any] = json.loads(self._connection.recv_bytes())
        except (EOFError, ConnectionError):
            raise SwingupError(f"{self._doing} ended its process, {_status(self._process.wait())}") from None
        if "fault" in answer:
            raise SwingupError(f"{one_line(answer['fault'])}: correct it there")
        return answer


def _status(code: int) -> str:
    names = {each.value: each.name for each in signal.Signals}
    how = f"with status {code}" if code >= 0 else f"by {names.get(-code, f'signal {-code}')}"
    return f"{how}: correct it there"
