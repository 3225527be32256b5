"""The conformance table: every back end, with every shipped policy, behind every sensor.

A cell compares with the judge's JAX in double precision. Back ends that hold estimator and regulator replay a
recorded loop as a whole where a policy has a memory; else the policy alone is asked, state by state. At the end:
clocks of another origin, and scores.
"""

import dataclasses
import functools

import numpy as np
import pytest

import swingup
from swingup.controllers.registry import get_controller
from swingup.dynamics.dynamics import UPRIGHT
from swingup.export.javascript import policy_script
from swingup.plant.base_parameters import base_parameters
from swingup.policy.numpy_backend import numpy_controller
from swingup.policy.shipped import ADAPTIVE, AR_EAPO
from swingup.runtime import load_controller

from . import references
from .backends import BACK_ENDS, TASK_BACK_ENDS
from .references import ADAPTIVES, COLUMNS, DT, ESTIMATED, numpy_run, policy, recorded, silent, within

ADAPTING, LONG, BRIEF = 900, 1200, 600
"""Steps of recorded loops: of the adaptive policies, of the estimated ones, of the others."""

MEMORYLESS = [*(f"{robot}-ar-eapo" for robot in ("acrobot", "pendubot")), *references.SMALL, "acrobot-sighted"]
"""No loop tells more of them than their states do; those behind an estimator have the networks of these."""
SLOW = (ESTIMATED[1], "pendubot-global", ADAPTIVES[1])
"""What the acrobot's tell of a back end, theirs repeat."""


WHOLE = ("jax", "numpy", "c")
"""Back ends with an estimator, an identifier and a regulator; the others have the network alone."""
FEW = ("late and noisy", "uneven", "offsets and friction", "not finite")
"""Sensors behind which NumPy replays by default; C, which is faster, replays all."""
FOLLOWED = 1e-6
"""How far torques in double precision may lie apart (N m) over a loop of the adaptive policies."""


def a_cell(name, back_end, sensor):
    slow = name in SLOW or (name == ESTIMATED[0] and back_end == "jax")
    slow |= name == "acrobot-global" and sensor != "states"  # its loops take seconds to compile
    slow |= name == ESTIMATED[0] and back_end == "numpy" and sensor not in FEW
    marks = [pytest.mark.slow] if slow else []
    return pytest.param(name, back_end, sensor, id=f"{name}-{back_end}-{sensor}", marks=marks)


REMEMBERING = [name for name in [*references.SHIPPED, *ESTIMATED] if name not in MEMORYLESS]
ALONE, NETWORKS = ("states", "not finite"), ("numpy", "c", "onnx", "javascript")
TABLE = [
    a_cell(name, back_end, sensor) for name in MEMORYLESS for back_end in BACK_ENDS for sensor in ALONE
] + [
    a_cell(name, back_end, "states") for name in REMEMBERING if name not in ESTIMATED for back_end in BACK_ENDS
] + [
    a_cell(name, each, sensor) for name in REMEMBERING for each in WHOLE for sensor in COLUMNS
] + [
    a_cell(name, back_end, "states") for name in ADAPTIVES for back_end in NETWORKS
]  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory, request):
    """Back ends by name and policy, each made once."""

    @functools.cache
    def page():
        opened = request.getfixturevalue("chromium").new_page()
        opened.add_script_tag(content=policy_script())
        return opened

    @functools.cache
    def make(back_end, name):
        found = BACK_ENDS[back_end].make(policy(name), tmp_path_factory.mktemp(back_end))
        if back_end == "javascript":
            found.page = page()
        return found

    return make


def looped(found, name, times, states, given):
    """A run; with an identifier, one whose motors were given the recording's torques."""
    return found.run(times, states, *([] if policy(name).identifier is None else [within(name, given)]))


