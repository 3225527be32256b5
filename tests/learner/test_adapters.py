"""Environments of gymnax and envelope, as tasks and to the learner; and the pendulums in gymnax's form."""

import dataclasses
from collections import namedtuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from policies import load_any_policy
from refusals import refusal
from swingup import AREAPO
from swingup.gymnax import PendulumEnvironment
from swingup.plant.plant import ROBOTS
from swingup.tasks.adapters import EnvelopeTask, GymnaxTask, as_task
from swingup.tasks.presets import smooth_task

from . import corridors
from .corridors import PACES, Corridor, Discrete, Hall, Logged, Params, Room
from .environments import TINY

SMOOTH = dataclasses.replace(smooth_task(ROBOTS["acrobot"]), truncation_probability=0.0)
ACROBOT = PendulumEnvironment("acrobot", SMOOTH)


def moved_by(place, time):
    return lambda start: start + np.array([place, time])


Ending = namedtuple("Ending", "action steps terminated last")
"""An action that, held from the start, ends an episode after some steps, of the task or of its time; and the last
observation as a function of the first one."""


def check_contract(task, endings):
    """Check a task, and each of its endings."""

    @jax.jit
    def hold(key, action, keys):
        """An episode's steps, in one scan, which takes states of one type alone; and its start."""

        def advance(state, key):
            step = task.step(state, action, key)
            return step.state, step

        start = task.reset(key)
        return jax.lax.scan(advance, start, keys)[1], task.observe(start)

    first, second = jax.random.split(jax.random.key(5))
    _check_resets(task, first, second)
    for ending in endings:
        action = jnp.atleast_1d(jnp.asarray(ending.action, int if task.choices else jnp.float32))
        given = first, action, jax.random.split(first, ending.steps)
        steps, start = hold(*given)
        ended = np.asarray(steps.terminated | steps.truncated)
        assert ended.tolist() == [False] * (ending.steps - 1) + [True]
        # One flag alone: a time limit is no end of the task, and the other way round.
        assert bool(steps.terminated[-1]) is ending.terminated
        assert bool(steps.truncated[-1]) is not ending.terminated
        np.testing.assert_allclose(steps.observation[-1], ending.last(np.asarray(start)), rtol=1e-5, atol=1e-6)
        assert steps.reward.shape == (ending.steps,)
        assert eqx.tree_equal(steps, hold(*given)[0])


def _check_resets(task, first, second):
    """Resets are a function of the key, one by one and side by side, in the shapes that the task promises."""

    def observe(key):
        return task.observe(task.reset(key))

    side_by_side = jax.jit(jax.vmap(observe))(jnp.stack([first, second, first]))
    assert side_by_side.shape == (3, task.observation_size)
    assert side_by_side.dtype == jnp.float32
    np.testing.assert_array_equal(side_by_side[0], side_by_side[2])
    assert not np.array_equal(side_by_side[0], side_by_side[1])
    np.testing.assert_allclose(jax.jit(observe)(first), side_by_side[0], rtol=1e-5, atol=1e-6)


BARE = ("default_params", "action_space", "observation_space", "reset", "step_env", "is_truncated")
Bare = type("Bare", (), {name: staticmethod(getattr(Corridor(), name)) for name in BARE})
"""The corridor without ``step``."""

# Scaled to [-1, 3]: an action of 1 walks 0.5 * 3 = 1.5 a step, beyond the door at 2 in the second step; -0.5 stands
# still, and the limit is 6 steps.
WALKS = [Ending(1.0, 2, True, moved_by(3.0, 1.0)), Ending(-0.5, 6, False, moved_by(0.0, 3.0))]
# A choice of 1 walks 0.5 a step, beyond a door at 2.25 in the fifth step, wherever it starts.
STEPS = [Ending(1, 5, True, moved_by(2.5, 2.5)), Ending(0, 6, False, moved_by(0.0, 3.0))]
# Three directions along the hall and two across, which do not matter.
CROSSING = Discrete((3, 2))
TASKS = {
    "gymnax box": (GymnaxTask(Corridor()), WALKS),
    "gymnax wrapper": (GymnaxTask(Logged(Corridor())), WALKS),
    "gymnax step_env": (GymnaxTask(Bare()), WALKS),
    "gymnax discrete": (GymnaxTask(Corridor(Discrete(3)), Params(door=2.25)), STEPS),
    "envelope box": (EnvelopeTask(Hall()), WALKS),
    "envelope choices": (EnvelopeTask(Hall(2.25, action_space=CROSSING)), [STEPS[0]._replace(action=(1, 1))]),
}


