"""The NumPy runtime against the judge's JAX: torques, the estimator over whole runs, and what it refuses."""

import dataclasses

import numpy as np
import pytest

import swingup
from swingup.control.registry import get_controller
from swingup.errors import SwingupError
from swingup.physics.dynamics import acceleration
from swingup.physics.integrate import midpoint_step
from swingup.physics.parameters import get_robot, leaderboard_parameters
from swingup.policy import plant, realaigym
from swingup.policy.jax_backend.controller import save_controller
from swingup.policy.numpy_backend.controller import RuntimeController
from swingup.policy.settings import FrontEndSettings
from swingup.policy.shipped import read_policy
from swingup.runtime import load_controller

from .loops import DT, SENSORS, TOLERANCE, UNSOUND, in_double, judged_torques, paper_policy, random_states, recorded

ROBOT_NAMES = ("acrobot", "pendubot")


@pytest.mark.parametrize("kind", ["refined", "ar-eapo", "global"])
@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_torques_are_the_judges(name, kind):
    controller = load_controller(kind, name, estimator=False)
    torques = np.array([controller(x, 0.0) for x in random_states()])
    joint = get_robot(name).joint
    # Where both compute in float64, what is left is the order of sums.
    np.testing.assert_allclose(torques[:, joint], judged_torques(name, kind, exact=True), rtol=0, atol=1e-11)
    # The judge's hidden layers sum 64 products in float32 each.
    np.testing.assert_allclose(torques[:, joint], judged_torques(name, kind), rtol=0, atol=TOLERANCE)
    assert not torques[:, 1 - joint].any()
    assert np.ptp(torques[:, joint]) > 6


@pytest.mark.parametrize("kind", ["refined", "ar-eapo", "robot"])
@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_no_torque_hides_a_number_that_is_not_finite(name, kind, x64):
    controller, reference, joint = load_controller(kind, name), get_controller(kind, name), get_robot(name).joint
    for x in UNSOUND:
        controller.reset()
        u, judged = controller(x, 0.0), np.asarray(reference(reference.init(), 0.0, x)[1])
        assert np.isnan([u[joint], judged[joint]]).all()
        np.testing.assert_array_equal(np.isinf(u) | np.isinf(judged), False)


