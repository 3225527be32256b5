"""The process that runs an exported folder: a program of its own, with the standard library and NumPy.

    python -E -P -B child.py ENTRY CLOCK

ENTRY is the folder's Python file. CLOCK is ``real``, or ``simulated``: a controller that measures the time itself
then sees the simulation's. Commands come from standard input, each gets one reply on standard output. What the
folder prints goes to standard error.

======== ====================== ========================================================================
command  its content            reply
======== ====================== ========================================================================
CALL     time (s), state (4,)   TORQUE: torques (2,) (N m), time of the call (s), 1.0 if a guard stopped it
DESCRIBE zeros                  FACTS: JSON of what the controller says of itself and of its guard
======== ====================== ========================================================================

FAULT, a sentence, replaces any reply, and the process ends.
"""

import importlib
import inspect
import io
import json
import os
import struct
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

COMMAND = struct.Struct("<B5d")
"""A command: its kind, time and state."""
CALL, DESCRIBE = 1, 2

REPLY = struct.Struct("<BI")
"""The head of a reply: its kind, and the length of what follows (bytes)."""
TORQUE, FACTS, FAULT = 1, 2, 3

ANSWER = struct.Struct("<4d")
"""What follows TORQUE."""

LONGEST_TEXT = 300
"""Characters of a foreign error."""


class FolderError(Exception):
    """What is wrong with the folder, as a sentence without its subject."""


class Entry:
    """The folder's controller behind one interface."""

    def __init__(self, path: Path, simulated: bool) -> None:
        """Import the folder's file and find its controller."""
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

    def answer(self, t: float, x: tuple[float, ...]) -> bytes:
        """One call, as a reply."""
        self.time = t
        if self._takes_motors:
            state = [SimpleNamespace(position=x[i], velocity=x[i + 2]) for i in (0, 1)]
            begin = time.perf_counter()
            given = self._call(state)
        else:
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
        stopped = getattr(self.controller, "fault", None) is not None
        return ANSWER.pack(float(u[0]), float(u[1]), seconds, float(stopped))

    def facts(self) -> bytes:
        """What the controller says about itself, and what it imported."""
        robot, fault = getattr(self.controller, "robot", None), getattr(self.controller, "fault", None)
        guard = getattr(self.controller, "guard", None)
        settings = getattr(guard, "settings", None)
        limits = {"angle": "angle_limit", "speed": "velocity_limit"}
        facts = {
            "robot": getattr(robot, "name", robot),
            "guard": guard is not None,
            "limits": settings and {name: float(getattr(settings, where)) for name, where in limits.items()},
            "stopped": None if fault is None else {"time": float(fault.time), "why": str(fault)},
            "packages": _packages(),
        }
        return json.dumps(facts, default=str).encode()


def _packages() -> list[str]:
    """Names of the packages in use that are neither Python's own nor the folder's."""
    folder, found = Path(sys.path[0]).resolve(), set()
    for name, module in list(sys.modules.items()):
        top, file = name.partition(".")[0], getattr(module, "__file__", None)
        ours = top.startswith("_") or top in (*sys.stdlib_module_names, "__main__")
        if file and not ours and not Path(file).resolve().is_relative_to(folder):
            found.add(top)
    return sorted(found)


def _read(source: int) -> tuple[int, float, tuple[float, ...]] | None:
    """The next command; None when there are no more."""
    content = b""
    while len(content) < COMMAND.size:
        part = os.read(source, COMMAND.size - len(content))
        if not part:
            return None
        content += part
    kind, t, *x = COMMAND.unpack(content)
    return kind, t, tuple(x)


def _write(target: int, kind: int, content: bytes) -> None:
    reply = REPLY.pack(kind, len(content)) + content
    while reply:
        reply = reply[os.write(target, reply) :]


def main() -> None:
    """Answer commands until there are no more, or until a fault."""
    source, target = os.dup(0), os.dup(1)
    # The pipes are ours: the folder, and libraries in C, print to standard error and find no input.
    os.dup2(2, 1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    doing = "its import"
    try:
        entry = Entry(Path(sys.argv[1]), sys.argv[2] == "simulated")
        while (command := _read(source)) is not None:
            kind, t, x = command
            doing = f"its call at t = {t:g} s"
            if kind == CALL:
                _write(target, TORQUE, entry.answer(t, x))
            else:
                _write(target, FACTS, entry.facts())
    except FolderError as fault:
        _write(target, FAULT, f"it {fault}".encode(errors="backslashreplace"))
    except BaseException as error:
        text = f"{doing} raised {type(error).__name__} ({str(error)[:LONGEST_TEXT]})"
        _write(target, FAULT, text.encode(errors="backslashreplace"))


if __name__ == "__main__":
    main()
