"""Domains: what plants and loops are drawn from, what is refused, and a plant in the loop of a domain."""

from importlib import resources

import jax
import numpy as np
import pytest

from refusals import refusal
from swingup.loop.draw import draw
from swingup.loop.loop import VALUES
from swingup.loop.resolve import PLANT, resolve
from swingup.plant.files import load_plant
from swingup.plant.plant import get_robot
from swingup.policy.shipped import load_pendulum_policy

ACROBOT = get_robot("acrobot")
FIRST_DRAW = [0.43446442676405217, 0.0755743854035989, 0.002119275055824273, -0.0007073005820577105]
draw_one = jax.jit(draw, static_argnums=(0, 2))


def drawn(domain, number=200, robot=ACROBOT):
    """Plants and disturbances with a leading axis."""
    keys = jax.random.split(jax.random.key(0), number)
    return jax.jit(jax.vmap(lambda key: draw(domain, key, robot)))(keys)


def test_the_identified_domain_is_the_identified_plant(robot):
    domain = resolve(domain="identified")
    assert all(low == high for _, low, high in domain.ranges)
    with jax.enable_x64(True):
        plant, loop = draw_one(domain, jax.random.key(3), robot)
    limits = {f"tl{robot.joint + 1}": 6.0, f"tl{2 - robot.joint}": 0.5}
    assert {name: float(value) for name, value in plant.values().items()} == load_plant("C.1").values() | limits
    assert (int(loop.delay_steps), float(loop.loop.velocity_noise)) == (5, 0.1)  # 10 ms in steps of 2 ms
    assert not np.any(loop.pushes.amplitude)


def test_draws_fill_their_ranges():
    domain = resolve(domain="randomised")
    plant, loop = drawn(domain)
    ranges = {name: (low, high) for name, low, high in domain.ranges}
    found = {name: getattr(plant, name) for name in PLANT}
    found |= {name: getattr(loop.loop, name) for name in VALUES if name in ranges and name not in ("delay", "push")}
    for name, values in found.items():
        low, high = ranges.get(name, (None, None))
        if low == high:
            assert np.ptp(values) == 0
        else:
            assert low * 0.9999 <= values.min() < low + 0.1 * (high - low)
            assert high * 1.0001 >= values.max() > high - 0.1 * (high - low)
    assert set(np.unique(loop.delay_steps)) == {3, 4, 5, 6}  # 6 to 14 ms, 14 ms at the edge alone
    assert domain.depth == 8
    pushes = loop.pushes.amplitude
    assert 0.5 < pushes[:, 1].max() <= 1.0
    assert -1.0 <= pushes[:, 1].min() < -0.5
    assert not pushes[:, 0].any()  # the acrobot's shoulder has no motor to push


def test_what_is_left_out_is_perfect():
    plant, loop = drawn(resolve(domain={"plant": "C.1", "m1": 0.5}), 2)
    assert plant.m1.tolist() == [0.5, 0.5]
    assert loop.delay_steps.tolist() == loop.loop.torque_noise.tolist() == [0, 0]
    assert loop.loop.response.tolist() == [1, 1]
    assert plant.tl1.tolist() == [0, 0]
    assert values(None, None) == values("C.1", None) == {"plant": "C.1"}
    assert resolve(None, "identified").name == "identified"


BAD_DOMAINS = {
    "unknown name 'nothing': use one of m1, ": "nothing: 1",
    "delay = [0.02, 0.01] must be a range from low to high": "delay: [0.02, 0.01]",
    "delay = [0, 1] must lie between 0 and 0.2": "delay: [0.0, 1.0]",
    "m1 = [0.1, 0.2, 0.3] must be a number, or a range [low, high]": "m1: [0.1, 0.2, 0.3]",
    "tl1 and torque_limit say the same": "plant: C.1\ntl1: 3\ntorque_limit: 6",
    "mass matrix is not positive definite at cos(q2) = 1": "plant: C.1\nI2: 1.0e-6",
    "mass matrix is not positive definite": "plant: C.1\nm2: [0.3, 1.0]\nI2: [0.02, 0.08]",  # both ends alone are
}


@pytest.mark.parametrize("named", BAD_DOMAINS)
def test_bad_domains(tmp_path, named):
    (tmp_path / "bad.yml").write_text(BAD_DOMAINS[named])
    assert named in refusal(resolve, tmp_path / "bad.yml")


def test_a_draw_depends_on_names_and_not_on_lines():
    """Neither their order nor other lines change what a key draws of a name."""
    ranges = {"m1": [0.5, 0.6], "m2": [0.6, 0.7], "lag": [0.0, 0.1]}
    contents = ranges, dict(reversed(ranges.items())), {"b1": [0.0, 0.1], **ranges, "delay": 0.01}
    one, *others = (
        draw_one(resolve(domain={"plant": "C.1", **each}), jax.random.key(0), ACROBOT) for each in contents
    )
    for plant, loop in others:
        assert (plant.m1, plant.m2, loop.loop.lag) == (one[0].m1, one[0].m2, one[1].loop.lag)


def test_the_boards_keep_their_draws(x64):
    """What the key of seed 0 drew when the boards' scores were measured."""
    plant, disturbance = draw(resolve(domain="recorded"), jax.random.key(0), ACROBOT)
    found = [plant.m1, plant.cf1, disturbance.loop.lag, disturbance.loop.offset2]
    assert [float(number) for number in found] == pytest.approx(FIRST_DRAW, rel=1e-12)


