"""What all layers share: errors, checks, settings, files, arrays and tables."""

import os
import threading

__version__ = "0.1.0"  # pyproject.toml and CITATION.cff name the same, which a test holds

DISPATCH = threading.Lock()
"""Held by threads that call one compiled program while they call it: each would trace and compile it anew. The call
returns before its result is computed, so that they wait for the results side by side."""


def cores() -> int:
    """The cores that the system lets this process use: fewer than the machine has under ``taskset`` or in a job."""
    affinity = getattr(os, "sched_getaffinity", None)  # not on every system
    return len(affinity(0)) if affinity else os.cpu_count() or 1
