"""Baselines that are designed for other plants, and swing-ups that are continued to them."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import swingup
from swingup.benchmark.boards import ROBUSTNESS
from swingup.benchmark.robustness_board import upright
from swingup.benchmark.rollout import Scenario
from swingup.benchmark.runner import run_one
from swingup.controllers.baselines import baselines
from swingup.controllers.baselines.baselines import baseline, design_of, in_real_units, shipped_reference
from swingup.controllers.baselines.continuation import (
    ContinuationSettings,
    accepted,
    continue_swingups,
    nominal_swingups,
)
from swingup.controllers.baselines.settings import OPTIMAL_SETTINGS, PUBLISHED_SETTINGS, optimal_for, published_for
from swingup.controllers.baselines.upright import LQR
from swingup.controllers.stack.regulator import RegulatingController
from swingup.controllers.swingups.reference import Reference
from swingup.dynamics.dynamics import UPRIGHT
from swingup.dynamics.integrate import rk4_step
from swingup.plant.base_parameters import base_parameters
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, get_robot
from swingup.plant.units import scales_of

ACROBOT = get_robot("acrobot")
NOMINAL = LEADERBOARD.driven(ACROBOT)


def test_a_step_keeps_its_real_length(robot):
    found = published_for(PUBLISHED_SETTINGS[robot.name], 0.5)
    assert (found.swingup.dt, found.swingup.steps) == (0.002, 3000)
    assert (found.mpc.dt, found.mpc.horizon) == (0.004, 50)
    # A coarse step is a whole number of fine ones, here 2 instead of 5.
    score = optimal_for(OPTIMAL_SETTINGS[robot.name], 0.5).swingup
    assert (score.dt, score.steps) == (0.004, 2 * score.search.steps)
    assert score.dt * score.steps == pytest.approx(0.002 * OPTIMAL_SETTINGS[robot.name].swingup.steps, abs=0.004)


def test_plants_that_move_alike_have_the_same_controller(robot, similar, x64):
    """T × 0.5 and torques × 0.025: the shipped one's torque, in the plant's own units."""
    plant = LEADERBOARD.driven(robot)
    assert design_of(robot, load_plant("C.1").frictionless()).shipped
    assert not design_of(robot, load_plant("C.1")).shipped
    published, own = (baseline("lqr", robot, each) for each in (LEADERBOARD, similar(plant)))
    for error in np.random.default_rng(0).normal(size=(5, 4)) * 0.01:
        x = UPRIGHT + error
        u, expected = own(own.init(), 0.0, x * [1, 1, 2, 2])[1], published(None, 0.0, x)[1]
        np.testing.assert_allclose(u, 0.025 * expected, rtol=1e-8)


def test_a_swing_up_is_saved_in_real_units(x64, robot, similar):
    plant = similar(LEADERBOARD.driven(robot))
    shipped = shipped_reference(robot, "score")[0]
    own = in_real_units(shipped, scales_of(plant))
    assert own.dt == 0.001
    u = own.torque[:, None] * np.array(robot.actuation)
    following = jax.jit(jax.vmap(lambda x, u: rk4_step(plant, x, u, 0.001)))(own.states[:-1], u[:-1])
    np.testing.assert_allclose(own.states[1:], following, atol=1e-9)
    # A feedback of q1 by 1 rad is as large a share of the limit; one of dq1 by 1 rad/s is half of that.
    np.testing.assert_allclose(own.gains, shipped.gains * [0.025, 0.025, 0.0125, 0.0125], rtol=1e-8)


@pytest.mark.parametrize(
    "name", ["lqr", "tvlqr", "ilqr-riccati", "tvlqr-score", pytest.param("ilqr-mpc", marks=pytest.mark.slow)]
)
def test_baselines_command_what_the_plants_own_motor_has_and_no_more(name, robot, x64, monkeypatch):
    def resting(design, problem):
        rows = np.zeros((400, 4))
        return Reference(design.robot, 0.001, rows, rows[:, 0], np.ones_like(rows))

    # Any trajectory does: a swing-up takes a minute to compute.
    monkeypatch.setattr(baselines, "_computed_reference", resting)
    plant, random = load_plant("cloudpendulum"), np.random.default_rng(0)
    controller = baseline(name, robot, plant)
    # From errors that hardly count to those that ask for more than any motor has; near upright for the LQR.
    sizes = 10 ** random.uniform(-4, 5, (2000, 1)) * [1, 1, 1, 1]
    states = UPRIGHT * (name == "lqr") + sizes * random.normal(size=(2000, 4)) * [name != "lqr", 1, 1, 1]
    torques = np.asarray(jax.jit(jax.vmap(lambda x: controller(controller.init(), jnp.zeros(()), x)[1]))(states))
    assert np.abs(torques[:, robot.joint]).max() == (plant.tl1, plant.tl2)[robot.joint]
    assert not torques[:, 1 - robot.joint].any()


def test_friction_of_the_driven_joint_is_compensated(robot, similar, x64):
    plant = similar(LEADERBOARD.driven(robot))
    cf = {f"cf{robot.joint + 1}": 0.02}
    plain, own = (baseline("lqr", robot, each) for each in (plant, plant.changed(**cf)))
    x = UPRIGHT + np.array([1e-3, 0.0, 0.1, -0.1])
    expected = plain(plain.init(), 0.0, x)[1] + 0.02 * np.arctan(100 * x[2:]) * robot.actuation
    np.testing.assert_allclose(own(own.init(), 0.0, x)[1], expected, rtol=1e-8)


def test_the_top_counts_on_the_passive_joints_friction(robot):
    """It is the policies' regulator, for the plant with this friction, and the published LQR without."""
    own = design_of(robot, load_plant("A.0"))
    top = baseline("lqr", robot, "A.0").controller
    assert isinstance(top, RegulatingController)
    np.testing.assert_array_equal(top.base, base_parameters(own.with_friction))
    assert isinstance(baseline("lqr", robot, load_plant("A.0").frictionless()).controller, LQR)