@pytest.mark.parametrize(("name", "back_end", "sensor"), TABLE)
def test_torques(made, name, back_end, sensor):
    row, found, joint = BACK_ENDS[back_end], made(back_end, name), policy(name).robot.joint
    if sensor != "states" and name not in MEMORYLESS:
        times, states, expected = recorded(name, LONG if name in ESTIMATED else BRIEF)[sensor]
        both = looped(found, name, times, states, expected)
        torques, broken = both[:, joint], silent(name, states)
        np.testing.assert_allclose(both[~broken], expected[~broken], rtol=0, atol=row.whole_within)
        # After a reset it answers the same, bit for bit.
        again = looped(found, name, times[:100], states[:100], expected[:100])
        np.testing.assert_array_equal(again, both[:100])
    else:
        states = references.random_states()[:: row.stride] if sensor == "states" else references.faults()[1]
        torques, broken = found.alone(states), ~np.isfinite(states).all(axis=1)
        expected = references.alone(references.exact(name), states)
        np.testing.assert_allclose(torques, expected, rtol=0, atol=row.alone_within)
    assert broken.any() == (sensor == "not finite")
    np.testing.assert_array_equal(np.isnan(torques), broken)
    if sensor == "not finite" and name not in MEMORYLESS:
        np.testing.assert_array_equal(both[broken, 1 - joint], 0.0)
    if sensor == "states" and name in references.SHIPPED:
        assert np.ptp(torques) > 6


@pytest.mark.parametrize("back_end", TASK_BACK_ENDS)
@pytest.mark.parametrize("name", references.TASKS)
def test_policies_of_any_task(name, back_end, tmp_path):
    """On 10,000 observations; discrete actions are equal where the best two logits differ by 1e-5."""
    make, share = TASK_BACK_ENDS[back_end]
    found_policy, (observations, expected, lead) = references.task_policy(name), references.task_actions(name)
    found, space = make(found_policy, tmp_path)(observations), found_policy.action_space
    if space.choices:
        np.testing.assert_array_equal(found[lead > 1e-5], expected[lead > 1e-5])
        assert len(np.unique(found)) > 1
        return
    assert (np.abs(found - expected) / (space.high - space.low)).max() < share
    # The bounds of a header in single precision are rounded.
    low, high = (bound.astype("f" if back_end == "c-single" else "d") for bound in (space.low, space.high))
    assert ((found >= low) & (found <= high)).all()
    assert (np.ptp(found, axis=0) / (space.high - space.low)).min() > 0.2


@pytest.mark.parametrize(("back_end", "answer"), [("c", -99), ("c-single", -99), ("onnx", np.nan)])
def test_no_bound_hides_an_observation_that_is_not_finite(back_end, answer, tmp_path):
    """C leaves the action as it was; -99 is its driver's."""
    act = TASK_BACK_ENDS[back_end][0](references.task_policy("tanh"), tmp_path)
    seen = np.array([[0.0, 0.0, 0.0], [0.0, np.inf, 0.0], [np.nan, 0.0, 0.0]])
    np.testing.assert_array_equal(act(seen)[1:], [[answer], [answer]])
    assert np.abs(act(seen)[0]) < 2.0


@pytest.mark.parametrize("name", [references.SHIPPED[0], ADAPTIVES[0], "acrobot-regulated", "pendubot-wrapped"])
def test_self_tests_of_pendulums_in_c(made, name):
    assert made("c", name)._library.self_test() == 0


@pytest.mark.slow  # JAX compiles identifier and regulator for seconds
@pytest.mark.parametrize("sensor", COLUMNS)
@pytest.mark.parametrize("back_end", WHOLE)
@pytest.mark.parametrize("name", ADAPTIVES)
def test_adaptive_loops(made, name, back_end, sensor):
    """In the judge's single precision rounding grows where the torque reacts to the plant found."""
    times, states, expected = recorded(name, ADAPTING)[sensor]
    both, broken = looped(made(back_end, name), name, times, states, expected), silent(name, states)
    distances = np.abs(within(name, both) - within(name, expected))[~broken].max(axis=1)
    if back_end == "jax":
        assert np.median(distances[:BRIEF]) < 1e-4
    else:
        assert distances.max() < FOLLOWED
    joint = policy(name).robot.joint
    np.testing.assert_array_equal(np.isnan(both[:, joint]), broken)
    np.testing.assert_array_equal(both[broken, 1 - joint], 0.0)


