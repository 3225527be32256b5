"""Plants: the identified numbers, files, ruler and scale, what is checked and refused, and their own units."""

import dataclasses
import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml

from refusals import refusal
from swingup.dynamics.dynamics import linearise
from swingup.loop.draw import draw
from swingup.loop.resolve import resolve
from swingup.plant.base_parameters import base_parameters
from swingup.plant.files import SHIPPED_PLANTS, load_plant, save_plant
from swingup.plant.measured import measured_plant
from swingup.plant.plant import LEADERBOARD, ROBOTS, ZEROS, get_robot, torque_over_gravity, validated
from swingup.plant.units import (
    ACCELERATION,
    COMPLIANCE,
    DAMPING,
    INERTIA,
    REFERENCE,
    VELOCITY,
    Scales,
    Unit,
    scales_of,
    similar_plant,
)
from swingup.plant.upright import upright_needs

C1 = load_plant("C.1")
IDENTIFIED = (
    yaml.safe_load((Path(__file__).parent / "data" / "C.1.yml").read_text()) | {"tl1": 6.0, "tl2": 6.0} | ZEROS
)
"""Model 1 of design C.1, RealAIGym's own file; its leaderboards' motors have 6 N m."""
PENDUBOT = get_robot("pendubot")


@pytest.fixture
def read(tmp_path):
    """Reads a parameter file of a text, of bytes, or of values; beside it lie others."""

    def read(content):
        (tmp_path / "facts.yml").write_text(yaml.safe_dump(load_plant("B.0").values() | {"tl1": 2.0, "tl2": 3.0}))
        (tmp_path / "part.yml").write_text("m1: 0.5\n")
        content = yaml.safe_dump(content) if isinstance(content, dict) else content
        (tmp_path / "mine.yml").write_bytes(content if isinstance(content, bytes) else content.encode())
        return load_plant(tmp_path / "mine.yml")

    return read


def drawn(domain, robot=PENDUBOT):
    with jax.enable_x64(True):
        return jax.tree.map(float, draw(domain, jax.random.key(0), robot)[0])


def test_the_leaderboards_plant_is_c1_without_friction_rotors_and_one_motor(robot):
    assert C1.values() == IDENTIFIED
    assert load_plant("leaderboard") == LEADERBOARD == C1.frictionless()
    passive = {"acrobot": "tl1", "pendubot": "tl2"}[robot.name]
    changed = {"Ir": 0.0, "b1": 0.0, "b2": 0.0, "cf1": 0.0, "cf2": 0.0, passive: 0.0}
    assert LEADERBOARD.driven(robot).values() == IDENTIFIED | changed
    assert (robot.actuation[robot.joint], robot.actuation[1 - robot.joint]) == (1.0, 0.0)


@pytest.mark.parametrize("name", SHIPPED_PLANTS)
def test_shipped_plants_are_pendulums_and_domains(name):
    plant = load_plant(name)
    assert (plant.name, load_plant(plant)) == (name, plant)
    assert drawn(resolve(domain=name)).values() == plant.driven(PENDUBOT).values()


def test_plants_of_two_names_share_compiled_code():
    plants = C1, dataclasses.replace(C1, name="mine.yml"), load_plant("B.0")
    assert len({jax.tree.structure(plant) for plant in plants}) == 1


def test_what_files_may_hold(read):
    # Values whose shortest decimal forms are long, tiny or negative; PyYAML reads 1e-3 without a point as a text.
    given = dataclasses.replace(C1, m1=0.1 + 0.2, g=math.pi, Ir=5e-324, b1=-1 / 3, cf2=-1e-17)
    assert read(given.values()) == given
    shown = read(IDENTIFIED | {"zero1": 0.04, "zero2": -0.03})
    assert (shown.zeros, shown.changed(**ZEROS)) == (
        (0.04, -0.03),
        C1,
    )  # they tell plants apart, and add nothing else
    assert read(IDENTIFIED | {"gr": 6, "b1": "1e-3", "name": "mine"}) == C1
    found = validated(jax.tree.map(jnp.asarray, C1))
    assert (type(found.m1), found.m1) == (float, float(np.float32(IDENTIFIED["m1"])))
    # The robustness benchmark varies friction to below zero, and r1 and I2 so that both inertias are below those of
    # point masses: m1 r1² = 0.52346 * 0.25² = 0.0327 > I1 = 0.0319, m2 r2² = 0.62557 * 0.25569² = 0.0409 > 0.0382.
    varied = {"b1": -0.1, "b2": -0.1, "cf1": -0.2, "cf2": -0.2, "r1": 0.25, "I2": 0.75 * IDENTIFIED["I2"]}
    assert read(IDENTIFIED | varied).values() == IDENTIFIED | varied


