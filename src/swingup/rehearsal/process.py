"""The other end of ``child.py``: an exported folder's controller in a process of its own, behind timeouts."""

import json
import math
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..common.errors import SwingupError, one_line
from ..export.folder import PACKAGE, ROBOT_FORMS
from ..policy.feedback import FILE as LAW_FILE

PATTERNS = {form: entry.format(name="*") for form, (entry, _) in ROBOT_FORMS.items()}
"""Forms of exported folders, and the file that each has."""


@dataclass(frozen=True)
class Folder:
    """An exported folder."""

    entry: Path  # The file that defines its controller
    form: str  # realaigym or cloudpendulum

    @property
    def policy(self) -> Path | None:
        """The file of the policy or of the feedback law; None where the folder is not ours."""
        package = self.entry.parent / PACKAGE.format(name=self.entry.stem.partition("_")[2])
        return next(filter(Path.is_file, (package / name for name in ("policy.safetensors", LAW_FILE))), None)


def find_folder(path: str | Path) -> Folder:
    """Find a folder's controller; the path may be that of its file, where it has several."""
    place = Path(path)
    if not place.exists():
        raise SwingupError(f"no such folder: {path}; swingup export POLICY --to realaigym --out FOLDER writes one")
    files = [place] if place.is_file() else sorted(place.iterdir())
    found = [
        Folder(file.resolve(), form) for form, pattern in PATTERNS.items() for file in files if file.match(pattern)
    ]
    if len(found) > 1:
        names = " or ".join(each.entry.name for each in found[:4])
        raise SwingupError(f"{path} holds {len(found)} controllers: name a file in it, {names}")
    if not found:
        kinds = " or ".join(f"{pattern} ({form})" for form, pattern in PATTERNS.items())
        raise SwingupError(f"{path} holds no controller: a folder of swingup export has {kinds}")
    return found[0]


LOADING_TIME = 60.0  # Maximum time of an import (s): a cold disk and a busy machine take seconds
CALLING_TIME = 2.0  # Maximum time of a call (s), after which it counts as hung


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
        self._calling, self._doing, self._pending = calling, "its import", False
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
        # A folder may ignore anything milder. Its session has what it started, too.
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._connection.close()

    def send(self, t: float, x: np.ndarray) -> None:
        """Call the controller with the state x (4,) (rad, rad/s) at time t (s); ``receive`` has the answer."""
        self._doing = f"its call at t = {t:g} s"
        self._send([t, x.tolist()])
        self._sent, self._pending = time.perf_counter(), True

    def receive(self, wait: float = math.inf) -> tuple[np.ndarray, float] | None:
        """The torques (2,) (N m) and the call's own time (s); None if they are not there ``wait`` s from now."""
        end = self._sent + self._calling
        # Also without time left: an answer that is there must not count as missed.
        if time.perf_counter() + wait < end and not self._connection.poll(max(0.0, wait)):
            return None
        answer = self._answer(end, self._calling)
        self._pending = False
        return np.array(answer["u"]), answer["seconds"]

    def stop(self) -> dict[str, Any] | None:
        """When (s) and why a safety guard has stopped the controller, if it has."""
        if self._pending:  # the run ended before its last answer
            self.receive()
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
            # The process may have sent a fault before it ended; else its end is the fault.
            self._answer(time.perf_counter() + 1.0, 1.0)

    def _answer(self, end: float, timeout: float) -> dict[str, Any]:
        """The next answer, which must be there before ``end``, within ``timeout`` s."""
        if not self._connection.poll(max(0.0, end - time.perf_counter())):
            raise SwingupError(f"{self._doing} did not end within {timeout:g} s: it hangs, or is far too slow")
        try:
            answer: dict[str, Any] = json.loads(self._connection.recv_bytes())
        except (EOFError, ConnectionError):
            try:
                code, names = self._process.wait(1.0), {each.value: each.name for each in signal.Signals}
            except subprocess.TimeoutExpired:
                raise SwingupError(f"{self._doing} closed its connection and goes on: correct it there") from None
            how = f"with status {code}" if code >= 0 else f"by {names.get(-code, f'signal {-code}')}"
            raise SwingupError(f"{self._doing} ended its process, {how}: correct it there") from None
        if "fault" in answer:
            raise SwingupError(f"{one_line(answer['fault'])}: correct it there")
        return answer


WATCHED_TIME = 0.0005
"""End of a wait (s) that is spent looking at the clock: a sleep may take longer than its time."""


@dataclass
class Timing:
    """What was measured of the calls of one run or several."""

    calls: list[float] = field(default_factory=list)  # Time inside each call (s)
    periods: list[float] = field(default_factory=list)  # Times between the calls of a run in real time (s)
    missed_deadlines: int = 0  # Periods that ended without an answer: the motors kept the torques before
    late_periods: int = 0  # Periods that began late because the simulation, not the controller, was slow


class FolderController:
    """Calls the folder at every step and waits for its answer; a fault raises ``SwingupError``.

    With a period (s) it does so in real time, one step a period, as a robot's loop runs. A controller whose answer
    takes longer is not called again until it is there. Meanwhile the motors keep the torques before, and the
    simulation goes on.
    """

    def __init__(self, process: FolderProcess, period: float | None = None, timing: Timing | None = None) -> None:
        """Wrap a running folder, and add to a timing; the simulation's clock may differ from the nominal period."""
        self._process, self._period, self.timing = process, period, timing or Timing()
        # The first period begins when it is asked for.
        self._begin, self._time, self._call_begin = -math.inf, 0.0, -math.inf
        self._held, self._busy = np.zeros(2), False
        self.fault: SwingupError | None = None  # The first of the process, which cannot answer any more

    def get_control_output(self, x: np.ndarray, t: float) -> np.ndarray:
        """The torques (2,) (N m) that act from time t (s), for the state x (4,) that is measured then."""
        if self.fault is not None:
            raise self.fault
        end = math.inf if self._period is None else self._wait(t, self._period) + self._period
        try:
            if not self._busy:
                self._process.send(t, x)
            reply = self._process.receive(end - time.perf_counter())
        except SwingupError as error:
            self.fault = error
            raise
        self._busy = reply is None
        if reply is None:
            self.timing.missed_deadlines += 1
        else:
            self._held, seconds = reply
            self.timing.calls.append(seconds)
        return self._held

    def _wait(self, t: float, period: float) -> float:
        """Wait for the period that begins at time t (s) of the simulation; when it began."""
        now, due = time.perf_counter(), self._begin + t - self._time
        # A loop that is late does not catch up: its next period begins now, as a robot's does.
        self.timing.late_periods += math.isfinite(due) and not self._busy and now > due + 0.5 * period
        if due - now > WATCHED_TIME:
            time.sleep(due - now - WATCHED_TIME)
        while (now := time.perf_counter()) < due:
            pass
        self._begin, self._time = now, t
        if not self._busy:
            if math.isfinite(self._call_begin):
                self.timing.periods.append(now - self._call_begin)
            self._call_begin = now
        return now
