"""Judging from Python: names, rules, and controllers that misbehave."""

import jax.numpy as jnp
import numpy as np
import pytest

import swingup
from policies import lone_policy
from swingup.benchmark.rollout import Trajectory
from swingup.common.errors import SwingupError
from swingup.controllers.interface.controller import AbstractController


class Failing(AbstractController):
    """No torque at first, then NaN."""

    after: float

    def init(self):
        return None

    def __call__(self, carry, t, x):
        return None, jnp.where(t < self.after, 0.0, jnp.nan) * jnp.ones(2)


def test_a_torque_that_is_not_finite_is_named_with_its_time():
    with pytest.raises(SwingupError, match=r"controller 'mine': it gave a torque that is not finite at t = 0\.5 s"):
        swingup.judge(Failing(0.5), "acrobot", name="mine")


def test_without_torque_the_pendulum_hangs():
    result = swingup.judge(Failing(100.0), "pendubot")
    assert (result.robot, result.controller) == ("pendubot", "controller")
    assert result.criteria.score == 0.0
    assert result.criteria.swingup_time is None
    # Hanging at rest is an equilibrium: nothing moves at all.
    assert not np.any(result.trajectory.x)
    assert result.trajectory.x.shape == (5000, 4)
    assert result.trajectory.time[-1] == pytest.approx(9.998)


def test_the_passive_joint_gets_no_torque():
    controller, _ = lone_policy("ar-eapo", "acrobot")
    trajectory = swingup.judge(controller, "acrobot").trajectory
    assert not np.any(trajectory.u[:, 0])
    assert 0.0 < np.abs(trajectory.u[:, 1]).max() <= 6.0
    assert trajectory.x.dtype == trajectory.u.dtype == np.float64


def test_hardware_rules_score_the_same_run_otherwise():
    controller, _ = lone_policy("ar-eapo", "acrobot")
    simulation = swingup.judge(controller, "acrobot")
    hardware = swingup.score(simulation.trajectory, "acrobot", "hardware").criteria
    # Other normalisers for torque and smoothness alone: the criteria are equal, the score is higher.
    assert hardware.energy == simulation.criteria.energy
    assert hardware.score > simulation.criteria.score


@pytest.mark.parametrize(
    ("time", "x", "u", "message"),
    [
        (np.zeros(0), np.zeros((0, 4)), np.zeros((0, 2)), "N of 3 or more"),
        (np.arange(5.0), np.zeros((4, 4)), np.zeros((5, 2)), r"shapes \(5,\), \(4, 4\) and \(5, 2\)"),
        (np.arange(5.0), np.zeros((5, 4)), np.full((5, 2), np.nan), "not finite"),
    ],
)
def test_trajectories_that_cannot_be_scored(time, x, u, message):
    with pytest.raises(SwingupError, match=message):
        swingup.score(Trajectory(time, x, u), "acrobot")


def test_a_policy_of_the_other_robot_is_refused():
    with pytest.raises(SwingupError, match="is for the pendubot, not the acrobot"):
        swingup.judge(lone_policy("ar-eapo", "pendubot")[0], "acrobot")


@pytest.mark.parametrize(
    ("robot", "rules", "message"),
    [("hexapod", "performance", "unknown robot"), ("acrobot", "v1", "unknown board")],
)
def test_unknown_names(robot, rules, message):
    with pytest.raises(SwingupError, match=message):
        swingup.judge(Failing(0.0), robot, rules)
