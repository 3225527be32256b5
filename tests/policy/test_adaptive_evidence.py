"""The evidence for a controller that identifies its plant: plants, variants, and tables with known answers."""

import sys
from pathlib import Path

import numpy as np
import pytest

import swingup
from swingup.benchmark.boards import ROBUSTNESS
from swingup.plant.base_parameters import BASE, BASE_NAMES
from swingup.plant.plant import LEADERBOARD
from swingup.plant.robots import get_robot

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