def uneven(name):
    """Periods from almost none to more than the estimator, and than the identifier, follow."""
    states = numpy_run(name)[1]
    odds = [0.01, 0.05, 0.05, 0.7, 0.15, 0.02, 0.01, 0.01]
    ratios = np.random.default_rng(0).choice([1e-6, 0.5, 0.7, 1.0, 1.2, 1.7, 3.5, 4.5], len(states), p=odds)
    return np.cumsum(ratios) * DT, states


def old(name):
    """Angles of three calls ago, where calls come late."""
    times, states = numpy_run(name)[:2]
    later = np.cumsum(np.random.default_rng(0).choice([1.0, 1.6], len(times), p=[0.9, 0.1])) * DT
    measured = np.stack([np.interp(later, times, column) for column in states.T], axis=1)
    return later, np.concatenate([measured[:3], measured[:-3]])


def broken(name):
    """A pause, a clock set back, a jump, and what is not finite, after a motion; then the motion goes on."""
    (times, states, _), (later, between) = numpy_run(name), references.faults()
    times = np.concatenate([times, times[-1] + DT + later, times[-1] + 1 + times[:200]])
    states = np.concatenate([states, between, states[-200:]])
    states[300, 0] = 1e7
    return times, states


def plain(name):
    """The swing-up with a noisy sensor, and the regulator near the top."""
    times, states, _ = numpy_run(name)
    assert from_upright(states[-1]) < 0.2
    return times, states


def rubbing(name):
    """Friction of both joints and offsets of both angles: both motors act."""
    plant = dataclasses.replace(policy(name).plant, cf1=0.1, cf2=0.1)
    found = numpy_controller(policy(name))
    times, states, torques = references.numpy_loop(found, steps=BRIEF, plant=plant, wrong=(0.03, -0.02))
    assert np.abs(torques[:, 1 - policy(name).robot.joint]).max() > 0.1
    assert np.abs(found.inner.identified_plant.offsets).min() > 0.002
    return times, states


def from_upright(states):
    """The largest distance of an angle (rad)."""
    return np.abs((states[..., :2] - [np.pi, 0] + np.pi) % (2 * np.pi) - np.pi).max()


PENDUBOTS = [pytest.param(ADAPTIVES[1], change, marks=pytest.mark.slow) for change in (plain, rubbing)]


@pytest.mark.parametrize(
    ("name", "change"), [*((ADAPTIVES[0], each) for each in (plain, uneven, old, broken, rubbing)), *PENDUBOTS]
)
def test_adaptive_loops_in_c_are_numpys(made, name, change):
    found, numpys = made("c", name), made("numpy", name)
    times, states = change(name)
    expected = numpys.run(times, states)
    both, joint = looped(found, name, times, states, expected), policy(name).robot.joint
    np.testing.assert_allclose(both, expected, rtol=0, atol=FOLLOWED)
    np.testing.assert_array_equal(np.isnan(both[:, joint]), silent(name, states))
    np.testing.assert_array_equal(both[silent(name, states), 1 - joint], 0.0)
    np.testing.assert_array_equal(looped(found, name, times[:100], states[:100], expected[:100]), both[:100])
    assert np.nanmax(both[:, joint]) - np.nanmin(both[:, joint]) > 3
    # It has learned something.
    learned = np.array(numpys.controller.inner.identified_plant.theta[:4]) / base_parameters(policy(name).plant)[:4]
    assert change is plain or np.abs(learned - 1).max() > 1e-3