@pytest.mark.parametrize("name", TASKS)
def test_adapter_keeps_the_contract(name):
    check_contract(*TASKS[name])


def test_numbers_of_an_environment_are_arguments():
    env, compilations = Corridor(), []

    @jax.jit
    def first(task):
        compilations.append(task)
        return task.step(task.reset(jax.random.key(0)), jnp.ones(1), jax.random.key(1)).terminated

    # 1 is 3 of [-1, 3], which goes 1.5 far.
    for make in (lambda door: EnvelopeTask(Hall(door=door)), lambda door: GymnaxTask(env, Params(door=door))):
        assert [bool(first(make(door))) for door in (1.0, 2.0)] == [True, False]
    assert len(compilations) == 2


def test_what_is_taken_for_such_an_environment():
    env, task = Corridor(), as_task(Hall())
    assert (as_task(env).params.door, as_task((env, Params(door=3.0))).params.door) == (2.0, 3.0)
    assert isinstance(task, EnvelopeTask)
    assert (task.observation_size, task.action_size, task.choices) == (2, 1, ())
    assert EnvelopeTask(Hall(action_space=CROSSING)).choices == (3, 2)
    assert "Room has brax's methods: make it with jax-envelope" in refusal(AREAPO, Room())
    for other in (Corridor, Hall, "Pendulum-v1", (1, 2), None, jnp, task, as_task(env)):
        assert as_task(other) is other


class Returning(Logged):
    """Returns other things than gymnax does: ``changed`` is a function of what is right."""

    def __init__(self, changed):
        super().__init__(Corridor())
        self.changed = changed

    def step(self, *arguments):
        return self.changed(*super().step(*arguments))


class Growing(Corridor):
    def step_env(self, *arguments):
        seen, state, *rest = super().step_env(*arguments)
        return seen, corridors.State(state.place, jnp.float32(state.time)), *rest


class BrokenHall(Hall):
    def step(self, state, action):
        raise RuntimeError("no floor")


def changed(**entries):
    """A hall that returns other information: None takes an entry out."""

    class Changed(Hall):
        def init(self, key):
            state, info = Hall.init(self, key)
            given = {name: value for name, value in (info._asdict() | entries).items() if value is not None}
            return state, namedtuple("Bag", given)(**given)

    return Changed()


REFUSED = {
    GymnaxTask: {
        "are empty: give them a choice": Corridor(Discrete(0)),
        "returns 5 values": Returning(lambda o, s, r, e, t, i: (o, s, r, e | t, i)),  # as before gymnax 1.0
        "hides the last observation": Returning(lambda *answer: (*answer[:5], {})),
        "from ": Growing(),
        "leaf 'fast'": (Corridor(), Params(pace="fast")),
    },
    EnvelopeTask: {
        "several environments in one": Hall(action_space=corridors.BatchedSpace(PACES, 8)),
        "envelope.FlattenActionWrapper": Hall(action_space=corridors.PyTreeSpace((PACES, PACES))),
        "leave AutoResetWrapper out": changed(final_valid=True),
        "leave ObservationNormalizationWrapper out": changed(unnormalized_obs=0.0),
        "has no truncated": changed(truncated=None),
        "raised RuntimeError (no floor)": BrokenHall(),
    },
}


@pytest.mark.parametrize("adapter", REFUSED)
def test_refusals_name_what_cannot_be_done(adapter):
    for named, given in REFUSED[adapter].items():
        assert named in refusal(adapter, *(given if isinstance(given, tuple) else (given,)))


