"""The identifier in the C header beyond the conformance table: beside NumPy's, in single precision, its reset."""

import functools

import numpy as np
import pytest

from swingup.export.c_backend.header import c_header
from swingup.plant.base_parameters import base_parameters
from swingup.plant.damped import damped_midpoint_step
from swingup.plant.equations import lump
from swingup.plant.maths import NUMPY
from swingup.plant.plant import LEADERBOARD
from swingup.policy.numpy_backend.controller import numpy_controller
from swingup.policy.numpy_backend.network import NumpyNetwork

from .compiled import compile_program, needs_gcc, pointer, torques
from .references import DT, IDENTIFIED, faults, policy, random_states

pytestmark = needs_gcc

DRIVER = """
#include "policy.h"

void torques(int n, const double *x, double *u);
void run(int n, const double *t, const double *x, const double *given, double *u, double *base);

void torques(int n, const double *x, double *u)
{
    int k;
    for (k = 0; k < n; k++) {
        u[k] = swingup_policy(x + 4 * k);
    }
}

void run(int n, const double *t, const double *x, const double *given, double *u, double *base)
{
    static swingup_controller controller;
    int k, i;
    swingup_reset(&controller);
    for (k = 0; k <= n; k++) {
        for (i = 0; i < 9; i++) {
            base[9 * k + i] = swingup_base_parameters(&controller)[i];
        }
        if (k < n) {
            swingup_control(&controller, t[k], x + 4 * k, u + 2 * k);
            for (i = 0; i < 2; i++) {
                controller.estimator.identifier.torques[0][i] = given[2 * k + i];
            }
            controller.estimator.torques[0] = given[2 * k + SWINGUP_DRIVEN];
        }
    }
}
"""
PROBABILITIES = [0.01, 0.1, 0.7, 0.15, 0.02, 0.01, 0.01]
OTHER = LEADERBOARD.driven(policy(IDENTIFIED).robot)
"""The plant that is found; the file's has friction and rotors."""


@functools.cache
def motion(steps=900):
    """Times (n,) and measurements (n, 4) of a loop with that plant; NumPy's torques (n, 2) and θ (n, 9)."""
    controller, random, x = numpy_controller(policy(IDENTIFIED)), np.random.default_rng(0), (0.0,) * 4
    rows = []
    for k in range(steps):
        measured = np.array(x) + random.normal(size=4) * [0, 0, 0.2, 0.2]
        rows.append((k * DT, measured, *answer(controller, measured, k * DT)))
        x = damped_midpoint_step(lump(OTHER), OTHER.friction, x, rows[-1][2].tolist(), DT, NUMPY)
    return [np.array(column) for column in zip(*rows, strict=True)]


def answer(controller, x, t):
    """Torques, and θ after the call."""
    return controller(x, t), np.array(controller.inner.found.theta)


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return made(tmp_path_factory.mktemp("c"))


def made(folder, *flags):
    (folder / "policy.h").write_text(c_header(policy(IDENTIFIED)), encoding="utf-8")
    return compile_program(folder, DRIVER, *flags)


def run(library, times, states, given):
    """Torques (n, 2) from a reset on, and θ (n + 1, 9) before the first and after each call.

    The motors are given NumPy's torques: see ``follow`` in ``backends.py``.
    """
    limit, driven = policy(IDENTIFIED).torque_limits, policy(IDENTIFIED).robot.joint
    given = np.clip(given, *(side * np.where(np.arange(2) == driven, limit[driven], np.inf) for side in (-1, 1)))
    u, base = np.empty((len(states), 2)), np.empty((len(states) + 1, 9))
    library.run(len(states), *map(pointer, (times, np.ascontiguousarray(states), given, u, base)))
    return u, base


def test_it_finds_what_numpy_finds(library):
    times, states, expected, theta = motion()
    u, base = run(library, times, states, expected)
    np.testing.assert_allclose(u, expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(base[1:], theta, rtol=0, atol=1e-10)
    start, true = base_parameters(policy(IDENTIFIED).plant), base_parameters(OTHER)
    np.testing.assert_array_equal(base[0], start)
    np.testing.assert_allclose(base[-1, :4], true[:4], rtol=0.01)
    assert np.abs(start - true)[4:8].max() > 0.1
    np.testing.assert_allclose(base[-1, 4:8], true[4:8], atol=0.01)


def test_faults_do_as_in_numpy(library):
    """A pause, a clock set back, a jump, and what is not finite, after a motion; then the motion goes on."""
    (times, states, *_), (later, broken) = motion(), faults()
    times = np.concatenate([times, times[-1] + DT + later, times[-1] + 1 + times[:200]])
    states = np.concatenate([states, broken, states[-200:]])
    states[300, 0] = 1e7
    controller = numpy_controller(policy(IDENTIFIED))
    expected, theta = map(np.array, zip(*map(functools.partial(answer, controller), states, times), strict=True))
    u, base = run(library, times, states, expected)
    driven = policy(IDENTIFIED).robot.joint
    np.testing.assert_allclose(u[:, driven], expected[:, driven], rtol=0, atol=1e-9)
    np.testing.assert_allclose(base[1:], theta, rtol=0, atol=1e-9)
    assert np.isfinite(base).all()
    assert np.isnan(u).any()


def test_with_an_uneven_clock_as_in_numpy(library):
    """Periods from almost none to more than the estimator, and than the identifier, follow."""
    _, states, *_ = motion()
    ratios = np.random.default_rng(0).choice([1e-6, 0.7, 1.0, 1.2, 1.7, 3.5, 4.5], len(states), p=PROBABILITIES)
    times, controller = np.cumsum(ratios) * DT, numpy_controller(policy(IDENTIFIED))
    expected, theta = map(np.array, zip(*map(functools.partial(answer, controller), states, times), strict=True))
    u, base = run(library, times, states, expected)
    np.testing.assert_allclose(u, expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(base[1:], theta, rtol=0, atol=1e-9)
    assert np.abs(base[-1] - base[0]).max() > 0.01


def test_in_single_precision_it_finds_the_same(library, tmp_path):
    """The network alone is in single precision: what it commands differs a little."""
    times, states, expected, theta = motion()
    u, base = run(made(tmp_path, "-DSWINGUP_REAL=float"), times, states, expected)
    assert 1e-7 < np.abs(u - expected).max() < 1e-3
    np.testing.assert_allclose(base[1:], theta, rtol=0, atol=1e-4)


def test_the_policy_alone_is_for_the_plant_of_its_file(library):
    states = np.ascontiguousarray(random_states()[:200])
    expected = list(map(NumpyNetwork(policy(IDENTIFIED)), states))
    np.testing.assert_allclose(torques(library, states), expected, rtol=0, atol=1e-11)


def test_a_reset_forgets_what_was_found(library):
    """The driver keeps one controller: the second run begins with what the first one left."""
    times, states, expected, _ = motion()
    first, again = run(library, times, states, expected), run(library, times, states, expected)
    assert np.abs(first[1][-1] - first[1][0]).max() > 0.01
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one, other)
