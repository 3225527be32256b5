"""The front end in NumPy, C and ONNX against JAX, call by call."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo.networks import init_actor
from swingup.control.registry import get_controller, has_estimator
from swingup.errors import SwingupError
from swingup.physics.parameters import get_robot
from swingup.policy.c_backend.header import c_header
from swingup.policy.jax_backend.controller import PolicyController, load_policy, save_controller
from swingup.policy.jax_backend.front_end import FrontEnd
from swingup.policy.jax_backend.observation import Normalise, PendulumObservation
from swingup.policy.jax_backend.policy import Policy
from swingup.policy.numpy_backend.controller import RuntimeController, load_controller
from swingup.policy.settings import FrontEndSettings
from swingup.policy.shipped import read_policy

from .compiled import compile_header, needs_gcc, run
from .loops import DT, TOLERANCE
from .test_onnx import session

FRONT_ENDS = {
    # Settings, past torques, earlier states, encoding of the angles.
    "plain": (FrontEndSettings(), 0, 0, "sincos"),
    "filter and friction": (FrontEndSettings(velocity_weight=0.2, dead_band=0.1, damping=(0.01, 0.02),
                                             coulomb=(0.16, 0.12)), 2, 0, "sincos"),
    "history": (FrontEndSettings(velocity_weight=0.5, spacing=3, coulomb=(0.9, 0.9)), 0, 2, "wrapped"),
    "all": (FrontEndSettings(velocity_weight=0.3, spacing=4, coulomb=(0.1, 0.1),
                             passive_limit=0.05), 3, 2, "sincos"),
}  # fmt: skip


def small_policy(name, robot="pendubot"):
    """An untrained policy behind one of the front ends."""
    settings, torques, history, angles = FRONT_ENDS[name]
    observation = PendulumObservation(angles=angles, torques=torques, history=history)
    size = observation.size
    with jax.enable_x64(False):  # single precision, as a file has it
        actor = jax.tree.map(lambda leaf: leaf + 0.1, init_actor(jax.random.key(0), size, 1, (16, 12), -1.0))
    normalise = Normalise(mean=np.linspace(-1, 1, size), variance=np.linspace(0.5, 2, size))
    policy = Policy((observation, normalise), actor)
    return PolicyController(policy, 3.0, get_robot(robot), FrontEnd(settings, torques, history))


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


@needs_gcc
@pytest.mark.parametrize("name", FRONT_ENDS)
def test_c_is_numpy(name, tmp_path):
    save_controller(tmp_path / "p.npz", small_policy(name), {})
    policy = read_policy(tmp_path / "p.npz")
    library, controller = compile_header(tmp_path, c_header(policy)), RuntimeController(policy)
    times, x = measurements()
    expected = [controller(each, t) for t, each in zip(times, x, strict=True)]
    np.testing.assert_allclose(run(library, times, x), expected, rtol=0, atol=1e-12)


def test_the_graph_takes_what_the_front_end_shows(tmp_path):
    save_controller(tmp_path / "p.npz", small_policy("all"), {})
    policy = read_policy(tmp_path / "p.npz")
    shown = np.random.default_rng(2).normal(size=(50, policy.stage.input_size))
    assert shown.shape[1] == 4 + 3 + 8
    expected = [RuntimeController(policy)._act(each) for each in shown]
    found = session(policy).run(None, {"state": shown})[0]
    np.testing.assert_allclose(found[:, 0], expected, rtol=0, atol=TOLERANCE)


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


@needs_gcc
def test_behind_an_estimator_in_c(tmp_path):
    save_controller(tmp_path / "p.npz", small_policy("all"), {"estimator": {}})
    policy = read_policy(tmp_path / "p.npz")
    library, controller = compile_header(tmp_path, c_header(policy)), RuntimeController(policy)
    times, x = measurements()
    expected = [controller(each, t) for t, each in zip(times, x, strict=True)]
    np.testing.assert_allclose(run(library, times, x), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("front_end", "message"),
    [
        (3, "front_end 3 is no object of settings: use {} for the defaults"),
        ({"nothing": 1}, "unknown front_end setting 'nothing': use some of dt, velocity_weight"),
        ({"velocity_weight": 0}, "velocity_weight = 0: a number of 1e-06 to 1 is needed"),
        ({"spacing": 1.5}, "spacing = 1.5: a whole number of 1 to 1000 is needed"),
        ({"damping": [1]}, r"damping = \[1\]: two numbers of 0 to 10 are needed"),
        ({"coulomb": "ab"}, "coulomb = 'ab': two numbers of 0 to 10 are needed"),
        ({"dead_band": True}, "dead_band = True: a number of 0 to 10 is needed"),
    ],
)
def test_bad_settings_in_a_file(tmp_path, front_end, message):
    plain = dataclasses.replace(small_policy("plain"), front_end=None)
    save_controller(tmp_path / "p.npz", plain, {"front_end": front_end})
    with pytest.raises(SwingupError, match=message):
        load_policy(tmp_path / "p.npz")


@pytest.mark.parametrize("robot", [["acrobot"], "cart", None])
def test_a_file_for_no_robot(tmp_path, robot):
    save_controller(tmp_path / "p.npz", small_policy("plain"), {"robot": robot})
    with pytest.raises(SwingupError, match=r"policy file .*p\.npz is for robot .*: acrobot or pendubot is needed"):
        load_policy(tmp_path / "p.npz")


def test_a_memory_needs_a_front_end(tmp_path):
    save_controller(tmp_path / "none.npz", dataclasses.replace(small_policy("all"), front_end=None), {})
    with pytest.raises(SwingupError, match="'pendulum' asks for a memory: name its front_end"):
        load_policy(tmp_path / "none.npz")
