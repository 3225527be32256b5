"""The command line, ``swingup``: from arguments to an exit status."""

import errno
import os
import signal
import socket
import sys
import threading
import time
from pathlib import Path

from ..common.errors import SwingupError

ERROR = 2
"""Exit status of bad input."""
INTERRUPTED = 130
"""Exit status after Ctrl-C: 128 and the number of SIGINT, as shells count."""
GRACE = 3.0
"""Seconds that a command has for its end after Ctrl-C."""

_INTERRUPTED_LINES = ["swingup: interrupted"]


def say_if_interrupted(line: str) -> None:
    """What Ctrl-C prints from now on, after its own line."""
    _INTERRUPTED_LINES[1:] = [line]


def main(arguments: list[str] | None = None) -> int:
    """Run a command, by default the process's; bad input ends in one line on standard error and a failure."""
    # XLA's warnings of slow compilation tell a user nothing. JAX reads this when it is imported.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    del _INTERRUPTED_LINES[1:]  # Those of an earlier call
    try:
        if sys.stdout is None:
            raise OSError(errno.EBADF, "it is closed")
        _accept_any_text()
        if arguments is None:
            _end_soon_after_interrupts()
        status = _run(sys.argv[1:] if arguments is None else arguments)
        # What cannot be written shows here, inside the try, and not at the interpreter's exit.
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        print(*_INTERRUPTED_LINES, sep="\n", file=sys.stderr)
        if arguments is None:
            os._exit(INTERRUPTED)  # XLA's threads, which know no signals, can crash an orderly exit
        return INTERRUPTED
    except SwingupError as error:
        return _refuse(error)
    except RuntimeError as error:
        # JAX says this where it is first used, which may be anywhere.
        if not str(error).startswith("Unable to initialize backend"):
            raise
        return _refuse(SwingupError(str(error)))
    except OSError as error:
        reason = error.strerror or str(error)
        if error.filename is not None:
            return _refuse(SwingupError(f"cannot use {error.filename}: {reason}; choose another name or folder"))
        if sys.stdout is not None:
            try:
                sys.stdout.flush()
            except OSError:  # the interpreter flushes it when it exits, which would fail again
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            else:
                return _refuse(SwingupError(f"the system refused: {reason}"))
        if isinstance(error, BrokenPipeError):  # the reader has gone, as in `swingup ... | head`
            return 1
        return _refuse(SwingupError(f"cannot write standard output: {reason}"))


def _run(arguments: list[str]) -> int:
    # Imported here, so that other modules of this package can be used without tyro.
    from .commands import run_command

    _use_compilation_cache()
    try:
        return run_command(arguments)
    except SystemExit as stopped:  # tyro printed help, or what is missing
        return int(stopped.code or 0)


def _refuse(error: SwingupError) -> int:
    print(f"swingup: error: {error}", file=sys.stderr)
    return ERROR


def _accept_any_text() -> None:
    """Names that the terminal's encoding lacks, such as file names that are not UTF-8, are printed as escapes."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # what a test or a notebook puts there may lack it
            stream.reconfigure(errors="backslashreplace")


def _end_soon_after_interrupts() -> None:
    """End the process soon after Ctrl-C, also where KeyboardInterrupt does not reach ``main``.

    A compiled program or a library's loop holds it up, and JAX's callback of the garbage collector loses it: Python
    ignores exceptions there. The system writes the signal's number to a socket at once, whatever Python does.
    """
    sockets = socket.socketpair()
    sockets[1].setblocking(False)
    try:
        signal.set_wakeup_fd(sockets[1].fileno())
    except ValueError:  # outside of the main thread, which alone gets signals
        return

    def watch() -> None:
        while sockets[0].recv(1)[0] != signal.SIGINT:
            pass
        time.sleep(GRACE)
        # print would wait for a main thread that prints.
        os.write(2, "".join(f"{line}\n" for line in _INTERRUPTED_LINES).encode())
        os._exit(INTERRUPTED)

    threading.Thread(target=watch, daemon=True).start()


def _use_compilation_cache() -> None:
    """Keep compiled programs in the user's cache folder, so that only a command's first run compiles."""
    import jax

    # A folder that the user has set stays.
    if jax.config.values["jax_compilation_cache_dir"] is None:
        try:
            folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "swingup"
            folder.mkdir(parents=True, exist_ok=True)
        except (OSError, RuntimeError):  # or there is no home
            return  # without a cache every run compiles, which costs seconds and nothing else
        jax.config.update("jax_compilation_cache_dir", str(folder))
        # JAX's own limit is 1 s, and leaves shorter compilations out of the cache.
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
