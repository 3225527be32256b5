"""Seeds side by side on as many of the CPU's cores as share them evenly."""

import os
import subprocess
import sys

import jax
import pytest

from swingup.learner import compiled_backend


def test_after_the_first_computation_nothing_changes():
    before = jax.device_count()
    compiled_backend.share_cores(64)
    assert jax.device_count() == before
    assert jax.config.values["jax_cpu_enable_async_dispatch"]


@pytest.mark.slow
def test_a_program_trains_on_the_cores_that_it_asked_for():
    """As many as share the seeds evenly, unless the user has said how many."""
    theirs = "--xla_force_host_platform_device_count=3"
    for seeds, there, flags, expected in ((4, 2, "", 2), (6, 8, "", 6), (3, 2, "", 1), (4, 2, theirs, 3)):
        program = "from swingup.learner import compiled_backend as backend\n"
        program += f"backend.cores = lambda: {there}\nbackend.share_cores({seeds})\n"
        program += "import jax; print(jax.device_count())"
        environment = os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}
        shown = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
        assert shown.stdout.strip() == str(expected), shown.stderr