def test_a_file_of_facts_is_a_domain_and_may_start_from_another_plant(read, tmp_path):
    assert read("plant: facts.yml\nm1: 0.7\ndelay: 0.004\n").m1 == 0.7
    (tmp_path / "wide.yml").write_text(
        "plant: B.0\nm1: [0.6, 0.7]\npassive_limit: 0.5\ndelay: [0, 4e-3]\nIr: 4e-5\n"
    )
    mine, wide = resolve(domain=tmp_path / "mine.yml"), resolve(domain=tmp_path / "wide.yml")
    for domain, limit in ((mine, 2.0), (wide, 6.0)):
        plant = drawn(domain)
        assert (plant.l2, plant.tl1) == (0.4, limit)  # B.0's second link
    assert (mine.nominal_plant.m1, wide.nominal_plant.m1, wide.nominal_plant.r1) == pytest.approx((0.7, 0.65, 0.3))
    # Without a point, YAML reads a text.
    ranges = {"m1": [0.6, 0.7], "passive_limit": [0.5, 0.5], "delay": [0.0, 0.004], "Ir": [4e-5, 4e-5]}
    assert wide.as_dict() == {"plant": "B.0", **ranges}
    assert hash(wide) == hash(resolve(domain=tmp_path / "wide.yml"))


def test_a_domain_with_all_of_a_plants_values_has_that_plant():
    """Its plant is the middle of the ranges; the motors' limits may be one."""
    values = load_plant("B.0").values()
    domain = resolve(domain={**values, "m1": [0.6, 0.8], "delay": 0.002})
    assert domain.plant.values() == {**values, "m1": pytest.approx(0.7)}
    small = load_plant("cloudpendulum")
    some = {name: value for name, value in small.values().items() if name not in ("tl1", "tl2")}
    assert "lacks tl1, tl2" in refusal(resolve, None, some)
    assert resolve(domain={**some, "torque_limit": 0.13}).plant == small


def test_one_limit_for_both_motors(tmp_path):
    (tmp_path / "weak.yml").write_text("plant: C.1\ntorque_limit: 3\n")
    assert load_plant(tmp_path / "weak.yml").values() == resolve(tmp_path / "weak.yml").facts.values()
    (tmp_path / "base.yml").write_text("plant: weak.yml\nm2: 0.7\n")
    save_plant(tmp_path / "weak.yml", load_plant("B.0"))
    lines = [line for line in (tmp_path / "weak.yml").read_text().splitlines() if not line.startswith("tl")]
    (tmp_path / "weak.yml").write_text("\n".join([*lines, "torque_limit: 3"]))
    assert load_plant(tmp_path / "base.yml").tl1 == resolve(tmp_path / "base.yml").facts.tl1 == 3.0
    (tmp_path / "both.yml").write_text("plant: C.1\ntorque_limit: 3\ntl2: 6\n")
    assert "tl2 and torque_limit say the same" in refusal(load_plant, tmp_path / "both.yml")


def test_mass_matrix_must_be_definite():
    # Without a rotor det M = I2 (I1 + m2 l1²) - (m2 l1 r2 cos q2)²; here 0.5 (0.5 + 1) - 1 < 0 at cos q2 = ±1.
    plant = dataclasses.replace(C1, m2=1.0, l1=1.0, r2=1.0, I1=0.5, I2=0.5, Ir=0.0)
    assert "not positive definite at cos(q2) = 1: raise I1 = 0.5 or I2 = 0.5" in refusal(validated, plant)
    # A negative definite M has a positive determinant, too: here M22 = I2 = -3 and det M = 3 * 2 - 1 > 0.
    assert "not positive definite" in refusal(validated, dataclasses.replace(plant, I1=-3.0, I2=-3.0))
    # Folded: m2 = l1 = r2 = gr = 1, Ir = 0.1, I2 = 0.5, so that h = 1 and M22 = 0.5 + 0.1 = 0.6.
    # Straight:  M11 = I1 + 0.5 + 1 + 2 + 0.2, M12 = 0.5 + 1 - 0.1, det = 0.6 I1 + 2.22 - 1.96 > 0.
    # Folded:    M11 = I1 + 0.5 + 1 - 2 + 0.2, M12 = 0.5 - 1 - 0.1, det = 0.6 I1 - 0.18 - 0.36 < 0 for I1 < 0.9.
    plant = dataclasses.replace(plant, gr=1.0, Ir=0.1)
    assert "not positive definite at cos(q2) = -1" in refusal(validated, plant)
    definite = dataclasses.replace(plant, I1=1.0)
    assert validated(definite) == definite


