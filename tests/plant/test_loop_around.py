"""A plant in the loop of a domain, from one name or two, for every command alike."""

import jax
import pytest

from swingup.loop.domain import load_domain
from swingup.loop.draw import draw
from swingup.loop.on_plant import loop_around
from swingup.plant.robots import get_robot


def values(plant, domain):
    return loop_around(plant, domain).as_dict()


def test_a_domain_alone_and_a_perfect_loop():
    assert loop_around(None, "identified").name == "identified"
    assert values(None, None) == values("C.1", None) == {"plant": "C.1"}


def test_a_small_plant_in_the_loop_of_a_large_one():
    """CloudPendulum's motors have 0.13 of 6 N m; its unit of time is 0.4258 of C.1's (test_task_units.py)."""
    both = loop_around("cloudpendulum", "identified")
    assert both.name == "cloudpendulum in the loop of identified"
    made, torque, time = both.as_dict(), 0.13 / 6, 0.42582
    assert made["plant"] == "cloudpendulum"
    assert "torque_limit" not in made  # the motors' own
    assert made["passive_limit"] == pytest.approx([0.5 * torque] * 2)
    assert made["torque_noise"] == pytest.approx([0.02 * torque] * 2)
    assert made["rate_limit"] == pytest.approx([1500 * torque / time] * 2, rel=1e-4)  # 76.3 N m/s
    assert made["velocity_noise"] == pytest.approx([0.1 / time] * 2, rel=1e-4)
    assert (made["delay"], made["response"], made["ripple_periods"]) == ([0.01] * 2, [0.9] * 2, [36.0] * 2)
    plant, _ = draw(both, jax.random.key(0), get_robot("acrobot"))
    assert float(plant.tl2) == pytest.approx(0.13)


def test_units_are_relative_to_the_domains_own_plant():
    """The loop of a CloudPendulum's cell is at home around its plant."""
    cells = load_domain("cells").as_dict()
    made = values("cloudpendulum-rods", "cells")
    assert made["velocity_noise"] == pytest.approx(cells["velocity_noise"], rel=1e-12)
    assert made["velocities"] == "driver"
    assert "m1" not in made  # the ranges of the domain's own plant have no effect
    assert values("C.1", "cells")["velocity_noise"][0] < 0.5 * cells["velocity_noise"][0]


def test_the_plants_file_has_the_last_word_on_its_loop(tmp_path):
    file = tmp_path / "mine.yml"
    file.write_text("plant: C.1\ncf1: 0.1\ntl2: 6\ndelay: 0.004\n")
    made = values(str(file), "identified")
    assert (made["cf1"], made["delay"], made["passive_limit"]) == ([0.1, 0.1], [0.004, 0.004], [0.5, 0.5])
    file.write_text("plant: C.1\ntorque_limit: 3\n")
    assert values(str(file), "identified")["torque_limit"] == [3.0, 3.0]
