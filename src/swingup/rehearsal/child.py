"""The process that runs an exported folder: a program of its own, with the standard library and NumPy.

    python -E -P -B child.py ENTRY CLOCK DESCRIPTOR

ENTRY is the folder's Python file. CLOCK is ``real``, or ``simulated``: a controller that measures the time itself
then sees the simulation's. DESCRIPTOR is one end of a ``multiprocessing`` connection, which carries JSON. Each
message ``[time, state]`` gets the answer of a call; ``null`` gets what the controller says of itself and of its
guard. ``{"fault": sentence}`` replaces any answer, and the process ends.
"""

import importlib
import inspect
import io
import json
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

MAX_ERROR_LENGTH = 300  # Characters of a foreign error


class FolderError(Exception):
    """What is wrong with the folder, as a sentence without its subject."""


class Entry:
    """The folder's controller behind one interface."""

    def __init__(self, path: Path, simulated: bool) -> None:
        self.time, self._printed = 0.0, io.StringIO()
        sys.path.insert(0, str(path.parent))
        module = importlib.import_module(path.stem)
        factory = getattr(module, "ControllerType", None)
        self._takes_motors = factory is not None
        self.controller = getattr(module, "controller", None) if factory is None else self._make(factory, simulated)
        self._call: Any = getattr(self.controller, "get_control_output", None)
        if not callable(self._call):
            raise FolderError(f"defines no 'controller' with get_control_output: {path.name} needs one")
        # Prints of the import are harmless, those in the loop are not.
        sys.stdout.flush()
        sys.stdout = self._printed

    def _make(self, factory: Any, simulated: bool) -> Any:
        """A controller for CloudPendulum, whose calls carry no time."""
        if simulated and "clock" in inspect.signature(factory).parameters:
            return factory(clock=lambda: self.time)
        return factory()

    def answer(self, t: float, x: list[float]) -> dict[str, Any]:
        """One call: its torques (N m) and its time (s)."""
        self.time = t
        if self._takes_motors:
            state = [SimpleNamespace(position=x[i], velocity=x[i + 2]) for i in (0, 1)]
            begin = time.perf_counter()
            given = self._call(state)
        else:
            # Before the clock starts: a robot's loop has its array.
            measured = np.array(x)
            begin = time.perf_counter()
            given = self._call(x=measured, t=t)
        seconds = time.perf_counter() - begin
        if self._printed.tell():
            raise FolderError(
                f"printed {self._printed.getvalue()[:40]!r} at t = {t:g} s: a loop must not wait for that"
            )
        u = np.asarray(given)
        if u.shape != (2,) or u.dtype.kind not in "fiub":
            what = f"of shape {u.shape}" if u.dtype.kind in "fiub" else repr(given)[:60]
            raise FolderError(f"gave a torque at t = {t:g} s that is {what}: two real numbers [u1, u2] are needed")
        return {"u": [float(u[0]), float(u[1])], "seconds": seconds}

    def facts(self) -> dict[str, Any]:
        """What the controller says about itself, and what it imported."""
        robot, fault = (getattr(self.controller, name, None) for name in ("robot", "fault"))
        stopped = getattr(fault, "time", None)
        guard = getattr(self.controller, "guard", None) or None
        settings = getattr(guard, "settings", None)
        limits = {"angle": "angle_limit", "speed": "velocity_limit"}
        # A foreign controller may have something else under these names.
        known = all(hasattr(settings, where) for where in limits.values())
        return {
            "robot": getattr(robot, "name", robot),
            "guard": guard is not None,
            "limits": {name: float(getattr(settings, where)) for name, where in limits.items()} if known else None,
            "stopped": None if stopped is None else {"time": float(stopped), "why": str(fault)},
            "packages": _packages(),
        }


def _packages() -> list[str]:
    """Names of the packages in use that are neither Python's own nor the folder's."""
    folder, found = Path(sys.path[0]).resolve(), set()
    for name, module in list(sys.modules.items()):
        top, file = name.partition(".")[0], getattr(module, "__file__", None)
        # Debian's Python comes with a sitecustomize, which is not among the names of the standard library.
        ours = top.startswith("_") or top in (*sys.stdlib_module_names, "__main__", "sitecustomize")
        if file and not ours and not Path(file).resolve().is_relative_to(folder):
            found.add(top)
    return sorted(found)


def main() -> None:
    """Answer messages until there are no more, or until a fault."""
    connection = Connection(int(sys.argv[3]))

    def send(answer: dict[str, Any]) -> None:
        # A foreign controller's name or reason may be an object of any kind.
        connection.send_bytes(json.dumps(answer, default=str).encode())

    doing = "its import"
    try:
        entry = Entry(Path(sys.argv[1]), sys.argv[2] == "simulated")
        while True:
            try:
                message = json.loads(connection.recv_bytes())
            except EOFError:
                return
            if message is None:
                send(entry.facts())
            else:
                t, x = message
                doing = f"its call at t = {t:g} s"
                send(entry.answer(t, x))
    except FolderError as fault:
        send({"fault": f"it {fault}"})
    # All of them: an exit would otherwise look like a crash.
    except BaseException as error:
        send({"fault": f"{doing} raised {type(error).__name__} ({str(error)[:MAX_ERROR_LENGTH]})"})


if __name__ == "__main__":
    main()