def test_the_estimators_plant_is_the_policys(made):
    """A plant with friction and rotors: C's motion model beside NumPy's, and neither is the leaderboards'."""
    times, states, expected = numpy_run("acrobot-friction")
    found = made("c", "acrobot-friction").run(times, states)
    np.testing.assert_allclose(found, expected, rtol=0, atol=BACK_ENDS["c"].whole_within)
    assert np.abs(made("c", ESTIMATED[0]).run(times, states) - expected).max() > 0.02


TIMES = DT * np.arange(600)
PHASE = 7.0 * TIMES[:, None] + [0.0, 1.0]
SWAY = np.concatenate([[0.05, 0.12] * np.sin(PHASE), [0.35, 0.84] * np.cos(PHASE)], axis=1)
"""A motion about the top, by hand."""


@pytest.mark.parametrize("name", ["acrobot-regulated", "acrobot-rough"])
def test_the_regulator_takes_over_alike(made, name):
    """A sway that grows and fades twice: the regulator leaves and enters again."""
    states = UPRIGHT + 8 * np.abs(np.sin(2 * np.pi * TIMES / 1.2))[:, None] * SWAY
    numpys, cs = (made(back_end, name).run(TIMES, states) for back_end in ("numpy", "c"))
    alone = numpy_controller(dataclasses.replace(policy(name), regulator=None))
    policys = np.array([alone(x, t) for x, t in zip(states, TIMES, strict=True)])
    np.testing.assert_allclose(cs, numpys, rtol=0, atol=BACK_ENDS["c"].whole_within)
    acts = np.abs(numpys - policys)[:, 1] > 1e-9
    assert acts[0]
    assert (np.diff(acts.astype(int)) != 0).sum() >= 3


@pytest.mark.parametrize("back_end", ["numpy", "c"])
def test_a_regulator_that_acts_hides_no_broken_measurement(made, back_end):
    """An infinite rate must not become the largest torque; ``test_regulator.py`` has JAX's."""
    broken = np.where(np.isfinite(references.UNSOUND), UPRIGHT, references.UNSOUND)
    states = np.stack([np.broadcast_to(UPRIGHT, broken.shape), broken], axis=1).reshape(-1, 4)
    torques = made(back_end, "acrobot-regulated").run(DT * np.arange(len(states)), states)[:, 1]
    # It acts at each good state: the policy would command a torque there.
    assert abs(references.alone(references.exact("acrobot-sighted"), states[:1])[0]) > 0.1
    np.testing.assert_allclose(torques[::2], 0.0, atol=1e-9)
    assert np.isnan(torques[1::2]).all()


def test_the_regulator_is_told_what_is_found_alike(made):
    """The plant found changes the regulator's torque by newton metres."""
    numpys, cs = (made(back_end, "acrobot-told").run(TIMES, UPRIGHT + SWAY) for back_end in ("numpy", "c"))
    np.testing.assert_allclose(cs, numpys, rtol=0, atol=1e-8)
    for part in ("identifier", "regulator"):
        untold = numpy_controller(dataclasses.replace(policy("acrobot-told"), **{part: None}))
        torques = np.array([untold(x, t) for x, t in zip(UPRIGHT + SWAY, TIMES, strict=True)])
        assert np.median(np.abs(numpys - torques)[:, 1]) > 1.0


@pytest.mark.slow
@pytest.mark.parametrize("period", [0.001, 0.0025, 0.005])
@pytest.mark.parametrize("name", ADAPTIVES)
def test_the_adaptive_policies_hold_at_other_rates(name, period):
    _, states, _ = references.numpy_loop(numpy_controller(policy(name)), period, steps=round(4.0 / period))
    assert from_upright(states[-round(1.0 / period) :]) < 0.05


def test_graphs_take_batches_of_any_size(made):
    found, states = made("onnx", "acrobot-ar-eapo"), references.random_states()[:1000]
    single = [found.alone(x[None])[0] for x in states]
    np.testing.assert_allclose(single, found.alone(states), rtol=0, atol=references.TOLERANCE)
    assert found.alone(states[:0]).shape == (0,)


