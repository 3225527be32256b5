"""Judging on plants other than the leaderboards'."""

import dataclasses
import logging

import numpy as np
import pytest

from swingup import get_controller, judge, score
from swingup.benchmark.board import Setting
from swingup.benchmark.boards import ICRA_REAL, ROBUSTNESS, UPTIME
from swingup.benchmark.boards import PERFORMANCE as BOARD
from swingup.benchmark.plausibility import examine
from swingup.benchmark.runner import prepare
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, get_robot
from swingup.plant.units import scaled, scales_of

from .forged import REST, moved

ACROBOT = get_robot("acrobot")
B0 = load_plant("B.0").frictionless()
PERFORMANCE = dataclasses.replace(BOARD, duration=0.1)


def hanging(x, t):
    return [0.0, 0.0]


def test_torques_end_at_the_plants_limit():
    rows = judge(lambda x, t: [0.0, 1.0], "acrobot", PERFORMANCE, plant="cloudpendulum-rods").trajectory
    assert np.abs(rows.u).max() == 0.13


def test_friction_that_one_step_of_rk4_cannot_hold_is_integrated_in_several():
    """λ dt = 4.07, where RK4 diverges above 2.79. The elbow creeps: cf arctan(100 dq2) is near the torque."""
    stiff = dataclasses.replace(load_plant("cloudpendulum-rods"), cf1=3e-4, cf2=3e-4)
    trajectory = judge(lambda x, t: [0.0, 1.5e-4], "acrobot", PERFORMANCE, plant=stiff).trajectory
    # tan(1.5e-4 / 3e-4) / 100 = 0.0055 rad/s.
    assert trajectory.x[-10:, 3] == pytest.approx(np.full(10, 0.0055), abs=5e-4)


def test_lengths_decide_what_is_up():
    # Upright, or with the second link level: the tip of C.1 is then at 0.2 m of 0.5, B.0's at 0.3 of 0.7.
    up, level = moved((np.pi, 0.0, 0.0)), moved((np.pi, 0.0, 0.0), (np.pi / 2, 0.0, 0.0))
    found = score(up, "acrobot", plant=B0, force=True)
    assert (found.successes, found.runs[0].tip.reach) == (1, pytest.approx(0.7))
    assert not score(level, "acrobot", plant=B0).successes


def test_a_recording_is_examined_by_its_plant():
    heavy = dataclasses.replace(B0, tl2=1.0)
    rows = dataclasses.replace(moved(REST), u=np.tile([0.0, 2.0], (5000, 1)))
    for plant, warns in ((heavy, True), (B0, False)):
        assert ("torque_limit" in [each.name for each in examine(rows, ACROBOT, BOARD, plant)]) is warns


def test_disturbances_are_in_the_plants_own_units(similar):
    """A pendulum of T × 0.5 and torques × 0.025."""
    plant = similar(LEADERBOARD.driven(ACROBOT))
    units = scales_of(plant)
    grid = ROBUSTNESS.on(Setting(ACROBOT, plant))
    ends = {name: grid.model[name].sweep.high for name in ("Ir", "b1", "cf2", "m2")}
    own = {"Ir": 1e-4 * 0.025 * 0.25, "b1": 0.1 * 0.025 * 0.5, "cf2": 0.2 * 0.025, "m2": 1.25}
    assert ends == pytest.approx(own)
    sweeps = grid.velocity_noise, grid.torque_noise, grid.torque_response, grid.delay
    assert [each.high for each in sweeps] == pytest.approx([0.5 * 2, 1.1 * 0.025, 2.0, 0.04 * 0.5])
    pushes = grid.perturbations
    assert (*pushes.amplitude, *pushes.width) == pytest.approx((0.0125, 0.125, 0.025, 0.05))
    assert grid.tolerance == pytest.approx((0.35, 0.35, 2.0, 2.0))
    thrown = scaled(UPTIME, units)
    pid = thrown.thrower
    # kp θ and kd θ / T are torques; ki has one more 1/T.
    assert (pid.kp, pid.ki, pid.kd, pid.limit) == pytest.approx((0.25, 0.005, 0.0125, 0.15))
    assert (pid.dt, thrown.throw_duration) == pytest.approx((0.001, 0.1))
    # The real robot's PID has a limit of 3 N m for its proportional part.
    assert scaled(ICRA_REAL, units).thrower.proportional_limit == pytest.approx(0.075)


def test_a_policy_for_another_plant_says_so_once(caplog):
    with caplog.at_level(logging.WARNING):
        for _ in range(2):
            for plant in ("leaderboard", "A.0"):
                parameters = load_plant(plant).driven("acrobot")
                prepare(get_controller("ar-eapo", "acrobot"), ACROBOT, "ar-eapo", parameters)
    assert len(caplog.messages) == 1
    assert "controller 'ar-eapo': the policy was made for a plant 'leaderboard' with" in caplog.messages[0]
