"""How far from upright a motor brings a pendulum back: closed forms, and the linear system itself."""

import dataclasses
import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from swingup.controllers.baselines.lqr import linearised
from swingup.dynamics.angles import UPRIGHT
from swingup.plant.plant import LEADERBOARD
from swingup.plant.robots import get_robot

holding_range = runpy.run_path(str(Path(__file__).parents[1] / "benchmarks" / "holding_range.py"))["holding_range"]

ACROBOT, PENDUBOT = get_robot("acrobot"), get_robot("pendubot")
NOMINAL = LEADERBOARD.driven(ACROBOT)


def gap(I1, plant):
    """p (A - B + p l1) - k (B + p l1), with the inertias A = I1 + I2 + m2 l1² of the shoulder and B = I2."""
    p, k = plant.m2 * plant.r2, plant.m1 * plant.r1 + plant.m2 * plant.l1
    A, B = I1 + plant.I2 + plant.m2 * plant.l1**2, plant.I2
    return p * (A - B + p * plant.l1) - k * (B + p * plant.l1)


def test_an_acrobot_with_a_mode_that_its_motor_does_not_move():
    critical = brentq(gap, 0.0, 1.0, args=(NOMINAL,))
    ranges = [
        holding_range(dataclasses.replace(NOMINAL, I1=critical * factor), ACROBOT) for factor in (0.99, 1.0, 1.01)
    ]
    assert ranges[1] < 1e-9
    assert min(ranges[0], ranges[2]) > 1e-3


def test_the_pendubot_has_none():
    for factor in np.linspace(0.5, 3.0, 11):
        plant = LEADERBOARD.driven(PENDUBOT)
        assert holding_range(dataclasses.replace(plant, I1=factor * plant.I1), PENDUBOT) > 0.3


@pytest.mark.parametrize("robot", [ACROBOT, PENDUBOT], ids=lambda robot: robot.name)
def test_within_the_range_the_largest_torque_turns_the_slowest_mode_back(robot):
    plant = LEADERBOARD.driven(robot)
    most, limit = holding_range(plant, robot), 6.0
    (A,), (B,) = linearised(plant, robot, UPRIGHT[None], np.zeros(1))
    # Of both unstable modes, the one with the least |w b| / λ.
    rates, modes = np.linalg.eig(A.T)
    scaled = np.abs(B @ (modes / modes[0])) * limit
    which = int(np.argmin(np.where(rates > 0, np.abs(scaled - most * rates), np.inf)))
    assert scaled[which] == pytest.approx(most * rates[which])
    w = modes[:, which].real / modes[0, which].real
    both = np.block([[A, B[:, None]], [np.zeros((1, 5))]])
    for share, returns in ((0.99, True), (1.01, False)):
        # A state of this mode alone: w e = share · most, and 0 along the other left eigenvectors.
        start = np.linalg.inv(modes.T)[:, which].real
        start *= share * most / (w @ start)
        end = expm(0.05 * both) @ np.append(start, -np.sign(w @ B) * limit)
        assert (abs(w @ end[:4]) < share * most) == returns
