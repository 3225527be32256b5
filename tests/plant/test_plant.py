import dataclasses

import pytest

from swingup.common.errors import SwingupError
from swingup.plant.plant import LEADERBOARD, SHIPPED_PLANTS, load_plant


def gravity_torque(p):
    """Torque that holds the stretched pendulum level (N m)."""
    return (p.m1 * p.r1 + p.m2 * p.l1 + p.m2 * p.r2) * p.g


@pytest.mark.parametrize("name", SHIPPED_PLANTS)
def test_shipped_plants_are_pendulums(name):
    plant = load_plant(name)
    assert plant.name == name
    assert load_plant(plant) == plant
    assert plant.driven("acrobot").tl1 == 0 == plant.driven("pendubot").tl2


def test_torque_over_gravity():
    """C.1: (0.5235 0.2 + 0.6256 0.2 + 0.6256 0.2557) 9.81 = 3.824 N m, and 6 N m are 1.57 of it; B.0: 6 / 6.24."""
    ratios = {name: p.tl1 / gravity_torque(p) for name in ("B.0", "C.1") for p in [load_plant(name)]}
    assert ratios == pytest.approx({"B.0": 0.961, "C.1": 1.569}, abs=1e-3)


@pytest.mark.parametrize("robot", ["acrobot", "pendubot"])
def test_the_leaderboards_plant_is_c1_without_friction(robot):
    assert load_plant("leaderboard") == LEADERBOARD == load_plant("C.1").frictionless()
    expected = {**load_plant("C.1").values(), "b1": 0.0, "b2": 0.0, "cf1": 0.0, "cf2": 0.0, "Ir": 0.0}
    passive = {"acrobot": "tl1", "pendubot": "tl2"}[robot]
    assert LEADERBOARD.driven(robot).values() == expected | {passive: 0.0}


def test_files_and_faults(tmp_path):
    path = tmp_path / "mine.yml"
    path.write_text("m1: 1.0\n")
    for source, message in [
        (
            "C.2",
            "unknown plant 'C.2': use A.0, B.0, C.0, C.1, cloudpendulum, cloudpendulum-rods, leaderboard or a "
            "parameter file",
        ),
        (path, "lacks m2, l1"),
        (tmp_path / "none.yml", "cannot read"),
        (dataclasses.replace(load_plant("C.1"), m1=-1.0), "m1 = -1 must be positive"),
    ]:
        with pytest.raises(SwingupError, match=message) as error:
            load_plant(source)
        assert "\n" not in str(error.value)
