"""The identifier in NumPy inside a controller: what it finds, what it tells, and what a reset forgets."""

import dataclasses
import math

import numpy as np
import pytest

from swingup.loop.effects import late_period
from swingup.loop.loop import Loop
from swingup.plant.base_parameters import base_parameters
from swingup.plant.damped import damped_midpoint_step
from swingup.plant.equations import lump
from swingup.plant.maths import NUMPY
from swingup.policy.estimator.settings import EstimatorSettings
from swingup.policy.identifier import settings
from swingup.policy.identifier.core import elapsed
from swingup.policy.identifier.settings import IdentifierSettings
from swingup.policy.identifier.state import IdentifierState
from swingup.policy.numpy_backend.controller import numpy_controller

from .references import DT, SIGHTED
from .references import policy as of_name

STEPS, FINE = 900, 4


@pytest.fixture(scope="module")
def policy():
    """An untrained one that sees its plant, C.1 as it is."""
    return dataclasses.replace(of_name(SIGHTED), estimator=EstimatorSettings(), identifier=IdentifierSettings())


def changed(plant):
    """Another second link, and other friction."""
    return dataclasses.replace(plant, m2=1.1 * plant.m2, r2=0.93 * plant.r2, I2=1.1 * plant.I2, cf1=0.05, cf2=0.16)


def run(controller, plant, steps=STEPS, periods=None, age=0):
    """The controller's torques on a motion of a plant under a swinging torque, which the controller is told.

    Periods (s) are DT if none are given. Measurements are those of so many calls ago.
    """
    lumped, x, rows = lump(plant), (0.0, 0.0, 0.0, 0.0), []
    past = [x] * (age + 1)
    periods = np.full(steps, DT) if periods is None else periods
    for t, period in zip(np.cumsum(periods) - periods, periods, strict=True):
        past = [x, *past[:-1]]
        rows.append(controller(np.array(past[-1]), t))
        torque = 1.5 * math.sin(6.5 * t) + math.sin(15 * t + 1)
        # As if the policy had commanded it.
        controller.inner.state.identified.torques[0] = 0.0, torque
        controller.inner.state.torques[0] = torque
        for _ in range(FINE):
            x = damped_midpoint_step(lumped, plant.friction, x, (0.0, torque), period / FINE, NUMPY)
    return np.array(rows)


def uneven_periods():
    """The most uneven ones of the domain ``recorded``: up to 3 DT, 5 in 100 longer than the estimator follows."""
    uniform = np.random.default_rng(1).uniform(size=STEPS).astype(np.float32)
    return np.asarray(late_period(Loop(late=0.12, lateness=0.0012), uniform, DT), float)


@pytest.mark.parametrize("clock", ["recorded", "400 Hz"])
def test_it_finds_the_plant_at_other_periods(policy, clock):
    periods = uneven_periods() if clock == "recorded" else np.full(STEPS, 0.0025)
    plant, controller = changed(policy.plant), numpy_controller(policy)
    run(controller, plant, periods=periods)
    true, theta = base_parameters(plant), np.array(controller.inner.found.theta)
    np.testing.assert_allclose(theta[:4], true[:4], rtol=0.02)
    np.testing.assert_allclose(theta[6:8], true[6:8], atol=0.01)
    assert (np.abs(base_parameters(policy.plant) / true - 1)[:4] > 0.015).sum() >= 3
    # Present angles tell no age, also where calls are uneven.
    assert controller.inner.state.identified.age == 0


def test_uneven_calls_tell_the_age_which_makes_late_angles_as_good_as_present_ones(policy, monkeypatch):
    plant, errors, age = changed(policy.plant), [], 3
    for caution in (settings.AGE_CAUTION, math.inf):  # with the second, the age stays 0
        monkeypatch.setattr(settings, "AGE_CAUTION", caution)
        controller = numpy_controller(policy)
        run(controller, plant, periods=uneven_periods(), age=age)
        assert controller.inner.state.identified.age == (0 if caution == math.inf else age)
        errors.append(np.abs(np.array(controller.inner.found.theta) / base_parameters(plant) - 1)[:4].max())
    assert errors[0] < 0.005
    assert errors[1] > 5 * errors[0]


def test_even_calls_tell_no_age(policy):
    """Of even calls an age is a delay like any other."""
    controller = numpy_controller(policy)
    run(controller, changed(policy.plant), age=1)
    assert controller.inner.state.identified.age == 0


def test_old_angles_are_carried_ahead_over_the_time_that_passed():
    """Where calls come late: the time since the angles, not so many of the last call's periods."""
    steps = np.array([0.003, 0.002, 0.004, 0.002])
    for age, expected in ((0, 0.0), (1, 0.0025), (3, 0.0075)):
        state = IdentifierState(*[None] * len(IdentifierState._fields))._replace(age=np.array(age), steps=steps)
        assert elapsed(NUMPY, state, 0.0025) == pytest.approx(expected, abs=1e-15)


def test_a_pause_interrupts(policy):
    """After a longer one the motion before is forgotten; a call that comes too soon is not seen."""
    for pause, calls in ((3.9 * DT, 31), (4.1 * DT, 1), (-DT, 1), (1e-9, 30), (0.61 * DT, 31)):
        controller = numpy_controller(policy)
        run(controller, policy.plant, 30)
        controller(np.zeros(4), 29 * DT + pause)
        state = controller.inner.state.identified
        assert state.calls == calls
        assert 0.5 * DT <= min(state.steps) <= max(state.steps) < 4 * DT