BAD_FILES = {
    "m1 = -0.5 must be positive": {"m1": -0.5},
    **{f"{name} = 0 must be positive": {name: 0.0} for name in ("m2", "l1", "l2", "gr", "g")},
    **{f"{name} = 1e-200 must be at least 1e-09": {name: 1e-200} for name in ("m1", "l1", "l2", "g")},
    "r1 = nan must be finite": {"r1": math.nan},
    "l1 = 1e+200 must be finite and below 1e+09": {"l1": 1e200},
    "r2 = 'heavy' is not a number": {"r2": "heavy"},
    "gr = [6] is a range, and a plant has facts": {"gr": [6]},
    "mine.yml lacks m2, l1": "m1: 1",
    "m1 = [0.6, 0.7] is a range": "plant: B.0\nm1: [0.6, 0.7]",
    "unknown name 'M_2': write m2": "plant: B.0\nM_2: 0.6",
}


@pytest.mark.parametrize("named", BAD_FILES)
def test_files_that_are_no_plant(read, named):
    content = BAD_FILES[named]
    assert named in refusal(read, IDENTIFIED | content if isinstance(content, dict) else content)


ROD = {"m1": 0.5, "m2": 0.6, "l1": 0.2, "l2": 0.3, "tl2": 1.0}


def test_two_rods_and_rods_with_a_mass_at_one_end():
    plant, notes = measured_plant(values=ROD)
    assert (plant.r1, plant.r2, plant.tl1, plant.gr, plant.g) == (0.1, 0.15, 0.0, 1.0, 9.81)
    assert pytest.approx((0.5 * 0.2**2 / 3, 0.6 * 0.3**2 / 3)) == (plant.I1, plant.I2)
    assert sum("uniform rod" in note for note in notes) == 2
    # A rod of 0.2 kg with 0.4 kg at the tip: (0.2 · 0.15 + 0.4 · 0.3) / 0.6 = 0.25 m.
    assert pytest.approx(0.2 * 0.3**2 / 3 + 0.4 * 0.3**2) == measured_plant(values=ROD | {"r2": 0.25}).plant.I2
    # A rod of 0.4 kg with 0.2 kg at the joint: 0.4 · 0.15 / 0.6 = 0.1 m.
    assert pytest.approx(0.4 * 0.3**2 / 3) == measured_plant(values=ROD | {"r2": 0.1}).plant.I2


def test_inertias_by_name_motors_with_their_gears_and_values_in_the_place_of_a_plants():
    given = {name: value for name, value in ROD.items() if name != "tl2"}
    plant = measured_plant(values=given | {"r1": 0.1, "Ic1": 0.002, "I2": 0.02, "motor": 0.5, "gr": 6.0}).plant
    assert (plant.I1, plant.I2, plant.tl1, plant.tl2) == (pytest.approx(0.002 + 0.5 * 0.1**2), 0.02, 3.0, 3.0)
    plant = measured_plant("C.1", {"m1": 0.7, "motor": 2.0}).plant
    assert plant == load_plant("C.1").changed(m1=0.7, tl1=12.0, tl2=12.0)
    # Two point masses of 1 kg, 1 m apart, swing in 2π √(2 ∓ √2)⁻¹ √(1 / g): the textbook's double pendulum.
    points = {f"{name}{link}": 1.0 for name in ("m", "l", "r", "I", "tl") for link in (1, 2)}
    told = measured_plant(values=points).notes[-1]
    slow, fast = (2 * math.pi / math.sqrt(9.81 * (2 + sign * math.sqrt(2))) for sign in (-1, 1))
    assert f"take {slow:.3g} s, and {fast:.3g} s" in told


SPONG = {
    "theta1": 4 / 3,
    "theta2": 4 / 3,
    "theta3": 1.0,
    "theta4": 1.5,
    "theta5": 1.0,
    "l1": 1.0,
    "l2": 2.0,
    "tl2": 10.0,
}