@pytest.mark.parametrize("back_end", ["numpy", "c"])
def test_a_loop_may_call_twice_at_one_time(made, back_end):
    found, (times, states, _) = made(back_end, ESTIMATED[0]), numpy_run(ESTIMATED[0])
    once, twice = found.run(times, states), found.run(np.repeat(times, 2), np.repeat(states, 2, axis=0))
    for calls in (twice[::2], twice[1::2]):
        np.testing.assert_array_equal(calls, once)
    # A clock that stops holds no torque for ever, nor where it stops at an early call.
    for first in (0.0, -0.001):
        times = np.append(first, np.zeros(29))
        still = found.run(times, states[200:230])[:, policy(ESTIMATED[0]).robot.joint]
        assert np.ptp(still[:11]) == 0 < np.ptp(still[10:])
    # What a spoilt sample gave is not kept.
    spoilt = found.run([0.0, 0.001, 0.002], [np.full(4, np.nan), states[0], states[0]])
    assert np.isfinite(spoilt[1:]).all()


BINARY = 2.0**-9
"""A period near 2 ms (s). It has few digits: times with and without the shift differ by it to the last bit."""


@pytest.mark.slow
@pytest.mark.parametrize("name", ADAPTIVES)
def test_clocks_that_count_from_an_epoch(name, tmp_path):
    """In NumPy and C; a period that the clock rounds, by 1e-4 s at most, is rounded alike for both."""
    times, states, expected = numpy_run(name, BINARY)
    given = within(name, expected)
    numpys, cs = (BACK_ENDS[each].make(policy(name), tmp_path) for each in ("numpy", "c"))
    torques = cs.run(times, states, given)
    for epoch in (1e9, 1.76e9, 2.0**32, 1.76e12, -1e9):
        np.testing.assert_array_equal(numpy_run(name, BINARY, epoch)[2], expected)
        np.testing.assert_array_equal(cs.run(times + epoch, states, given), torques)
        rounded = (DT * np.arange(len(times)) + epoch, states, given)
        np.testing.assert_allclose(cs.run(*rounded), numpys.run(*rounded), rtol=0, atol=1e-6)


@pytest.mark.slow  # JAX compiles identifier and regulator for seconds
@pytest.mark.parametrize(("policy", "within"), [(ADAPTIVE, 1e-2), (AR_EAPO, 1e-4)])
def test_scores(either_robot, policy, within):
    name = either_robot.name
    score = swingup.judge(get_controller(policy, name), name).criteria.score
    assert score > ({"acrobot": 0.699, "pendubot": 0.694}[name] if policy == ADAPTIVE else 0.3)
    in_numpy = swingup.judge(load_controller(policy, name), name).criteria.score
    assert in_numpy == pytest.approx(score, abs=within)


@pytest.mark.parametrize("back_end", [pytest.param("jax", marks=pytest.mark.slow), "numpy", "c", "onnx"])
def test_encoders_zeros_are_subtracted(back_end, tmp_path):
    """Angles from zeros of 40 and -30 mrad give the torques of angles from 0, before an estimator as well."""
    own, zeros = policy(ESTIMATED[0]), [0.04, -0.03, 0.0, 0.0]
    states, times = references.random_states()[:40] * [0.3, 0.3, 0.1, 0.1], DT * np.arange(40)
    plants, found = (own.plant, own.plant.changed(zero1=zeros[0], zero2=zeros[1])), []
    for index, plant in enumerate(plants):
        (folder := tmp_path / str(index)).mkdir()
        made, shown = (
            BACK_ENDS[back_end].make(dataclasses.replace(own, plant=plant), folder),
            states + index * np.array(zeros),
        )
        found.append(made.alone(shown) if back_end == "onnx" else made.run(times, shown))
    assert np.abs(found[0]).max() > 0.1
    np.testing.assert_allclose(found[1], found[0], atol=1e-5)