def test_pendulum_resets_itself_as_gymnax_does():
    """Of two at rest, one has reached the limit: its state is new, and its last observation is kept."""
    params = ACROBOT.default_params.replace(max_steps_in_episode=2)
    seen, states = jax.vmap(ACROBOT.reset, in_axes=(0, None))(jax.random.split(jax.random.key(1)), params)
    states = dataclasses.replace(states, time=jnp.array([1, 0]))
    actions, keys = jnp.array([[0.5], [0.5]]), jax.random.split(jax.random.key(2))
    step = jax.vmap(ACROBOT.step, in_axes=(0, 0, 0, None))
    after, following, reward, terminated, truncated, info = step(keys, states, actions, params)
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


@pytest.mark.slow  # it is not installed with the tests: it asks for an older Gymnasium
def test_gymnax_itself():
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


@pytest.mark.slow  # compiles for seconds
def test_an_environment_trains_saves_and_goes_on(tmp_path):
    env = Hall(max_steps=5)
    model = AREAPO(env, seed=3, **TINY).learn(64)
    assert model.settings.problem.name == "<learner.corridors.Hall>"
    # In the environment's shapes and bounds, [-1, 3].
    observations = np.random.default_rng(0).normal(size=(7, 1, 2))
    actions, _ = model.predict(observations)
    assert (actions.shape, model.predict(observations[0])[0].shape) == ((7, 1, 1), (1, 1))
    assert np.all((actions > -1.0) & (actions < 3.0))
    model.save(tmp_path / "model.safetensors")
    model.export_policy(tmp_path / "policy.safetensors")
    facts = load_any_policy(tmp_path / "policy.safetensors")[1]
    assert (facts["action_space"]["low"], facts["action_space"]["high"]) == ([[-1.0]], [[3.0]])
    assert "pass it again as env" in refusal(AREAPO.load, tmp_path / "model.safetensors")
    other = AREAPO.load(tmp_path / "model.safetensors", env=env)
    np.testing.assert_array_equal(
        model.learn(64).predict(observations)[0], other.learn(64).predict(observations)[0]
    )
    # Two steps to the door at most speed, and five to the time limit.
    assert 2.0 <= model.evaluate(2)["mean_length"] <= 5.0
    # What a step beyond the door pays does not count.
    found = model.evaluate(2, env=Hall(door=0.15))
    assert (found["mean_length"], found["resets_per_1000_steps"]) == (1.0, 1000.0)
    assert 0.0 < found["score"] < 3.0
    assert "the environment's are 1 choices of 3" in refusal(model.evaluate, 2, env=Corridor(Discrete(3)))


@pytest.mark.slow  # the packages are not installed with the tests
@pytest.mark.filterwarnings("default")  # theirs
def test_a_terminating_environment_of_the_package():
    """In jumanji's Snake the head runs into a wall."""
    pytest.importorskip("jumanji", reason="jumanji is not installed: see docs/learner.md")
    missing = "jax-envelope is not installed: pip install 'swingup[envelope]'"
    envelope = pytest.importorskip("envelope", reason=missing)
    inner = envelope.create("jumanji::Snake-v1", {"num_rows": 4, "num_cols": 4}, max_episode_steps=9)
    env = envelope.FlattenObservationWrapper(envelope.ContinuousObservationWrapper(inner))
    assert "several arrays: wrap it in envelope.ContinuousObservationWrapper" in refusal(EnvelopeTask, inner)
    task = EnvelopeTask(env)
    assert task.choices == (4,)
    # Always up, 0, from the contract's first start: stepped here by the package alone.
    step = jax.jit(inner.step)
    state, info = jax.jit(inner.init)(jax.random.split(jax.random.key(5))[0])
    steps = 0
    while not info.terminated:
        state, info = step(state, jnp.array(0))
        steps += 1
    last = np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(info.obs)])
    assert 1 <= steps <= 4
    check_contract(task, [Ending(0, steps, True, lambda start: last)])
