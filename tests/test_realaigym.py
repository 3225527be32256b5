"""Controllers called as the interface of RealAIGym's simulator says."""

import dataclasses
import json

import numpy as np
import pytest

import swingup
from refusals import refusal
from swingup.benchmark.boards import PERFORMANCE
from swingup.controllers.registry import get_controller
from swingup.policy.shipped import is_policy
from swingup.runtime import load_controller


def wrapped(name, robot):
    """A policy, or a baseline that JAX computes."""
    if is_policy(name):
        return swingup.RealAIGymController(load_controller(name, robot), name)
    return swingup.RealAIGymController(swingup.loop_controller(get_controller(name, robot), robot), name)


DT = 0.002


def test_calls_as_in_realaigyms_simulator(either_robot):
    """By keywords, in order, and by the inner forms: nothing of a run before is left. The judge's run is closed."""
    controller = wrapped("ar-eapo", either_robot.name)
    run = swingup.judge(controller, either_robot.name, dataclasses.replace(PERFORMANCE, duration=0.6)).trajectory
    assert np.ptp(run.u[:, either_robot.joint]) > 3.0
    ways = (
        ("", lambda x, t: controller.get_control_output(x=x, t=t)),
        ("", lambda x, t: controller.get_control_output(x.tolist(), t)),
        ("_", lambda x, t: controller.get_control_output_(x, t)),
    )
    for end, call in ways:
        getattr(controller, f"reset{end}")()
        getattr(controller, f"init{end}")()
        for t, x, expected in zip(run.time, run.x, run.u, strict=True):
            u = call(x, t)
            np.testing.assert_allclose(u, expected, atol=1e-9)
            u += 1.0  # the loop adds noise to the answer, in place
        if end == "":
            assert len(controller.u_hist) == len(run.u) + 1
            np.testing.assert_array_equal(controller.u_hist[0], [0, 0])
            np.testing.assert_allclose(controller.u_hist[1:], run.u, atol=1e-9)
            np.testing.assert_array_equal(controller.x_hist, run.x)
            np.testing.assert_array_equal(controller.filter.x_hist, run.x)
            assert len(controller.u_fric_hist) == len(controller.u_grav_hist) == len(run.u)
    controller.init()
    assert (len(controller.u_hist), controller.filter.x_hist) == (1, [])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tvlqr", "ilqr-riccati", "tvlqr-score"])
def test_baselines_score_as_they_do_in_jax(name):
    controller = wrapped(name, "pendubot")
    ours, judged = (swingup.judge(each, "pendubot") for each in (controller, get_controller(name, "pendubot")))
    np.testing.assert_allclose(ours.trajectory.u, judged.trajectory.u, atol=1e-9)
    assert ours.criteria.score == pytest.approx(judged.criteria.score, abs=1e-9)


def test_the_checker_finds_nothing_and_names_another_robot():
    for name in ("ar-eapo", "tvlqr"):
        assert swingup.check_controller(wrapped(name, "acrobot"), "acrobot") == []
    findings = swingup.check_controller(wrapped("tvlqr", "acrobot"), "pendubot")
    assert findings == ["it is for the acrobot, not the pendubot: judge it there"]


def test_settings_and_what_is_harmless(tmp_path):
    controller = wrapped("ar-eapo", "acrobot")
    plain = controller.get_control_output([0.1, 0.2, 1.0, -2.0], 0.0)
    assert plain.dtype == np.float64
    assert plain.shape == (2,)
    assert controller.disturbance_intervals == []
    assert controller.get_forecast() == controller.get_init_trajectory() == ([], [], [])
    for setting in ("set_start", "set_goal", "set_gravity_compensation", "set_parameters"):
        getattr(controller, setting)(np.zeros(4))
    controller.set_filter_args(filt="None", dt=0.002)
    # Friction: 0.01 · 1 + 0.1 atan(100) at the shoulder; 0.02 · -2 + 0.2 atan(-200) at the elbow.
    controller.set_friction_compensation(damping=[0.01, 0.02], coulomb_fric=[0.1, 0.2])
    controller.init()
    friction = [0.01 + 0.1 * 1.5607966601, -0.04 - 0.2 * 1.5657963684]
    with_friction = controller.get_control_output([0.1, 0.2, 1.0, -2.0], 0.0)
    # The passive joint's motor gives nothing here.
    np.testing.assert_allclose(with_friction - plain, [0.0, friction[1]], atol=1e-9)
    np.testing.assert_allclose(controller.u_fric_hist, [friction], atol=1e-9)
    controller.save(tmp_path)
    saved = json.loads((tmp_path / "controller_swingup.json").read_text())
    assert (saved["robot"], saved["controller"], saved["damping"]) == ("acrobot", "ar-eapo", [0.01, 0.02])
    controller.reset()
    controller.init()
    np.testing.assert_array_equal(controller.get_control_output([0.1, 0.2, 1.0, -2.0], 0.0), plain)


