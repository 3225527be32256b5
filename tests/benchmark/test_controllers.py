"""Controllers of all kinds under the judge: plain Python, failing ones, and ones that cannot run at all."""

import dataclasses

import jax.numpy as jnp
import pytest

from refusals import refusal
from swingup import judge
from swingup.benchmark.robustness_board import change_grid

from .controllers import BRIEF, SWINGING, Counting, Memoryless, PlainCounting, swinging


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
