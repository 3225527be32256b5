import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml

from swingup.common.errors import SwingupError
from swingup.plant.plant import LEADERBOARD, NAMES, load_plant, validated
from swingup.plant.robots import ROBOTS, get_robot

IDENTIFIED = {
    "m1": 0.5234602302310271,
    "m2": 0.6255677234174437,
    "l1": 0.2,
    "l2": 0.3,
    "r1": 0.2,
    "r2": 0.25569305436052964,
    "I1": 0.031887199591513114,
    "I2": 0.05086984812807257,
    "Ir": 6.287203962819607e-05,
    "gr": 6.0,
    "b1": 0.001,
    "b2": 0.001,
    "cf1": 0.16,
    "cf2": 0.12,
    "g": 9.81,
    "tl1": 6.0,
    "tl2": 6.0,
}


def write(tmp_path, values):
    path = tmp_path / "model.yml"
    path.write_text(values if isinstance(values, str) else yaml.safe_dump(values), encoding="utf-8")
    return path


def assert_one_line(error):
    assert isinstance(error.value, SwingupError)
    assert "\n" not in str(error.value)


def test_identified_parameters_are_those_of_design_c1_model_1():
    assert load_plant("C.1").values() == IDENTIFIED


def test_plants_of_two_names_share_compiled_code():
    traced = []

    @jax.jit
    def mass(plant):
        traced.append(plant.name)
        return plant.m1 + plant.m2

    plant = load_plant("C.1")
    for each in (plant, dataclasses.replace(plant, name="mine.yml"), load_plant("B.0")):
        assert float(mass(each)) == pytest.approx(each.m1 + each.m2)
    assert traced == [""]
    assert jax.tree.leaves(plant) == list(plant.values().values())


def test_names_are_those_of_realaigym_in_order():
    assert list(NAMES) == list(IDENTIFIED)


@pytest.mark.parametrize(("name", "joint", "limits"), [("acrobot", 1, (0.0, 6.0)), ("pendubot", 0, (6.0, 0.0))])
def test_leaderboard_plant_has_no_friction_no_rotor_and_one_motor(name, joint, limits):
    robot = get_robot(name)
    assert robot.joint == joint
    assert robot.actuation[joint] == 1.0
    assert robot.actuation[1 - joint] == 0.0
    changed = {"Ir": 0.0, "b1": 0.0, "b2": 0.0, "cf1": 0.0, "cf2": 0.0, "tl1": limits[0], "tl2": limits[1]}
    assert LEADERBOARD.driven(robot).values() == IDENTIFIED | changed


def test_length_is_the_height_of_the_upright_tip():
    assert load_plant("C.1").length == pytest.approx(0.5, abs=1e-15)


def test_yaml_round_trip_is_exact(tmp_path):
    # Values whose shortest decimal forms are long, tiny or negative.
    given = dataclasses.replace(load_plant("C.1"), m1=0.1 + 0.2, g=math.pi, Ir=5e-324, b1=-1 / 3, cf2=-1e-17)
    (tmp_path / "model.yml").write_text(yaml.safe_dump(given.values()))
    assert load_plant(tmp_path / "model.yml") == given


def test_array_valued_parameters_become_numbers():
    found = validated(jax.tree.map(jnp.asarray, load_plant("C.1")))
    assert (type(found.m1), found.m1) == (float, float(np.float32(IDENTIFIED["m1"])))


def test_whole_numbers_numeric_strings_and_other_keys_are_accepted(tmp_path):
    # PyYAML reads 1e-3 without a point as a string.
    path = write(tmp_path, IDENTIFIED | {"gr": 6, "b1": "1e-3", "name": "mine"})
    assert load_plant(path) == load_plant("C.1")


