"""Jobs for the local workers of ``test_sweep.py``; a worker that imports them starts at once."""

import os
import signal


def end_of_worker(marker, deaths):
    """Kill the process that calls this, so many times."""
    with marker.open("a") as file:
        file.write("x")
    if len(marker.read_text()) <= deaths:
        os.kill(os.getpid(), signal.SIGKILL)
    return deaths
