"""How many cores this process may use."""

import os


def cores() -> int:
    """The cores that the system lets this process use: fewer than the machine has under ``taskset`` or in a job."""
    affinity = getattr(os, "sched_getaffinity", None)  # not on every system
    return len(affinity(0)) if affinity else os.cpu_count() or 1