@pytest.mark.parametrize("missing", ["I2", "tl1"])
def test_missing_key_is_named(tmp_path, missing):
    path = write(tmp_path, {name: value for name, value in IDENTIFIED.items() if name != missing})
    with pytest.raises(SwingupError, match=f"model.yml lacks {missing}: add them in SI units") as error:
        load_plant(path)
    assert_one_line(error)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("m1", -0.5, "parameter m1 = -0.5 must be positive"),
        ("m2", 0.0, "parameter m2 = 0 must be positive"),
        ("l1", -0.2, "parameter l1 = -0.2 must be positive"),
        ("l2", 0.0, "parameter l2 = 0 must be positive"),
        ("g", -9.81, "parameter g = -9.81 must be positive"),
        ("tl1", -1.0, "parameter tl1 = -1 must not be negative"),
        ("tl2", -6.0, "parameter tl2 = -6 must not be negative"),
        ("r1", math.nan, "parameter r1 = nan must be finite"),
        ("b1", math.inf, "parameter b1 = inf must be finite"),
        ("r2", "heavy", "parameter r2 = 'heavy' is not a number"),
        ("cf1", None, "parameter cf1 = None is not a number"),
        ("gr", [6], r"gr = \[6\] is a range, and a plant has facts"),
        ("m1", True, "parameter m1 = True is not a number"),
        ("m1", 10**400, "parameter m1 = inf must be finite"),
        ("l1", 1e200, r"parameter l1 = 1e\+200 must be finite and below 1e\+09"),
    ],
)
def test_bad_value_is_named(tmp_path, name, value, message):
    with pytest.raises(SwingupError, match=message) as error:
        load_plant(write(tmp_path, IDENTIFIED | {name: value}))
    assert_one_line(error)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("m1: [1, 2\nm2: }", "is not YAML"),
        ("m1: 1\n  m2: 2", "is not YAML"),
        ("- 1\n- 2\n", "is not a map"),
        ("just words", "is not a map"),
        ("", "is not a map"),
        ("m1: 1\nm2: 2\nm1: 3\n", "gives m1 2 times: keep one of its values"),
    ],
)
def test_file_that_is_no_yaml_map_is_refused(tmp_path, content, message):
    with pytest.raises(SwingupError, match=message) as error:
        load_plant(write(tmp_path, content))
    assert_one_line(error)


def test_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(SwingupError, match=r"cannot read parameter file .*missing\.yml") as error:
        load_plant(tmp_path / "missing.yml")
    assert_one_line(error)
    binary = tmp_path / "binary.yml"
    binary.write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(SwingupError, match=r"parameter file .*binary\.yml is not UTF-8"):
        load_plant(binary)
    (tmp_path / "folder.yml").mkdir()
    with pytest.raises(SwingupError, match="cannot read parameter file"):
        load_plant(tmp_path / "folder.yml")


def test_mass_matrix_must_be_definite():
    # Without a rotor det M = I2 (I1 + m2 l1²) - (m2 l1 r2 cos q2)²; here 0.5 (0.5 + 1) - 1 < 0 at cos q2 = ±1.
    plant = dataclasses.replace(load_plant("C.1"), m2=1.0, l1=1.0, r2=1.0, I1=0.5, I2=0.5, Ir=0.0)
    with pytest.raises(SwingupError, match=r"not positive definite.*I1 = 0\.5.*I2 = 0\.5") as error:
        validated(plant)
    assert_one_line(error)
    # A negative definite M has a positive determinant, too: here M22 = I2 = -3 and det M = 3 * 2 - 1 > 0.
    with pytest.raises(SwingupError, match="not positive definite"):
        validated(dataclasses.replace(plant, I1=-3.0, I2=-3.0))


def test_mass_matrix_must_be_definite_when_folded():
    # m2 = l1 = r2 = gr = 1, Ir = 0.1, I2 = 0.5, so that h = 1 and M22 = 0.5 + 0.1 = 0.6.
    # Straight:  M11 = I1 + 0.5 + 1 + 2 + 0.2, M12 = 0.5 + 1 - 0.1, det = 0.6 I1 + 2.22 - 1.96 > 0.
    # Folded:    M11 = I1 + 0.5 + 1 - 2 + 0.2, M12 = 0.5 - 1 - 0.1, det = 0.6 I1 - 0.18 - 0.36 < 0 for I1 < 0.9.
    plant = dataclasses.replace(load_plant("C.1"), m2=1.0, l1=1.0, r2=1.0, gr=1.0, Ir=0.1, I1=0.5, I2=0.5)
    with pytest.raises(SwingupError, match=r"not positive definite at cos\(q2\) = -1"):
        validated(plant)
    definite = dataclasses.replace(plant, I1=1.0)
    assert validated(definite) == definite


def test_robustness_sweep_values_are_allowed(tmp_path):
    # The benchmark varies friction to below zero, r1 to 125 % with I1 kept, and I2 to 75 %. Both inertias are then
    # below those of point masses: m1 r1² = 0.52346 * 0.25² = 0.0327 > I1 = 0.0319, and
    # m2 r2² = 0.62557 * 0.25569² = 0.0409 > I2 = 0.0382.
    varied = {"b1": -0.1, "b2": -0.1, "cf1": -0.2, "cf2": -0.2, "r1": 0.25, "I2": 0.75 * IDENTIFIED["I2"]}
    assert load_plant(write(tmp_path, IDENTIFIED | varied)).values() == IDENTIFIED | varied


def test_unknown_robot_is_refused_with_the_choice():
    with pytest.raises(SwingupError, match="unknown robot 'cartpole': use one of acrobot, pendubot"):
        get_robot("cartpole")
    assert list(ROBOTS) == ["acrobot", "pendubot"]
