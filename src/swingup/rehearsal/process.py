"""The other end of ``child.py``: an exported folder's controller in a process of its own, behind timeouts."""

import json
import os
import select
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SwingupError
from ..text import one_line, quoted
from . import child
from .folder import Folder

LOADING = 60.0
"""Longest time in which a folder may be imported (s); a cold disk and a busy machine take seconds."""
CALLING = 2.0
"""Longest time of a call (s), after which it counts as hung."""
LONGEST_REPLY = 100_000
"""Bytes; a longer one is no reply."""


@dataclass(frozen=True)
class Reply:
    """What one call gave."""

    u: np.ndarray
    """Torques (2,) (N m)."""
    seconds: float
    """Time inside the call (s)."""
    stopped: bool
    """Whether a safety guard has stopped the controller."""


class FolderProcess:
    """A running folder. Use it in a ``with`` statement: the process ends with it."""

    def __init__(
        self, folder: Folder, simulated_clock: bool, loading: float = LOADING, calling: float = CALLING
    ) -> None:
        """Start the process and import the folder in it.

        Args:
            folder: what to run.
            simulated_clock: whether a controller that measures the time itself is given the simulation's.
            loading: longest time of the import (s).
            calling: longest time of a call (s).

        Raises:
            SwingupError: the folder cannot be imported, or defines no controller.
        """
        if os.name != "posix":
            raise SwingupError("a rehearsal waits for pipes as only POSIX systems can: run it on Linux or macOS")
        self._calling, self._doing = calling, "its import"
        command = [sys.executable, "-E", "-P", "-B", str(Path(__file__).with_name("child.py"))]
        # In a session of its own: an interrupt from the keyboard is for the rehearsal, which ends the process.
        self._process = subprocess.Popen(
            [*command, str(folder.entry), "simulated" if simulated_clock else "real"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=folder.entry.parent,
            bufsize=0, start_new_session=True,
        )  # fmt: skip
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._commands, self._replies = self._process.stdin.fileno(), self._process.stdout.fileno()
        try:
            self.facts = self._describe(loading)
            """What the folder says about itself."""
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "FolderProcess":
        """The process itself."""
        return self

    def __exit__(self, *reason: object) -> None:
        """End the process."""
        self.close()

    def close(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()

    def send(self, t: float, x: np.ndarray) -> None:
        """Call the controller with the state x (4,) (rad, rad/s) at time t (s); ``receive`` has the answer."""
        self._doing = f"its call at t = {t:g} s"
        self._command(child.CALL, t, x.tolist())
        self._sent = time.perf_counter()

    def receive(self, wait: float | None = None) -> Reply | None:
        """The answer to what was sent; None if it is not there ``wait`` seconds from now.

        Without ``wait`` the answer must come.

        Raises:
            SwingupError: the call took too long, failed, or ended the process.
        """
        end = self._sent + self._calling
        if wait is not None and time.perf_counter() + wait < end and not self._arrived(wait):
            return None
        u1, u2, seconds, stopped = child.ANSWER.unpack(self._reply(child.TORQUE, end, self._calling))
        return Reply(np.array([u1, u2]), seconds, bool(stopped))

    def guard_report(self) -> dict[str, Any]:
        """Whether the controller has a safety guard, and when and why that stopped it."""
        self._doing = "its report"
        facts = self._describe(self._calling)
        return {name: facts[name] for name in ("guard", "stopped")}

    def _describe(self, timeout: float) -> dict[str, Any]:
        self._command(child.DESCRIBE, 0.0, [0.0] * 4)
        facts: dict[str, Any] = json.loads(self._reply(child.FACTS, time.perf_counter() + timeout, timeout))
        return facts

    def _command(self, kind: int, t: float, x: list[float]) -> None:
        try:
            # Smaller than any pipe's buffer: it is written whole.
            os.write(self._commands, child.COMMAND.pack(kind, t, *x))
        except BrokenPipeError:
            # A fault may have been told before the process ended; else its end is the fault.
            self._reply(kind, time.perf_counter() + 1.0, 1.0)

    def _arrived(self, timeout: float) -> bool:
        return bool(select.select([self._replies], [], [], max(0.0, timeout))[0])

    def _reply(self, kind: int, end: float, timeout: float) -> bytes:
        """The content of the next reply: of this kind, and there before ``end``, within ``timeout`` s."""
        told, length = child.REPLY.unpack(self._read(child.REPLY.size, end, timeout))
        content = self._read(min(length, LONGEST_REPLY), end, timeout)
        if told == child.FAULT:
            raise SwingupError(f"{one_line(content.decode(errors='replace'))}: correct it there")
        if told != kind:
            raise SwingupError(f"{self._doing} gave {quoted(content)} on the rehearsal's pipe: write nothing there")
        return content

    def _read(self, size: int, end: float, timeout: float) -> bytes:
        content = b""
        while len(content) < size:
            if not self._arrived(end - time.perf_counter()):
                raise SwingupError(f"{self._doing} did not end within {timeout:g} s: it hangs, or is far too slow")
            part = os.read(self._replies, size - len(content))
            if not part:
                raise SwingupError(f"{self._doing} ended its process, {_status(self._process.wait())}")
            content += part
        return content


def _status(code: int) -> str:
    if code >= 0:
        return f"with status {code}: correct it there"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    return f"by {name}: correct it there"
