"""Cores and devices share a run's seeds."""

import json
import os
import subprocess
import sys

import jax
import pytest

from swingup.learner import compiled_backend

PROGRAM = """
import json, sys
import jax
from swingup import AREAPO

sizes = {"num_envs": 2, "num_steps": 8, "num_epochs": 1, "batch_size": 16}
layers, rows = {"policy_layers": (8,), "value_layers": (8,)}, []
model = AREAPO("acrobot", seeds=int(sys.argv[1]), evaluate_every=32, **sizes, **layers)
model.learn(32, lambda _, report: rows.extend(report.rows))
state, backend = model._run.snapshot()[0], model._run.backend
# Seeds are independent: no device waits for another.
compiled = backend._advance.lower(state, backend._task, model.config, 1).compile().as_text()
exchanges = ("all-gather", "all-reduce", "all-to-all", "collective-permute", "reduce-scatter")
assert not [name for name in exchanges if name in compiled]
used = len(state.actor.mean_head.weight.sharding.device_set)
print(json.dumps([len(jax.devices()), used, [row["gain"] for row in rows[-model.settings.seeds:]]]))
"""


def trained(devices, seeds=4):
    """How many devices there are and are used, and the seeds' gains."""
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={devices}"
    command = [sys.executable, "-c", PROGRAM, str(seeds)]
    result = subprocess.run(command, env=os.environ | {"XLA_FLAGS": flags}, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


@pytest.mark.slow
def test_two_devices_share_four_seeds():
    there, used, gains = trained(2)
    assert (there, used) == (2, 2)
    _, alone, expected = trained(1)
    assert alone == 1
    assert len(set(gains)) == 4
    # The same seeds, to rounding: each device has a batch of half the size.
    assert gains == pytest.approx(expected, rel=1e-3, abs=1e-5)


@pytest.mark.slow
def test_seeds_that_the_devices_do_not_divide_stay_on_one():
    assert trained(2, seeds=3)[:2] == [2, 1]


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
