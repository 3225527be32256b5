"""The C header: it compiles without a warning, and its torques and its estimator are the judge's."""

import re

import numpy as np
import pytest

from swingup.physics.parameters import get_robot
from swingup.policy.c_backend.header import c_header
from swingup.policy.jax_backend.controller import save_controller
from swingup.policy.numpy_backend.controller import RuntimeController
from swingup.policy.numpy_backend.network import NumpyPolicy
from swingup.policy.shipped import read_policy

from .compiled import compile_header, compile_program, needs_gcc, pointer, run, torques
from .loops import DT, SENSORS, UNSOUND, judged_torques, paper_policy, random_states, recorded

pytestmark = needs_gcc
ROBOT_NAMES = ("acrobot", "pendubot")


@pytest.fixture(scope="module", params=ROBOT_NAMES)
def shipped(request, tmp_path_factory):
    """A robot's name and the shipped policy's library."""
    policy = read_policy("refined", request.param)
    return request.param, compile_header(tmp_path_factory.mktemp("c"), c_header(policy))


def test_torques_are_the_judges(shipped):
    name, library = shipped
    np.testing.assert_allclose(
        torques(library, random_states()), judged_torques(name, exact=True), rtol=0, atol=1e-11
    )


def test_in_single_precision(tmp_path):
    library = compile_header(tmp_path, c_header(read_policy("refined", "acrobot")), "-DSWINGUP_REAL=float")
    error = np.abs(torques(library, random_states()) - judged_torques("acrobot", exact=True)).max()
    assert 1e-6 < error < 1e-4


@pytest.mark.parametrize("sensor", SENSORS)
def test_the_estimator_follows_a_recorded_run(shipped, sensor):
    name, library = shipped
    times, measured, expected = recorded(name, sensor)
    u = run(library, times, np.ascontiguousarray(measured))
    np.testing.assert_allclose(u, expected, rtol=0, atol=1e-9)
    assert not u[:, 1 - get_robot(name).joint].any()


def test_pauses_jumps_and_what_is_not_finite(shipped):
    name, library = shipped
    random = np.random.default_rng(0)
    x = np.cumsum(random.normal(size=(60, 4)) * [5e-4, 5e-4, 0.1, 0.1], axis=0) + np.array([0.3, 0.2, 0, 0])
    times = DT * np.arange(60)
    times[20:] += 0.01  # a pause
    times[30:] -= 0.05  # a clock set back
    x[40:, 1] += 1.0  # a jump
    x[45], x[48], x[51, 2] = np.nan, np.inf, 1e200
    controller = RuntimeController(read_policy("refined", name))
    expected = [controller(*each) for each in zip(x, times, strict=True)]
    np.testing.assert_allclose(run(library, times, x), expected, rtol=0, atol=1e-9)
    torques = run(library, np.zeros(len(UNSOUND)), UNSOUND)
    assert np.isnan(torques[:, get_robot(name).joint]).all()


@pytest.mark.parametrize("normalised", [True, False])
def test_the_papers_observation_without_an_estimator(tmp_path, normalised):
    save_controller(tmp_path / "p.npz", paper_policy(normalised), {})
    policy = read_policy(tmp_path / "p.npz")
    library = compile_header(tmp_path, c_header(policy))
    states, controller = random_states()[:500], RuntimeController(policy)
    expected = np.array([controller(x, 0.0) for x in states])
    np.testing.assert_allclose(run(library, np.zeros(500), states), expected, rtol=0, atol=1e-12)


def test_numbers_are_the_files(shipped):
    """The header's decimals are the file's float32 numbers, input by input."""
    name, _ = shipped
    policy = read_policy("refined", name)
    text = c_header(policy)
    for index, layer in enumerate(policy.file.layers):
        body = re.search(rf"swingup_weight_{index}\[\d+\]\[\d+\] = {{(.*?)}};", text, re.DOTALL)[1]
        numbers = np.array(re.findall(r"[-+\d.e]+(?=f)", body), np.float32)
        np.testing.assert_array_equal(numbers.reshape(layer.weight.T.shape), layer.weight.T)
    assert "@" not in text
    assert "malloc" not in text
    assert set(re.findall(r"#include (.*)", text)) == {"<math.h>"}


TWO = """
#include "left.h"
#include "right.h"

void both(const double *x, double *u);

void both(const double *x, double *u)
{
    u[0] = left_policy(x);
    u[1] = right_policy(x);
}
"""


def test_two_policies_in_one_program(tmp_path):
    policies = [read_policy("refined", name) for name in ("acrobot", "pendubot")]
    for policy, name in zip(policies, ("left", "right"), strict=True):
        (tmp_path / f"{name}.h").write_text(c_header(policy, name))
    library, u = compile_program(tmp_path, TWO), np.zeros(2)
    for x in random_states()[:5]:
        library.both(pointer(np.ascontiguousarray(x)), pointer(u))
        np.testing.assert_allclose(u, [NumpyPolicy(policy)(x) for policy in policies], rtol=0, atol=1e-11)
