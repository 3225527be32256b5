"""Self-tests of exports: they pass, and find another policy or a program that computes otherwise."""

import dataclasses
import runpy

import numpy as np
import pytest

from swingup.export.c_header import c_header
from swingup.export.folder import export_folder
from swingup.policy.file import write_network
from swingup.policy.self_test import loop_test, task_test
from swingup.policy.shipped import load_policy
from swingup.policy.spaces import box

from . import compiled
from .references import policy, space_task, task_policy


def shifted(network):
    """The network with another bias of its head."""
    head = dataclasses.replace(network.head, bias=network.head.bias + np.float32(0.1))
    return dataclasses.replace(network, head=head)


def test_a_folder_passes_its_own_and_refuses_another_policy(tmp_path):
    own = task_policy("unequal")
    entry = export_folder(own, tmp_path / "out", "numpy", "valve")
    seen = task_test(own).observations
    np.testing.assert_array_equal(runpy.run_path(entry)["policy"].predict(seen)[0], own.predict(seen)[0])
    write_network(tmp_path / "out/valve_controller/policy.safetensors", shifted(own.network), own.metadata)
    with pytest.raises(Exception, match="its self-test fails at observation 1 of 16"):
        runpy.run_path(entry)


def test_a_controllers_folder_refuses_another_policy(tmp_path):
    own = load_policy("ar-eapo", "acrobot")
    entry = export_folder(own, tmp_path / "out", "realaigym", "twin")
    assert runpy.run_path(entry)["controller"].get_control_output(np.zeros(4), 0.0).shape == (2,)
    write_network(tmp_path / "out/twin_controller/policy.safetensors", shifted(own.network), own.metadata)
    with pytest.raises(Exception, match="its self-test fails at observation"):
        runpy.run_path(entry)
    (tmp_path / "out/twin_controller/self_test.json").write_text("[]")
    with pytest.raises(Exception, match="is not a self-test"):
        runpy.run_path(entry)


@compiled.needs_gcc
def test_a_header_that_computes_otherwise_fails(tmp_path):
    """Actions bounded by clipping in place of tanh."""
    for number, (found, driver) in enumerate(
        ((task_policy("tanh"), compiled.TASK_DRIVER), (policy("pendubot-wrapped"), compiled.DRIVER))
    ):
        text = c_header(found).replace("BOUNDS SWINGUP_TANH", "BOUNDS SWINGUP_CLIP")
        (tmp_path / str(number)).mkdir()
        assert compiled.compile_header(tmp_path / str(number), text, driver=driver).self_test() > 0


@compiled.needs_gcc
def test_actions_of_half_precision_pass(tmp_path):
    """Beside 3 such numbers are 0.002 apart, more than 1e-4 of the range."""
    text = c_header(space_task("half", box((1,), -2.0, 3.0, "float16"), box((3,))))
    assert compiled.compile_header(tmp_path, text, driver=compiled.TASK_DRIVER).self_test() == 0


def test_observations_are_those_of_the_task():
    """Within the bounds, in the space's shape and type, and with actions that rounding does not change."""
    found = task_test(task_policy("choices"))
    assert found.observations.shape == (16,)
    assert np.abs(found.observations).max() <= 1.0
    assert found.actions.shape == (16, 2)
    assert len(np.unique(found.actions, axis=0)) > 1


def test_a_controller_with_a_memory_is_tested_over_two_runs():
    """The second begins near the top, where the regulator acts; a policy alone answers sixteen states."""
    whole, alone = (loop_test(load_policy(name, "acrobot")) for name in ("adaptive", "ar-eapo"))
    assert (whole.calls, len(whole.actions)) == (16, 32)
    assert (alone.calls, len(alone.actions)) == (1, 16)
    assert np.ptp(whole.actions[:, 1]) > 1.0
