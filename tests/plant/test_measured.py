"""Plants from a ruler and a scale, in closed form."""

import math

import pytest

from refusals import refusal
from swingup.plant.measured import measured_plant
from swingup.plant.plant import load_plant

ROD = {"m1": 0.5, "m2": 0.6, "l1": 0.2, "l2": 0.3, "tl2": 1.0}


def test_two_rods():
    plant, notes = measured_plant(values=ROD)
    assert (plant.r1, plant.r2, plant.tl1, plant.gr, plant.g) == (0.1, 0.15, 0.0, 1.0, 9.81)
    assert pytest.approx((0.5 * 0.2**2 / 3, 0.6 * 0.3**2 / 3)) == (plant.I1, plant.I2)
    assert sum("uniform rod" in note for note in notes) == 2


@pytest.mark.parametrize(
    ("centre", "inertia"),
    [
        # A rod of 0.2 kg with 0.4 kg at the tip: (0.2 · 0.15 + 0.4 · 0.3) / 0.6 = 0.25 m.
        (0.25, 0.2 * 0.3**2 / 3 + 0.4 * 0.3**2),
        # A rod of 0.4 kg with 0.2 kg at the joint: 0.4 · 0.15 / 0.6 = 0.1 m.
        (0.1, 0.4 * 0.3**2 / 3),
        (0.15, 0.6 * 0.3**2 / 3),
    ],
)
def test_a_measured_centre_is_that_of_a_rod_with_a_mass_at_one_end(centre, inertia):
    assert pytest.approx(inertia) == measured_plant(values=ROD | {"r2": centre}).plant.I2


def test_inertias_by_name_and_a_motor_with_its_gear():
    given = {name: value for name, value in ROD.items() if name != "tl2"}
    plant = measured_plant(values=given | {"r1": 0.1, "Ic1": 0.002, "I2": 0.02, "motor": 0.5, "gr": 6.0}).plant
    assert (plant.I1, plant.I2, plant.tl1, plant.tl2) == (pytest.approx(0.002 + 0.5 * 0.1**2), 0.02, 3.0, 3.0)


def test_values_replace_those_of_a_plant():
    plant = measured_plant("C.1", {"m1": 0.7, "motor": 2.0}).plant
    assert plant == load_plant("C.1").changed(m1=0.7, tl1=12.0, tl2=12.0)
    # Two point masses of 1 kg, 1 m apart, swing in 2π √(2 ∓ √2)⁻¹ √(1 / g): the textbook's double pendulum.
    points = {f"{name}{link}": 1.0 for name in ("m", "l", "r", "I", "tl") for link in (1, 2)}
    told = measured_plant(values=points).notes[-1]
    slow, fast = (2 * math.pi / math.sqrt(9.81 * (2 + sign * math.sqrt(2))) for sign in (-1, 1))
    assert f"take {slow:.3g} s, and {fast:.3g} s" in told


WRONG = {
    "unknown value 'm3'": {"m3": 1.0},
    "a plant needs m2, l2": {"m1": 0.5, "l1": 0.2, "tl1": 1.0},
    "I1 and Ic1 say the same": ROD | {"I1": 0.1, "Ic1": 0.1},
    "motor and tl2 say the same": ROD | {"motor": 1.0},
    "I1 = 0.001 kg m² is below m1 r1² = 0.005": ROD | {"I1": 0.001},
    "beyond the ends of link 2": ROD | {"r2": 0.4},
}


@pytest.mark.parametrize("named", WRONG)
def test_values_that_make_no_plant(named):
    assert named in refusal(measured_plant, None, WRONG[named])
