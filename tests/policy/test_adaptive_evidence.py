"""The evidence for a controller that identifies its plant: plants, variants, and tables with known answers."""

import dataclasses
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import swingup
from swingup.benchmark.boards import ROBUSTNESS
from swingup.controllers.stack.controller import policy_of
from swingup.controllers.stack.maths import JAX
from swingup.plant.base_parameters import BASE, BASE_NAMES
from swingup.plant.plant import LEADERBOARD
from swingup.plant.robots import get_robot
from swingup.policy.estimator.settings import EstimatorSettings
from swingup.policy.identifier import core as identifier
from swingup.policy.identifier.settings import IdentifierSettings
from swingup.policy.regulator.settings import RegulatorSettings

from .references import sighted_policy

BENCHMARKS = Path(swingup.__file__).parents[2] / "benchmarks"
RULES = ROBUSTNESS
SWEEPS = RULES.model

pytestmark = pytest.mark.skipif(not BENCHMARKS.is_dir(), reason="the scripts are only in a checkout")


@pytest.fixture
def scripts(monkeypatch):
    """The scripts' modules by what follows `adaptive` in their names."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    parts = ("plants", "errors", "boards", "failing", "seeds")
    names = ("adaptive", *(f"adaptive_{part}" for part in parts), "upper_bound")
    yield {name.removeprefix("adaptive_"): __import__(name) for name in names}
    for name in names:
        sys.modules.pop(name, None)


def full_policy():
    """Estimator, identifier and regulator around a policy that sees its plant."""
    around = {
        "estimator": EstimatorSettings(),
        "identifier": IdentifierSettings(),
        "regulator": RegulatorSettings(),
    }
    return dataclasses.replace(policy_of(sighted_policy()), **around)


def test_joint_draws_are_off_in_all_parameters_within_half_the_ranges(scripts):
    cases = scripts["plants"].joint_cases(get_robot("acrobot"), RULES)
    nominal = LEADERBOARD.driven(get_robot("acrobot"))
    assert len(cases) == 200
    plants = [case.scenario.parameters for case in cases]
    for names, least, most in (
        (("I1", "I2", "m2", "r1", "r2"), 0.875, 1.125),
        (("b1", "b2"), -0.05, 0.05),
        (("cf1", "cf2"), -0.1, 0.1),
        (("Ir",), 0.0, 5e-5),
    ):
        for name in names:
            drawn = np.array([getattr(plant, name) for plant in plants]) / (getattr(nominal, name) or 1.0)
            assert least <= drawn.min() < drawn.max() <= most
            assert len(set(drawn)) == 200
            assert drawn.max() - drawn.min() > 0.9 * (most - least)
    again = scripts["plants"].joint_cases(get_robot("acrobot"), RULES)
    assert [case.settings for case in again] == [case.settings for case in cases]


@pytest.mark.slow  # compiles for seconds
def test_a_controller_is_told_the_whole_plant(scripts):
    plants = scripts["plants"]
    robot = full_policy().robot
    plant = dataclasses.replace(LEADERBOARD.driven(robot), b1=-0.05, cf2=0.1, I2=0.06)
    with jax.enable_x64(True):
        loop = plants.tell_everything(plants.make_variants(full_policy())[plants.TOLD], plant).loop.finding
        memory = identifier.begin(JAX, loop)
        for angle in np.random.default_rng(0).normal(size=60):
            memory = identifier.observe(JAX, loop, memory, jnp.array([angle, 0.0]), jnp.array(0), jnp.array(0.002))
        # Whatever is measured: inertias, the friction that drives, and none where the motor compensates it.
        found = identifier.found(JAX, loop, memory)
        assert np.array(found.theta)[[1, 4, 7]] == pytest.approx([0.06, -0.05, 0.1])
        assert np.array(found.told)[[4, 7]] == pytest.approx([-0.05, 0.0])
        assert np.array(found.asked)[:, 1] == pytest.approx([0.0, 0.1])


@pytest.mark.slow
def test_the_optimum_of_a_plant_is_held_and_scored(scripts):
    robot = get_robot("pendubot")
    every = scripts["plants"].plant_sets(robot, RULES)["grid"]
    cases = [case for case in every if case.settings["parameter"] == "m2"]
    (found,) = scripts["failing"].optima(robot, [cases[10]], RULES)
    # The middle of the sweep is the nominal plant; its shipped swing-up scores 0.697 with its own regulator.
    assert cases[10].settings["value"] == pytest.approx(1.0)
    assert found.reached
    assert found.held
    assert found.score == pytest.approx(0.69, abs=0.02)


def test_errors_are_relative_to_the_value_or_the_range(scripts, tmp_path):
    errors = scripts["errors"]
    true = np.tile([0.1, 0.05, 0.2, 0.2, 0.0, 0.05, 0.0, -0.1, 0.0], (3, 1))
    found = np.repeat(true[:, None], 1501, axis=1)
    found[:, 500, 0] += [0.001, 0.002, -0.003]  # of 0.1
    found[:, 500, 5] += [0.001, 0.001, 0.001]  # of the range 0.1
    time, bands = 0.002 * np.arange(1501), errors.error_bands(found, true)
    assert bands.shape == (3, 1501, BASE)
    lines = {line[0].split(",")[0]: line for line in errors.error_lines(time, bands)}
    # Percentiles interpolate: 5 % lies a tenth of the way from the least to the middle one.
    assert lines["A"] == ["A, % of its value", "0.0 (0.0 to 0.0)", "2.0 (1.1 to 2.9)", "0.0 (0.0 to 0.0)"]
    assert lines["b2"][0] == "b2, % of 0.1 N m s/rad"
    assert lines["b2"][2] == "1.0 (1.0 to 1.0)"
    at_1_s = [row for row in errors.error_rows(time, bands) if row["time"] == 1.0]
    assert [row["parameter"] for row in at_1_s] == list(BASE_NAMES)
    assert at_1_s[0]["median"] == pytest.approx(2.0)
