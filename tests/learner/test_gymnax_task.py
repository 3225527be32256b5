"""Environments with gymnax's methods as tasks, and the pendulums as such environments."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.common.errors import SwingupError
from swingup.gymnax import PendulumEnvironment
from swingup.plant.robots import ROBOTS
from swingup.tasks.adapters import as_task
from swingup.tasks.gymnax_task import GymnaxTask
from swingup.tasks.presets import smooth_task

from .contract import Ending, check_contract, moved_by
from .corridors import Box, Corridor, Discrete, Logged, Params, State, Turns

# Scaled to [-1, 3]: an action of 1 walks 0.5 * 3 = 1.5 a step, beyond the door at 2 in the second step.
RUN = Ending(1.0, 2, True, moved_by(3.0, 1.0))
# -0.5 is 0 of [-1, 3]: nothing moves, and the limit is 6 steps.
STAND = Ending(-0.5, 6, False, moved_by(0.0, 3.0))
CHOICES = [
    # A choice of 1 walks 0.5 a step, beyond a door at 2.25 in the fifth step, wherever it starts.
    Ending(1, 5, True, moved_by(2.5, 2.5)),
    Ending(0, 6, False, moved_by(0.0, 3.0)),
]
SMOOTH = dataclasses.replace(smooth_task(ROBOTS["acrobot"]), truncation_probability=0.0)
ACROBOT = PendulumEnvironment("acrobot", SMOOTH)


class Bare:
    """The corridor without ``step``."""

    def __init__(self):
        self.inner = Corridor()
        for name in ("default_params", "action_space", "observation_space", "reset", "step_env", "is_truncated"):
            setattr(self, name, getattr(self.inner, name))


@pytest.mark.parametrize(
    ("env", "params", "endings"),
    [
        pytest.param(Corridor(), None, [RUN, STAND], id="box"),
        pytest.param(Logged(Corridor()), None, [RUN, STAND], id="wrapper"),
        pytest.param(Bare(), None, [RUN, STAND], id="step_env"),
        pytest.param(Turns(), Params(door=2.25), CHOICES, id="discrete"),
    ],
)
def test_adapter_keeps_the_contract(env, params, endings):
    check_contract(GymnaxTask(env, params), endings)


@pytest.mark.slow
def test_pendulum_and_adapter_together_keep_the_contract():
    """A time limit of one step, and the last observation is that of the task itself."""
    params = ACROBOT.default_params.replace(max_steps_in_episode=1)

    @jax.jit
    def last(start):
        key = jax.random.split(jax.random.key(5))[0]  # the contract's
        return SMOOTH.step(SMOOTH.reset(key), jnp.zeros(1), key).observation

    check_contract(GymnaxTask(ACROBOT, params), [Ending(0.0, 1, False, last)])


class Doubled(Corridor):
    """A subclass that changes what its base class's ``step`` pays."""

    def step(self, *arguments):
        seen, state, reward, *rest = super().step(*arguments)
        return seen, state, 2.0 * reward, *rest


def test_step_is_called_where_there_is_one():
    """A subclass or a wrapper may change it."""
    task = GymnaxTask(Doubled())
    # 1 is 3 of [-1, 3], paid twice.
    assert task.step(task.reset(jax.random.key(0)), jnp.ones(1), jax.random.key(1)).reward == 6.0


def test_parameters_are_arguments():
    """Two environments that differ in a number share a compiled step."""
    env, compilations = Corridor(), []

    @jax.jit
    def move(task):
        compilations.append(task)
        state = task.reset(jax.random.key(0))
        # 1 is 3 of [-1, 3].
        return task.step(state, jnp.ones(1), jax.random.key(1)).state.inner.place - state.inner.place

    moved = [float(move(GymnaxTask(env, Params(pace=pace, door=1e6)))) for pace in (1.0, 2.0)]
    np.testing.assert_allclose(moved, [3.0, 6.0], rtol=1e-6)
    assert len(compilations) == 1


def test_what_is_taken_for_a_gymnax_environment():
    env = Corridor()
    assert as_task(env).params.door == 2.0
    assert as_task((env, Params(door=3.0))).params.door == 3.0
    for other in (Corridor, "Pendulum-v1", (1, 2), None, as_task(env)):
        assert as_task(other) is other


class Merged(Logged):
    """As before gymnax 1.0, with ``done``."""

    def step(self, *arguments):
        seen, state, reward, terminated, truncated, info = super().step(*arguments)
        return seen, state, reward, terminated | truncated, info


class Hiding(Logged):
    def step(self, *arguments):
        return *super().step(*arguments)[:5], {}


class Growing(Corridor):
    def step_env(self, *arguments):
        seen, state, *rest = super().step_env(*arguments)
        return seen, State(state.place, jnp.float32(state.time)), *rest


