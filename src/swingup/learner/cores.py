"""Several seeds on the cores of a CPU."""

import contextlib
import os

import jax

from ..common.cores import cores

COUNT_FLAG = "xla_force_host_platform_device_count"


def share_cores(seeds: int) -> None:
    """Make JAX show as many of the CPU's cores as devices as share the seeds evenly.

    It works only before JAX's first computation. Afterwards, and where the user's XLA_FLAGS set the number of
    devices, nothing changes: the seeds then train on the devices that there are.

    Asynchronous dispatch is switched off as well. Programs on several devices run in threads of XLA, of which a CPU
    has one for each core. With asynchronous dispatch, programs on one device, such as evaluations, hold these
    threads, too; without it they run in the thread that calls them.
    """
    count = max(each for each in range(1, cores() + 1) if seeds % each == 0)
    if count == 1 or COUNT_FLAG in os.environ.get("XLA_FLAGS", ""):
        return
    with contextlib.suppress(RuntimeError):
        jax.config.update("jax_num_cpu_devices", count)
        jax.config.update("jax_cpu_enable_async_dispatch", False)