@pytest.mark.slow
def test_a_swing_up_stands_in_spite_of_friction(caplog):
    """B.0's motor is weaker than gravity, and both joints have dry friction."""
    assert swingup.judge(baseline("tvlqr", "pendubot", "B.0"), "pendubot", plant="B.0").criteria.success
    assert "is computed for this plant" in caplog.text


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tvlqr", "ilqr-mpc", "tvlqr-score"])
def test_baselines_swing_up_other_plants(name):
    plant = load_plant("C.0").frictionless()
    assert scales_of(plant).time == pytest.approx(0.971, abs=1e-3)
    assert swingup.judge(baseline(name, "acrobot", plant), "acrobot", plant=plant).criteria.success


SETTINGS = ContinuationSettings()


def stacked(*plants):
    return jax.tree.map(lambda *values: np.array(values, float), *plants)


def test_nominal_swing_ups_are_the_shipped_one_and_then_rest(robot):
    found, shipped = nominal_swingups(robot, 3, SETTINGS), shipped_reference(robot, "score")[0]
    rows = len(shipped.torque) + 100  # 0.2 s of 2 ms
    shapes = found.states.shape, found.torque.shape, found.gains.shape
    assert shapes == ((3, rows + 1, 4), (3, rows), (3, rows, 4))
    np.testing.assert_array_equal(found.states[1, :-101], shipped.states)
    np.testing.assert_array_equal(found.states[2, -101:], np.tile(UPRIGHT, (101, 1)))
    np.testing.assert_array_equal(found.torque[0, -100:], 0.0)
    np.testing.assert_array_equal(found.reached, 0.0)
    follow = found.reference(1)
    assert (follow.states.shape, follow.gains.shape, follow.dt) == ((rows, 4), (rows, 4), shipped.dt)


def test_a_swing_up_counts_if_it_is_cheap_slow_upright_finite_and_within_the_motors_torque():
    nominal = nominal_swingups(ACROBOT, 7, SETTINGS)
    states, torque, gains = nominal.states.copy(), nominal.torque.copy(), nominal.gains.copy()
    states[1, -1, 0] += 0.16
    states[2, -1, 3] = np.nan
    torque[3, 100] = -6.1
    gains[4, 0, 0] = np.inf
    states[6, 100, 3] = 14.1
    cost = np.array([0.24, 0.24, 0.24, 0.24, 0.24, 0.26, 0.24])
    tried = dataclasses.replace(nominal, states=states, torque=torque, gains=gains, cost=cost)
    np.testing.assert_array_equal(accepted(tried, SETTINGS), [True, *[False] * 6])


@pytest.mark.slow
def test_three_plants_are_continued_and_end_upright_on_their_plant():
    heavy = dataclasses.replace(NOMINAL, m2=1.1 * NOMINAL.m2)
    rough = dataclasses.replace(NOMINAL, b1=0.03, cf2=0.02, Ir=3e-5)
    settings = dataclasses.replace(SETTINGS, batch=16)
    found = continue_swingups(ACROBOT, stacked(NOMINAL, heavy, rough), settings)
    np.testing.assert_array_equal(found.reached, 1.0)
    # With more time and a softer end the optimum takes the shipped swing-up's path, and comes to rest later.
    shipped = shipped_reference(ACROBOT, "score")[0].states[:, None, :2]
    distance = np.abs(shipped - found.states[0, :, :2]).max(axis=2).min(axis=1)
    assert distance.max() < 0.1
    for index, plant in enumerate((NOMINAL, heavy, rough)):
        controller = found.controller(index, plant)
        rows = run_one(controller, Scenario(plant), ROBUSTNESS.dt, ROBUSTNESS.steps)
        assert upright(rows.x[-1:], ROBUSTNESS.tolerance).all()