class Equal(Corridor):
    def __eq__(self, other):
        return True


class Camera(Corridor):
    def observe(self, state):
        return jnp.zeros((4, 4, 3), jnp.uint8)


class Broken(Corridor):
    def reset_env(self, key, params):
        raise RuntimeError("no start")


REFUSED = {
    "have no bounds to scale to": Corridor(Box(-np.inf, 1.0, (1,))),
    "whole numbers in a Box": Corridor(Box(0, 3, (1,), jnp.int32)),
    "are empty: give them an entry": Corridor(Box(0.0, 3.0, (0,))),
    "are empty: give them a choice": Corridor(Discrete(0)),
    "use a bounded Box": Corridor({"left": Discrete(2)}),
    "are not a Box": Corridor(observations=Discrete(4)),
    "images": Camera(),
    "returns 5 values": Merged(Corridor()),
    "hides the last observation": Hiding(Corridor()),
    "from .*int32.* to .*float32": Growing(),
    "has no hash": Equal(),
    r"raised RuntimeError \(no start\)": Broken(),
    "leaf 'fast'": (Corridor(), Params(pace="fast")),
}


@pytest.mark.parametrize("message", REFUSED)
def test_refusals_name_what_cannot_be_done(message):
    given = REFUSED[message]
    with pytest.raises(SwingupError, match=message) as caught:
        GymnaxTask(*(given if isinstance(given, tuple) else (given,)))
    assert "\n" not in str(caught.value)


def test_pendulum_resets_itself_as_gymnax_does():
    """Of two at rest, one has reached the limit: its state is new, and its last observation is kept."""
    params = ACROBOT.default_params.replace(max_steps_in_episode=2)
    seen, states = jax.vmap(ACROBOT.reset, in_axes=(0, None))(jax.random.split(jax.random.key(1)), params)
    states = dataclasses.replace(states, time=jnp.array([1, 0]))
    actions, keys = jnp.array([[0.5], [0.5]]), jax.random.split(jax.random.key(2))
    after, following, reward, terminated, truncated, info = jax.vmap(ACROBOT.step, in_axes=(0, 0, 0, None))(
        keys, states, actions, params
    )
    assert seen.shape == (2, *ACROBOT.observation_space().shape)
    assert (truncated.tolist(), terminated.tolist()) == ([True, False], [False, False])
    assert following.time.tolist() == [0, 1]
    # The task itself, from the same states, knows the observation before any reset.
    step = jax.jit(jax.vmap(lambda state, action: params.task.step(state, action, keys[0])))
    true = step(states.inner, actions)
    np.testing.assert_allclose(info["final_observation"], true.observation, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(reward, true.reward, rtol=1e-5)
    np.testing.assert_allclose(after[1], true.observation[1], rtol=1e-5, atol=1e-6)
    assert not np.allclose(after[0], true.observation[0], atol=1e-4)


def test_pendulum_clips_actions_and_has_bounded_spaces():
    _, state = ACROBOT.reset(jax.random.key(1))
    most, beyond = (ACROBOT.step(jax.random.key(2), state, jnp.array([u]))[0] for u in (1.0, 7.0))
    np.testing.assert_array_equal(most, beyond)
    space = ACROBOT.action_space()
    assert space.contains(space.sample(jax.random.key(0)))
    assert not space.contains(jnp.array([1.5]))
    for task in (SMOOTH, "none"):
        with pytest.raises(SwingupError, match=r"for the acrobot, not for the pendubot|unknown task 'none'"):
            PendulumEnvironment("pendubot", task)


@pytest.mark.slow  # it is not installed with the tests: it asks for an older Gymnasium
def test_the_package_itself():
    """gymnax's own environments and wrappers keep the contract; and its registry takes the pendulum."""
    gymnax = pytest.importorskip("gymnax", reason="gymnax is not installed: pip install 'swingup[gymnax]'")
    wrappers = pytest.importorskip("gymnax.wrappers.purerl")
    env, params = gymnax.make("CartPole-v1")
    for each in (env, wrappers.LogWrapper(env)):
        task = GymnaxTask(each, params.replace(max_steps_in_episode=4))
        assert task.choices == (2,)

        def last(start, task=task):
            state = (env.reset(jax.random.split(jax.random.key(5))[0], params))[1]
            for _ in range(4):
                seen, state, *_ = env.step_env(jax.random.key(0), state, jnp.array(1), task.params)
            return seen

        check_contract(task, [Ending(1, 4, False, last)])
    gymnax.register("Acrobot-swingup", lambda: ACROBOT)
    ours, ours_params = gymnax.make("Acrobot-swingup")
    check_contract(GymnaxTask(ours, ours_params.replace(max_steps_in_episode=2)), [])
