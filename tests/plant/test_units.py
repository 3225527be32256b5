"""The pendulum's own units: closed forms, similarity, and exactly 1 for the leaderboards' plant."""

import dataclasses
import math

import pytest

from refusals import refusal
from swingup.plant.plant import LEADERBOARD, load_plant
from swingup.plant.robots import ROBOTS
from swingup.plant.units import (
    ACCELERATION,
    DAMPING,
    INERTIA,
    REFERENCE,
    VELOCITY,
    Scales,
    scales_of,
    similar_plant,
    torque_over_gravity,
)


def test_leaderboards_plant_has_units_of_exactly_1(either_robot):
    for plant in (LEADERBOARD.driven(either_robot), load_plant("C.1").driven(either_robot)):
        assert scales_of(plant) == Scales(time=1.0, torque=1.0, length=1.0)


def test_units_of_two_point_masses():
    # 1 kg at 0.5 m and 2 kg at 0.5 + 0.3 m: J = 0.25 + 2 · 0.64 = 1.53, Γ = (0.5 + 1.6) · 10 = 21.
    plant = dataclasses.replace(
        LEADERBOARD.driven(ROBOTS["acrobot"]),
        m1=1.0, m2=2.0, l1=0.5, l2=0.3, r1=0.5, r2=0.3, I1=0.25, I2=0.18, g=10.0, tl2=42.0,
    )  # fmt: skip
    assert REFERENCE[0] * scales_of(plant).time == pytest.approx(math.sqrt(1.53 / 21))
    assert torque_over_gravity(plant) == pytest.approx(2.0)


def test_units_of_a_similar_pendulum(similar):
    found = scales_of(similar(LEADERBOARD.driven(ROBOTS["acrobot"])))
    # T ~ √(l/g), Γ ~ m l g.
    assert tuple(found) == pytest.approx((0.5, 0.025, 0.25), rel=1e-12)
    back = similar_plant(similar(LEADERBOARD), found)
    assert back.values() == pytest.approx(LEADERBOARD.values(), rel=1e-12)
    units = [found.of(unit) for unit in (VELOCITY, ACCELERATION, INERTIA, DAMPING)]
    assert units == pytest.approx([2.0, 4.0, 0.025 / 4, 0.025 / 2])


def test_torque_over_gravity():
    # C.1: 6 N m over (0.5235 0.2 + 0.6256 0.2 + 0.6256 0.2557) 9.81 = 3.824 N m; B.0: 6 / 6.244.
    ratios = {name: torque_over_gravity(load_plant(name)) for name in ("B.0", "C.1", "leaderboard")}
    assert ratios == pytest.approx({"B.0": 0.961, "C.1": 1.569, "leaderboard": 1.569}, abs=1e-3)


def test_units_need_gravity_and_inertia():
    plant = LEADERBOARD.driven(ROBOTS["acrobot"])
    assert "level arm is -" in refusal(scales_of, dataclasses.replace(plant, r1=-1.0))
    assert "inertia is -" in refusal(scales_of, dataclasses.replace(plant, I1=-1.0, Ir=1.0))
