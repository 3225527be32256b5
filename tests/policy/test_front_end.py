"""The front end in NumPy against JAX, call by call."""

import contextlib
import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo.networks import init_actor
from swingup.control.registry import get_controller, has_estimator
from swingup.errors import SwingupError
from swingup.physics.parameters import get_robot
from swingup.policy.file import write_network
from swingup.policy.jax_backend.controller import PolicyController, load_policy, policy_of, save_controller
from swingup.policy.jax_backend.front_end import FrontEnd
from swingup.policy.jax_backend.observation import Normalise, PendulumObservation
from swingup.policy.jax_backend.policy import Policy
from swingup.policy.numpy_backend.controller import load_controller
from swingup.policy.settings import FrontEndSettings

from .references import DT

FRONT_ENDS = {
    # Settings and encoding of the angles.
    "plain": (FrontEndSettings(), "sincos"),
    "filter and friction": (FrontEndSettings(velocity_weight=0.2, dead_band=0.1, damping=(0.01, 0.02),
                                             coulomb=(0.16, 0.12)), "sincos"),
    "limited": (FrontEndSettings(velocity_weight=0.5, coulomb=(0.9, 0.9)), "wrapped"),
    "all": (FrontEndSettings(velocity_weight=0.3, dead_band=0.05, damping=(0.01, 0.01), coulomb=(0.1, 0.1),
                             passive_limit=0.05), "sincos"),
}  # fmt: skip


def small_policy(name, robot="pendubot"):
    """An untrained policy behind one of the front ends."""
    settings, angles = FRONT_ENDS[name]
    observation = PendulumObservation(angles=angles)
    size = observation.size
    with jax.enable_x64(False):  # single precision, as a file has it
        actor = jax.tree.map(lambda leaf: leaf + 0.1, init_actor(jax.random.key(0), size, 1, (16, 12), -1.0))
    normalise = Normalise(mean=np.linspace(-1, 1, size), variance=np.linspace(0.5, 2, size))
    policy = Policy((observation, normalise), actor)
    return PolicyController(policy, 3.0, get_robot(robot), FrontEnd(settings))


def measurements():
    """Times and measurements with noise, a pause, a clock set back, and some that are not finite."""
    random, steps = np.random.default_rng(0), 80
    x = np.cumsum(random.normal(size=(steps, 4)) * [5e-3, 5e-3, 0.1, 0.1], axis=0) + np.array([3.0, 0.2, 0, 0])
    times = DT * np.arange(steps)
    times[30:] += 0.01
    times[40:] -= 0.05
    x[50], x[55, 1], x[60, 2] = np.nan, np.inf, np.nan
    return times, x


def answers_of_jax(controller, times, x):
    call, memory, rows = jax.jit(lambda *given: controller(*given)), controller.init(), []
    for t, each in zip(times, x, strict=True):
        memory, u = call(memory, jnp.asarray(t), jnp.asarray(each))
        rows.append(u)
    return np.array(rows)


@pytest.mark.parametrize("name", FRONT_ENDS)
def test_numpy_is_jax(name, tmp_path, x64):
    save_controller(tmp_path / "p.npz", small_policy(name), {})
    reference, controller = load_policy(tmp_path / "p.npz")[0], load_controller(tmp_path / "p.npz")
    times, x = measurements()
    expected = answers_of_jax(reference, times, x)
    assert np.isnan(expected).any(axis=1).nonzero()[0].tolist() == [50, 55, 60]
    for _ in range(2):  # the second time after a reset
        found = np.array([controller(each, t) for t, each in zip(times, x, strict=True)])
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
        controller.reset()
    passive = expected[np.isfinite(expected[:, 1]), 1]
    assert bool(passive.any()) == (name != "plain")
    assert np.abs(passive).max() <= FRONT_ENDS[name][0].passive_limit


@pytest.mark.slow  # compiles for seconds
def test_behind_an_estimator(tmp_path, x64):
    """Both may be asked for together: the front end then sees the estimate."""
    save_controller(tmp_path / "p.npz", small_policy("all"), {"estimator": {}})
    path = str(tmp_path / "p.npz")
    times, x = measurements()
    controller = load_controller(path)
    found = np.array([controller(each, t) for t, each in zip(times, x, strict=True)])
    expected = answers_of_jax(get_controller(path, "pendubot"), times, x)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert has_estimator(get_controller(path, "pendubot"))


@pytest.mark.parametrize(
    ("front_end", "message"),
    [
        (3, "front_end 3 is no object of settings: use {} for the defaults"),
        ({"nothing": 1}, "unknown front_end setting 'nothing': use some of dt, velocity_weight"),
        ({"velocity_weight": 0}, "velocity_weight = 0: use a number from 1e-06 to 1"),
        ({"velocity_weigth": 1}, "did you mean velocity_weight?"),
        ({"damping": [1]}, r"damping = \[1\]: use two numbers, for shoulder and elbow"),
        ({"damping": [1, 11]}, "damping = 11: use a number from 0 to 10"),
        ({"coulomb": "ab"}, "coulomb = 'ab': use two numbers, for shoulder and elbow"),
        ({"dead_band": True}, "dead_band = True: use a number from 0 to 10"),
    ],
)
def test_bad_settings_in_a_file(tmp_path, front_end, message):
    plain = dataclasses.replace(small_policy("plain"), front_end=None)
    save_controller(tmp_path / "p.npz", plain, {"front_end": front_end})
    with pytest.raises(SwingupError, match=message):
        load_policy(tmp_path / "p.npz")


@pytest.mark.parametrize("robot", [["acrobot"], "cart", None])
def test_a_file_for_no_robot(tmp_path, robot):
    network = policy_of(small_policy("plain")).network
    write_network(tmp_path / "p.npz", network, {"robot": robot, "torque_limit": 6.0})
    with pytest.raises(SwingupError, match=r"policy file .*p\.npz is for robot .*: acrobot or pendubot is needed"):
        load_policy(tmp_path / "p.npz")


@pytest.mark.parametrize("past", ["torques", "history"])
def test_the_past_of_former_files(tmp_path, past):
    """Files say 0 where their policy was shown no past; one that was cannot be run any more."""
    save_controller(tmp_path / "p.npz", small_policy("plain"), {})
    former = {"spacing": 5}
    for count, context in (
        (0, contextlib.nullcontext()),
        (2, pytest.raises(SwingupError, match=f"sees past {past}")),
    ):
        stages = [{"name": "pendulum", "angles": "sincos", past: count}, {"name": "normalise"}]
        change_metadata(tmp_path / "p.npz", observation=stages, front_end=former)
        with context:
            assert load_policy(tmp_path / "p.npz")[0].front_end.settings == FrontEndSettings()


def change_metadata(path, **changes):
    """Replace entries of a file's metadata."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    text = json.dumps(json.loads(bytes(arrays.pop("metadata"))) | changes)
    np.savez(path, metadata=np.frombuffer(text.encode(), np.uint8), **arrays)
