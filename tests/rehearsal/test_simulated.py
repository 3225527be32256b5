"""Plant and loop of a rehearsal, from one name or two."""

import pytest

from swingup.errors import SwingupError
from swingup.rehearsal.simulated import simulated_robot
from swingup.robots import get_robot

ACROBOT = get_robot("acrobot")


def values(plant, domain, robot=ACROBOT):
    return simulated_robot(plant, domain, robot).as_dict()


def test_a_domain_alone_and_a_perfect_loop():
    assert simulated_robot(None, "identified", ACROBOT).name == "identified"
    assert values(None, None) == {}
    assert values("C.1", None) == {"plant": "C.1", "torque_limit": [6.0, 6.0]}


def test_a_plant_with_weak_motors_in_the_loop_of_strong_ones():
    both = simulated_robot("cloudpendulum", "identified", ACROBOT)
    assert both.name == "cloudpendulum in the loop of identified"
    made = both.as_dict()
    weak = made["torque_limit"][0]
    assert weak < 1.0
    # identified.yml: 6 N m on the driven joint, 0.5 on the passive one, noise of 0.02; 10 ms and 0.1 rad/s stay.
    assert made["passive_limit"] == pytest.approx([0.5 * weak / 6] * 2)
    assert made["torque_noise"] == pytest.approx([0.02 * weak / 6] * 2)
    assert made["delay"] == [0.01, 0.01]
    assert made["velocity_noise"] == [0.1, 0.1]


def test_the_plants_file_has_the_last_word_on_its_loop(tmp_path):
    file = tmp_path / "mine.yml"
    file.write_text("plant: C.1\ncf1: 0.1\ntl2: 10\ndelay: 0.004\n")
    made = values(str(file), "identified")
    assert made["cf1"] == [0.1, 0.1]
    assert made["delay"] == [0.004, 0.004]
    # Motors of 10 N m, of which the loop asks 6.
    assert made["torque_limit"] == [6.0, 6.0]
    assert made["passive_limit"] == [0.5, 0.5]
    assert "torque_limit" in values(str(file), None)
    file.write_text("plant: C.1\ntorque_limit: 3\n")
    assert values(str(file), "identified")["torque_limit"] == [3.0, 3.0]


def test_unknown_names():
    with pytest.raises(SwingupError, match=r"unknown plant 'C\.2'"):
        simulated_robot("C.2", None, ACROBOT)
    with pytest.raises(SwingupError, match="unknown domain 'idenfied'"):
        simulated_robot("C.1", "idenfied", ACROBOT)
