import os
import subprocess
import sys

import jax
import pytest

from swingup.learner import cores


@pytest.mark.parametrize(
    ("seeds", "there", "expected"), [(2, 2, 2), (4, 2, 2), (3, 2, None), (6, 8, 6), (1, 8, None)]
)
def test_as_many_cores_as_share_the_seeds_evenly(monkeypatch, seeds, there, expected):
    asked = {}
    monkeypatch.setattr(jax.config, "update", lambda name, value: asked.update({name: value}))
    monkeypatch.setattr(cores, "cores", lambda: there)
    monkeypatch.setenv("XLA_FLAGS", "")
    cores.share_cores(seeds)
    dispatch = {"jax_cpu_enable_async_dispatch": False}
    assert asked == ({} if expected is None else {"jax_num_cpu_devices": expected} | dispatch)


def test_the_users_number_of_devices_stays(monkeypatch):
    monkeypatch.setattr(jax.config, "update", lambda *_: pytest.fail("the configuration was changed"))
    monkeypatch.setattr(cores, "cores", lambda: 8)
    monkeypatch.setenv("XLA_FLAGS", "--xla_force_host_platform_device_count=2")
    cores.share_cores(4)


def test_after_the_first_computation_nothing_changes():
    before = jax.device_count()
    cores.share_cores(64)
    assert jax.device_count() == before
    assert jax.config.values["jax_cpu_enable_async_dispatch"]


@pytest.mark.slow
def test_a_program_trains_on_the_cores_that_it_asked_for():
    program = "from swingup.learner import cores\ncores.cores = lambda: 2\ncores.share_cores(4)\n"
    program += "import jax; print(jax.device_count())"
    environment = os.environ | {"XLA_FLAGS": "", "JAX_PLATFORMS": "cpu"}
    shown = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
    assert shown.stdout.strip() == "2", shown.stderr
