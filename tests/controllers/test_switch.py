import jax.numpy as jnp
import numpy as np
import pytest

from benchmark.controllers import Memoryless
from swingup.controllers.baselines.switch import AbstractExpensiveController, LatchingSwitch
from swingup.plant.robots import ROBOTS

ACROBOT = ROBOTS["acrobot"]
THRESHOLD = np.array([0.5, 0.5, 1.0, 1.0])
AWAY = np.array([0.0, 0.0, 0.0, 0.0])
UP = np.array([np.pi, 0.0, 0.0, 0.0])


def constant(torque):
    return Memoryless(lambda t, x: jnp.array([0.0, torque]))


class Counting(AbstractExpensiveController):
    """Counts the calls that were not idle."""

    def init(self):
        return jnp.array(0)

    def control(self, carry, t, x, idle):
        return carry + jnp.where(idle, 0, 1), jnp.array([0.0, 1.0])


def torques(controller, states):
    memory, answers = controller.init(), []
    for x in states:
        memory, u = controller(memory, jnp.zeros(()), jnp.asarray(x))
        answers.append(float(u[1]))
    return answers, memory


@pytest.fixture
def controller():
    return LatchingSwitch(constant(1.0), constant(2.0), THRESHOLD, ACROBOT)


def test_never_switches_back(x64, controller):
    answers, memory = torques(controller, [AWAY, UP, AWAY, UP, AWAY])
    assert answers == [1.0, 2.0, 2.0, 2.0, 2.0]
    assert memory.latched


def test_full_turns_do_not_matter(x64, controller):
    for turns in ((2, 0), (-2, 0), (0, 2), (4, -6)):
        assert torques(controller, [UP + np.pi * np.array([*turns, 0, 0])])[0] == [2.0]


def test_all_four_have_to_be_near(x64, controller):
    for error in np.diag(1.01 * THRESHOLD):
        assert torques(controller, [UP + error, UP - error])[0] == [1.0, 1.0]
        assert torques(controller, [UP + 0.98 * error])[0] == [2.0]
    # The threshold is strict.
    assert torques(controller, [UP + np.array([0, 0, 1.0, 0])])[0] == [1.0]
    assert torques(controller, [UP + np.array([0, 0, np.nextafter(1.0, 0.0), 0])])[0] == [2.0]


def test_a_sparing_controller_learns_that_it_is_idle(x64):
    answers, memory = torques(LatchingSwitch(Counting(), constant(2.0), THRESHOLD, ACROBOT), [AWAY, AWAY, UP, AWAY])
    assert answers == [1.0, 1.0, 2.0, 2.0]
    assert memory.first == 2