@pytest.mark.parametrize("normalised", [True, False])
def test_the_papers_observation(tmp_path, x64, normalised):
    reference = paper_policy(normalised)
    save_controller(tmp_path / "p.npz", reference, {})
    controller = load_controller(tmp_path / "p.npz", "pendubot")
    for x in random_states()[:50]:
        np.testing.assert_allclose(controller(x, 0.0), reference(None, 0.0, x)[1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_the_estimator_follows_a_recorded_run(name, sensor):
    times, measured, expected = recorded(name, sensor)
    controller, dead_times = load_controller("refined", name), set()
    for steps in (100, len(times)):  # the second time after a reset
        controller.reset()
        for t, x, u in zip(times[:steps], measured, expected, strict=False):
            # Far below what matters: both compute in float64, so that rounding is all there is.
            np.testing.assert_allclose(controller(x, t), u, rtol=0, atol=1e-9)
            dead_times.add(controller._estimator.dead_time)
    assert sensor != "late" or len(dead_times) > 2


@pytest.mark.parametrize("sensor", ["400 Hz", "uneven"])
@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_a_loop_at_another_rate_swings_up_and_holds(name, sensor):
    times, measured, _ = recorded(name, sensor)
    off = np.abs((measured[times > times[-1] - 1, :2] - [np.pi, 0] + np.pi) % (2 * np.pi) - np.pi)
    assert off.max() < 0.1


def test_the_checker_finds_nothing(robot):
    assert swingup.check_controller(load_controller("refined", robot), robot) == []


def test_the_period_is_the_estimators_or_the_front_ends():
    policy = read_policy("robot", "acrobot")
    assert policy.period == DT
    alone = dataclasses.replace(policy, estimator=None, front_end=FrontEndSettings(dt=0.001))
    assert (alone.period, dataclasses.replace(alone, front_end=None).period) == (0.001, None)
    counted, timed = (realaigym.wrap_policy(RuntimeController(alone), "memory") for _ in range(2))
    for step in range(5):
        x = np.full(4, 0.1 * step)
        np.testing.assert_array_equal(counted.get_control_output(x), timed.get_control_output(x, 0.001 * step))


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_the_score_is_the_judges(name):
    in_numpy, in_jax = (
        swingup.evaluate(found, name).criteria.score
        for found in (load_controller("refined", name), get_controller("refined", name))
    )
    assert in_numpy == pytest.approx(in_jax, abs=1e-4)


def test_pauses_jumps_and_what_is_not_finite(x64):
    """Measurements that make the estimator start anew, against JAX call by call."""
    steps = 60
    random = np.random.default_rng(0)
    x = np.cumsum(random.normal(size=(steps, 4)) * [5e-4, 5e-4, 0.1, 0.1], axis=0) + np.array([0.3, 0.2, 0, 0])
    times = DT * np.arange(steps)
    times[20:] += 0.01  # a pause
    times[30:] -= 0.05  # a clock set back
    x[40:, 1] += 1.0  # a jump
    x[45], x[48], x[51, 2] = np.nan, np.inf, 1e200
    reference, controller = in_double(get_controller("refined", "acrobot")), load_controller("refined", "acrobot")
    memory = reference.init()
    for t, measured in zip(times, x, strict=True):
        memory, expected = reference(memory, t, measured)
        np.testing.assert_allclose(controller(measured, t)[1], expected[1], rtol=0, atol=1e-7)
        np.testing.assert_allclose(controller._estimator._state, memory.state, rtol=1e-12, atol=1e-9)


def test_the_plant_is_the_leaderboards(robot, x64):
    p, numbers = leaderboard_parameters(robot), plant.nominal_plant()
    for x, u in zip(random_states()[:20], np.random.default_rng(1).uniform(-6, 6, (20, 2)), strict=True):
        state, (u1, u2) = tuple(x.tolist()), u.tolist()
        np.testing.assert_allclose(plant.acceleration(numbers, state, u1, u2), acceleration(p, x, u), rtol=1e-12)
        np.testing.assert_allclose(
            plant.midpoint_step(numbers, state, u1, u2, 0.01), midpoint_step(p, x, u, 0.01), rtol=1e-12
        )
        response = acceleration(p, x, u) - acceleration(p, x, 0 * u)
        np.testing.assert_allclose(plant.torque_response(numbers, state, u1, u2), response, rtol=1e-9)


def test_flat_yaml():
    text = "# comment\n---\nm1: 0.5 # kg\nname: 'x'\n\nI1: 1e-3\n"
    assert plant.parse_flat_yaml(text) == {"m1": 0.5, "I1": 1e-3}
    for bad in ("m1 0.5", "a:\n  m1: 2"):
        with pytest.raises(SwingupError, match="no line of a flat map: write 'name: value'"):
            plant.parse_flat_yaml(bad)
    with pytest.raises(SwingupError, match="lacks parameter 'm1'"):
        plant.make_plant({})


@pytest.mark.parametrize(
    ("source", "robot", "message"),
    [
        ("refined", None, "shipped for both robots: name acrobot or pendubot"),
        ("refined", "cartpole", "unknown robot 'cartpole'"),
        (
            "tvlqr",
            "acrobot",
            "unknown policy 'tvlqr': use refined, ar-eapo, global, robot or a policy file",
        ),
        ("nothing.npz", "acrobot", "no such file: nothing.npz"),
    ],
)
def test_what_is_refused(source, robot, message):
    with pytest.raises(SwingupError, match=message):
        read_policy(source, robot)