def test_nominal_values_are_the_middle():
    content = {"plant": "C.1", "torque_limit": 5.0, "m2": [0.6, 0.7], "lag": [0.001, 0.003]}
    domain = resolve(domain=content)
    plant, loop = domain.nominal
    assert (plant.tl1, plant.tl2, plant.m2, loop.lag) == pytest.approx((5.0, 5.0, 0.65, 0.002))
    assert (domain.design, domain.design.name) == (plant, "C.1")
    assert resolve(domain=content | {"design": "B.0"}).design == load_plant("B.0")


def test_a_guess_is_drawn_around():
    around = resolve("C.0", "recorded", 0.1)
    plant, (low, high) = load_plant("C.0"), (around.low, around.high)
    for name, share in (("m1", 0.1), ("I2", 0.1), ("cf2", 0.5), ("Ir", 0.5), ("l1", 0.0), ("r2", 0.0)):
        value = getattr(plant, name)
        assert (getattr(low.plant, name), getattr(high.plant, name)) == pytest.approx(
            ((1 - share) * value, (1 + share) * value)
        )
    # The loop is the recorded one, in the pendulum's own units.
    assert (low.loop.lag, high.loop.lag) == (0.001, 0.004)
    assert low.loop.passive_limit == pytest.approx(0.5)
    assert resolve(domain="recorded", share=0.1) == resolve(domain="recorded")
    # A domain that knows its plant is a guess as well.
    exact = resolve(domain="session-acrobot")
    alone = resolve(exact, share=0.1)
    assert (alone.low.plant.m1, alone.low.loop) == (0.9 * exact.plant.m1, exact.low.loop)


def values(plant, domain):
    return resolve(plant, domain).as_dict()


def test_a_small_plant_in_the_loop_of_a_large_one():
    """CloudPendulum's motors have 0.13 of 6 N m; its unit of time is 0.4258 of C.1's."""
    both = resolve("cloudpendulum", "identified")
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
    cells = resolve(domain="cells").as_dict()
    made = values("cloudpendulum-rods", "cells")
    assert made["velocity_noise"] == pytest.approx(cells["velocity_noise"], rel=1e-12)
    assert made["velocities"] == "driver"
    assert "m1" not in made  # the ranges of the domain's own plant have no effect
    assert values("C.1", "cells")["velocity_noise"][0] < 0.5 * cells["velocity_noise"][0]


@pytest.mark.parametrize("share", [None, 0.1])
def test_the_plants_file_has_the_last_word_on_its_loop(tmp_path, share):
    """A guess as well: only masses, inertias and frictions are off."""
    file = tmp_path / "mine.yml"
    file.write_text("plant: C.1\ncf1: 0.1\ntl2: 6\ndelay: 0.02\nquantum1: 0.001\n")
    made = resolve(file, "identified", share).as_dict()
    part = 0.0 if share is None else 5 * share
    assert made["cf1"] == pytest.approx([0.1 * (1 - part), 0.1 * (1 + part)])
    assert (made["delay"], made["quantum1"], made["passive_limit"]) == ([0.02] * 2, [0.001] * 2, [0.5, 0.5])
    file.write_text("plant: C.1\ntorque_limit: 3\n")
    for found in (resolve(file), resolve(file, "identified", share)):
        assert {(end.plant.tl1, end.plant.tl2) for end in (found.low, found.high)} == {(3.0, 3.0)}


def test_a_guess_with_ranges_keeps_them():
    wide = {"plant": "C.1", "m1": [0.5, 0.55]}
    found = resolve(resolve(domain=wide), "recorded", 0.1)
    assert (found.low.plant.m1, found.high.plant.m1, found.high.plant.I1) == (0.5, 0.55, load_plant("C.1").I1)


def test_the_content_of_a_domain_makes_it_again():
    around = resolve("cloudpendulum", "recorded", 0.1)
    again = resolve(domain=around.content)
    assert (again.low, again.high, again.effects) == (around.low, around.high, around.effects)


def test_a_loop_adds_no_motor():
    """A plant with one motor keeps it, and in no loop without a motor is a torque relative to it."""
    robot = get_robot("pendubot")
    weak, strong = ({"plant": "C.1", "tl1": 6.0, "tl2": limit} for limit in (0.0, 6.0))
    own = {**weak, "passive_limit": 0.2}  # what a file says of its loop does not change its plant either
    found = [resolve(resolve(domain=each), "recorded") for each in (weak, strong, own)]
    limits = [
        [float(draw(each, jax.random.key(0), robot)[0].tl2), each.high.passive_limit(robot)] for each in found
    ]
    assert limits == [[0.0] * 2, [0.5] * 2, [0.0] * 2]
    # Nor does a policy: from a plant with both motors, for one with one.
    policy = load_pendulum_policy("adaptive", robot, resolve(domain=weak).facts)
    assert policy.torque_limits == (6.0, 0.0)
    none = resolve(domain={**weak, "tl1": 0.0})
    for given in ((none, "recorded"), ("C.1", none)):
        assert "has no motor" in refusal(resolve, *given)


def test_a_plant_of_facts():
    assert resolve("C.1").facts == load_plant("C.1")
    assert str(resolve("C.1").frictionless().facts) == str(load_plant("C.1").frictionless())
    assert "m1 = [0.5, 0.6] is a range" in refusal(lambda: resolve(domain={"plant": "C.1", "m1": [0.5, 0.6]}).facts)


@pytest.mark.parametrize("name", ["identified", "recorded"])
def test_every_number_of_the_package_says_where_it_comes_from(name):
    text = (resources.files("swingup.loop") / "domains" / f"{name}.yml").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert all("Source:" in row or "Chosen" in row for row in rows)