def test_base_parameters_are_enough():
    """Spong's acrobot: links of 1 and 2 m, of 1 kg each, with I = 1/12 and 1/3 kg m² about their centres."""
    links = {"m1": 1.0, "m2": 1.0, "l1": 1.0, "l2": 2.0, "Ic1": 1 / 12, "Ic2": 1 / 3, "tl2": 10.0}
    right = base_parameters(measured_plant(values=links).plant)
    ours = {
        "I1 + m2 l1²": 4 / 3,
        "I2": 4 / 3,
        "m2 r2": 1.0,
        "m1 r1 + m2 l1": 1.5,
        "l1": 1.0,
        "l2": 2.0,
        "tl2": 10.0,
    }
    for values in (SPONG, ours):
        plant = measured_plant(values=values | {"zero2": 0.1}).plant
        assert base_parameters(plant) == pytest.approx(right)
        assert plant.zeros == (0.0, 0.1)
    changed = measured_plant("C.1", {"m2r2": 0.17}).plant
    assert (changed.m2 * changed.r2, changed.I2, changed.tl1) == pytest.approx((0.17, C1.I2, C1.tl1))


def test_what_the_upright_asks_for(x64):
    """Its poles are those of the linearisation; no bang-bang torque catches a lean beyond the largest one."""
    plant, robot = LEADERBOARD, ROBOTS["acrobot"]
    need = upright_needs(plant, robot)
    state, ours = np.array([np.pi, 0.0, 0.0, 0.0]), need.poles
    a, b = linearise(plant, state, np.zeros(2))
    values = np.linalg.eigvals(np.asarray(a, float)).real
    assert sorted(values[values > 0]) == pytest.approx(ours, rel=1e-4)
    assert need.dead_time * sum(ours) == pytest.approx(0.33)
    assert 0.5 / need.rate == pytest.approx(0.25 * need.dead_time)
    # At the largest lean the full torque holds one unstable mode w x, so that w (A x + B u) = 0; beyond it loses.
    rates, left = np.linalg.eig(np.asarray(a, float).T)
    lean = np.array([need.tilt, 0.0, 0.0, 0.0])
    pushes = np.asarray(b, float)[:, 1] * plant.tl2
    drift = [
        abs(rate.real * w @ lean) - abs(w @ pushes) for rate, w in zip(rates, left.real.T, strict=True) if rate > 0
    ]
    assert max(drift) == pytest.approx(0.0, abs=1e-3)


WRONG = {
    "m1 and base parameters say the same": ROD | {"m2r2": 0.1},
    "base parameters need m2r2, I1+m2l1^2, I2 as well": {"theta4": 1.0, "l1": 1.0},
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


def test_units_of_two_point_masses():
    # 1 kg at 0.5 m and 2 kg at 0.5 + 0.3 m: J = 0.25 + 2 · 0.64 = 1.53, Γ = (0.5 + 1.6) · 10 = 21.
    plant = dataclasses.replace(
        LEADERBOARD.driven(ROBOTS["acrobot"]),
        m1=1.0, m2=2.0, l1=0.5, l2=0.3, r1=0.5, r2=0.3, I1=0.25, I2=0.18, g=10.0, tl2=42.0,
    )  # fmt: skip
    assert REFERENCE[0] * scales_of(plant).time == pytest.approx(math.sqrt(1.53 / 21))
    assert torque_over_gravity(plant) == pytest.approx(2.0)


@pytest.mark.parametrize("scales", [Scales(1.0, 0.0, 1.0), Scales(1e-200, 1.0, 1.0), Scales(1.0, 1.0, 1e200)])
def test_units_that_no_number_has(scales):
    assert "nothing can be scaled" in refusal(lambda: [*map(scales.of, (COMPLIANCE, ACCELERATION, Unit(length=2)))])


def test_units_of_c1_are_exactly_1_and_those_of_a_similar_pendulum_its_factors(similar):
    for plant in (LEADERBOARD, C1):
        assert [*map(scales_of, (plant, *map(plant.driven, ROBOTS.values())))] == 3 * [Scales(1.0, 1.0, 1.0)]
    found = scales_of(similar(LEADERBOARD.driven(ROBOTS["acrobot"])))
    # T ~ √(l/g), Γ ~ m l g.
    assert tuple(found) == pytest.approx((0.5, 0.025, 0.25), rel=1e-12)
    assert similar_plant(similar(C1), found).values() == pytest.approx(C1.values(), rel=1e-12)
    units = [found.of(unit) for unit in (VELOCITY, ACCELERATION, INERTIA, DAMPING)]
    assert units == pytest.approx([2.0, 4.0, 0.025 / 4, 0.025 / 2])
