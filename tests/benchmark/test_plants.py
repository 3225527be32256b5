"""Judging on other plants than the leaderboards', and of controllers in plain Python that fail or cannot run."""

import dataclasses
import logging

import jax.numpy as jnp
import numpy as np
import pytest

from refusals import refusal
from swingup import get_controller, judge, score
from swingup.benchmark.board import Setting
from swingup.benchmark.boards import ICRA_REAL, ROBUSTNESS, SIM2REAL, UPTIME
from swingup.benchmark.boards import PERFORMANCE as BOARD
from swingup.benchmark.judge import make_setting
from swingup.benchmark.plausibility import examine
from swingup.benchmark.robustness_board import change_grid
from swingup.benchmark.runner import prepare
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, get_robot
from swingup.plant.units import scaled, scales_of

from .controllers import BRIEF, SWINGING, Counting, Memoryless, PlainCounting, swinging
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


def test_a_recording_and_a_simulation_of_a_plant_have_the_same_limits():
    """In the plant's own units, of which C.1's 20 rad/s are some others."""
    recorded, simulated = (
        SIM2REAL.on(each) for each in (Setting(ACROBOT, B0), make_setting(ACROBOT, SIM2REAL, B0))
    )
    assert recorded.limits == simulated.limits != SIM2REAL.limits


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


def loose(*criteria, tolerance=(9.0, 9.0, 1e9, 1e9), duration=0.1):
    """The grid's rules with other runs and with an end that is easy to meet."""
    return dataclasses.replace(BRIEF, criteria=criteria, tolerance=tolerance, duration=duration)


def test_a_controller_that_breaks_loses_only_the_simulations_in_which_it_does():
    # NaN when it sees a delay of more than ten steps by the velocity it is shown at the start.
    breaking = Memoryless(lambda t, x: jnp.where((t > 0.021) & (x[3] == 0), jnp.nan, 1.0) * jnp.array([0.0, 1.0]))
    result = judge(breaking, "acrobot", loose("delay"))
    # With a delay of 11 steps or more the first state, at rest, is still seen at t = 0.022 s, in step 11.
    assert [run.success for run in result.runs] == [True] * 11 + [False] * 10
    assert len(result.faults) == 10
    assert "not finite" in result.faults[0].fault
    assert "fault" in result.as_dict()["details"][-1]


class Uncopyable(PlainCounting):
    """As a handle into another library would be."""

    def __deepcopy__(self, memo):
        raise TypeError("no copies")


@pytest.mark.parametrize(
    ("source", "twin"),
    [
        (swinging, SWINGING),
        pytest.param(PlainCounting(), Counting(), marks=pytest.mark.slow),
        pytest.param(Uncopyable(), Counting(), marks=pytest.mark.slow),
    ],
    ids=["function", "object", "one by one"],
)
def test_plain_python_gets_the_same_table(source, twin):
    rules = loose("velocity_noise", "delay", tolerance=(3.2, 2.0, 9.0, 9.0), duration=0.3)
    rules = change_grid(change_grid(rules, "velocity_noise=0:0.5:5:3"), "delay=0:0.04:5")
    found, expected = (judge(each, "acrobot", rules, seed=1) for each in (source, twin))
    assert [run.success for run in found.runs] == [run.success for run in expected.runs]


def test_a_plain_controller_that_raises_loses_that_simulation():
    def fragile(x, t):
        if abs(x[3]) > 0.2:
            raise RuntimeError("too fast")
        return [0.0, 0.0]

    result = judge(fragile, "acrobot", change_grid(loose("velocity_noise"), "velocity_noise=0:0.5:2:2"))
    assert [run.success for run in result.runs] == [True, True, False, False]
    assert "RuntimeError (too fast) at t = " in result.runs[3].fault


class Starting:
    def reset(self):
        raise OSError("no device")

    def get_control_output(self, x, t):
        return [0.0, 0.0]


ONE_TORQUE = Memoryless(lambda t, x: jnp.sin(t))
# inf times 0 is NaN on the passive joint; the driven joint's torque would be clipped to 6 N m.
INFINITE = Memoryless(lambda t, x: jnp.where(t > 0.0199, jnp.inf, 0.0) * jnp.array([0.0, 1.0]))


@pytest.mark.parametrize(
    ("source", "board", "named"),
    [
        *((ONE_TORQUE, board, "its torque has shape ()") for board in ("performance", "robustness", "uptime")),
        (INFINITE, "performance", "it gave a torque that is not finite at t = 0.02 s"),
        (Starting(), "performance", "its reset() raised OSError (no device)"),
    ],
)
def test_controllers_that_fail_everywhere_are_named(source, board, named):
    """What is wrong with them is the checker's to tell (tests/controllers/test_check.py)."""
    assert f"controller 'mine': {named}" in refusal(judge, source, "acrobot", board, name="mine")