class LowPass:
    def __init__(self):
        self.begun = 0

    def init(self):
        self.begun, self.state = self.begun + 1, np.zeros(4)

    def get_filtered_state(self, x, u):
        self.state = 0.5 * self.state + 0.5 * np.asarray(x)
        return self.state


@pytest.mark.parametrize("compensation", [{}, {"damping": [0.1, 0.1], "coulomb_fric": [0.2, 0.2]}])
@pytest.mark.parametrize("name", ["adaptive", "ar-eapo", "tvlqr"])
def test_a_rate_that_is_not_finite_reaches_no_motor(either_robot, name, compensation):
    """Behind an estimator the controller goes on; without one the driven joint's torque is NaN, the other's 0."""
    controller, joint = wrapped(name, either_robot.name), either_robot.joint
    controller.set_friction_compensation(**compensation)
    for step, broken in enumerate([[], [2], [], [3], [2, 3], []]):
        x = np.array([0.3, -0.2, 1.0, -1.0]) + 0.01 * step
        x[broken] = [np.nan, -np.inf][: len(broken)]
        u = controller.get_control_output(x, step * DT)
        assert np.isnan(u[joint]) == (bool(broken) and name != "adaptive")
        assert abs(u[1 - joint]) <= controller.passive_limit
        assert np.abs(u[joint]) <= 6.0 or np.isnan(u[joint])
    assert np.isfinite(controller.u_fric_hist).all()


@pytest.mark.parametrize("kind", ["object", "function"])
def test_a_filter_of_realaigyms_or_a_function(kind):
    x = np.array([0.1, 0.2, 1.0, -2.0])
    controller, low_pass = wrapped("ar-eapo", "acrobot"), LowPass()
    half = controller.get_control_output(0.5 * x, 0.0)
    controller.set_filter(low_pass if kind == "object" else lambda x, u: 0.5 * x)
    for _ in range(2):  # the filter stays, its memory does not
        controller.reset()
        controller.init()
        np.testing.assert_array_equal(controller.get_control_output(x, 0.0), half)
        np.testing.assert_array_equal(controller.filter.x_hist, [x])
        np.testing.assert_array_equal(controller.filter.x_filt_hist, [0.5 * x])
    assert low_pass.begun == (3 if kind == "object" else 0)  # once when it was set
    controller.set_filter()
    assert not np.array_equal(controller.get_control_output(x, 0.0), half)


@pytest.mark.parametrize("name", ["adaptive", pytest.param("tvlqr", marks=pytest.mark.slow)])
@pytest.mark.parametrize("zero", [0.0, -1e6, 1e6, 86_400.0 * 365, 1.7e9, 2.0**31])
def test_a_clock_may_count_from_any_moment(name, zero):
    """A start of the clock that is whole periods changes no torque beyond its rounding; no memory is left."""
    controller, torques = wrapped(name, "pendubot"), []
    for start in (0.0, zero):
        controller.init()
        calls = [controller.get_control_output([0.2 * k * DT, 0.1, 0.2, 0.0], start + k * DT) for k in range(20)]
        torques.append(calls)
    np.testing.assert_allclose(torques[1], torques[0], atol=1e-3 if zero else 1e-12)


@pytest.mark.parametrize("x", [[0.0] * 3, np.zeros((4, 1)), 0.0, None, "1234", [[0.0], [1.0, 2.0]]])
def test_a_state_of_another_shape_is_refused(x):
    controller, filtered = (wrapped("ar-eapo", "acrobot") for _ in range(2))
    assert "damping = [0.1]" in refusal(controller.set_friction_compensation, damping=[0.1])
    filtered.set_filter(lambda *_: x)
    calls = controller.get_control_output, controller.get_control_output_, load_controller("ar-eapo", "acrobot")
    for call in calls:
        assert "pass four numbers, [q1, q2, dq1, dq2]" in refusal(call, x, 0.0)
    assert "pass four numbers" in refusal(filtered.get_control_output, np.zeros(4), 0.0)
