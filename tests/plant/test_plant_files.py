"""One file format: facts are a plant and a domain, ranges a domain alone; a file may start from another plant."""

import dataclasses

import jax
import pytest
import yaml

from swingup.common.errors import SwingupError
from swingup.loop.domain import load_domain, make_domain
from swingup.loop.draw import draw
from swingup.plant.plant import NAMES, load_plant
from swingup.plant.robots import get_robot

PENDUBOT = get_robot("pendubot")


def drawn(domain, robot=PENDUBOT):
    with jax.enable_x64(True):
        return draw(domain, jax.random.key(0), robot)


@pytest.fixture
def facts(tmp_path):
    """A file of facts with motors of 2 and 3 N m."""
    plant = dataclasses.replace(load_plant("B.0"), tl1=2.0, tl2=3.0)
    (tmp_path / "facts.yml").write_text(yaml.safe_dump(plant.values()))
    return tmp_path / "facts.yml"


def test_a_file_of_facts_is_a_plant_and_a_domain(facts):
    plant, (found, _) = load_plant(facts), drawn(load_domain(facts))
    same = [name for name in NAMES if float(getattr(found, name)) == getattr(plant, name)]
    assert [name for name in NAMES if name not in same] == ["tl2"]  # the passive motor of the pendubot rests
    assert (float(found.tl1), float(found.tl2)) == (2.0, 0.0)
    assert float(drawn(load_domain(facts), get_robot("acrobot"))[0].tl2) == 3.0


def test_a_file_may_start_from_another_plant(tmp_path, facts):
    (tmp_path / "mine.yml").write_text("plant: facts.yml\nm1: 0.7\ndelay: 0.004\n")
    (tmp_path / "wide.yml").write_text("plant: B.0\nm1: [0.6, 0.7]\npassive_limit: 0.5\n")
    mine, wide = load_domain(tmp_path / "mine.yml"), load_domain(tmp_path / "wide.yml")
    assert load_plant(tmp_path / "mine.yml").m1 == 0.7
    for domain, limit in ((mine, 2.0), (wide, 6.0)):
        plant = drawn(domain)[0]
        assert (float(plant.l2), float(plant.tl1)) == (0.4, limit)  # B.0's second link
    assert (mine.nominal_plant.m1, wide.nominal_plant.m1, wide.nominal_plant.r1) == pytest.approx((0.7, 0.65, 0.3))
    assert wide.as_dict() == {"plant": "B.0", "m1": [0.6, 0.7], "passive_limit": [0.5, 0.5]}
    assert hash(wide) == hash(load_domain(tmp_path / "wide.yml"))


def test_a_shipped_plant_is_a_domain():
    plant = drawn(load_domain("A.0"))[0]
    assert (float(plant.m1), float(plant.tl1)) == (load_plant("A.0").m1, 6.0)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("plant: B.0\nm1: [0.6, 0.7]", r"m1 = \[0.6, 0.7\] is a range, and a plant has facts: give one value, or"),
        ("plant: B.9", "plant = 'B.9' is no plant: use A.0, B.0"),
        ("plant: part.yml\nm1: 0.5", "part.yml lacks m2, l1"),
        ("plant: B.0\nm1: -1", "m1 = -1 must be positive"),
    ],
)
def test_files_that_are_no_plant(tmp_path, content, message):
    (tmp_path / "part.yml").write_text("m1: 0.5\n")
    path = tmp_path / "mine.yml"
    path.write_text(content)
    with pytest.raises(SwingupError, match=message) as error:
        load_plant(path)
    assert "\n" not in str(error.value)


def test_files_that_are_no_domain():
    for content, message in [
        ({"plant": "B.9"}, "plant = 'B.9' is no plant"),
        ({"plant": 3}, "plant = 3 is no plant"),
        ({"plant": "cloudpendulum", "I1": [1e-6, 1e-4], "m2": [0.076, 0.4]}, "matrix is not positive definite"),
        ({"plant": "C.1", "velocities": "guessed"}, "unknown velocities 'guessed'"),
    ]:
        with pytest.raises(SwingupError, match=message):
            make_domain(content)


def test_a_domain_with_all_of_a_plants_values_has_that_plant():
    """Its plant is the middle of the ranges."""
    values = load_plant("B.0").values()
    domain = make_domain({**values, "m1": [0.6, 0.8], "delay": 0.002}, "mine.yml")
    assert domain.plant.name == "mine.yml"
    assert domain.plant.values() == {**values, "m1": pytest.approx(0.7)}


def test_a_domain_with_all_of_a_plants_values_needs_its_motors_limits_as_well():
    values = {
        name: value for name, value in load_plant("cloudpendulum").values().items() if name not in ("tl1", "tl2")
    }
    with pytest.raises(SwingupError, match=r"domain mine\.yml lacks tl1, tl2: add them in SI units"):
        make_domain(values, "mine.yml")
    assert make_domain({**values, "torque_limit": 0.13}, "mine.yml").plant == load_plant("cloudpendulum")
