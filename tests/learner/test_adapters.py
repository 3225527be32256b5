"""One contract for all adapters of environments; what they refuse; and the pendulums in gymnax's form."""

import dataclasses
import functools
from collections import namedtuple

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from policies import load_any_policy
from refusals import refusal
from swingup import AREAPO
from swingup.controllers.stack.policy import make_policy
from swingup.gymnax import PendulumEnvironment
from swingup.learner.environments import make_environments
from swingup.learner.problem import make_problem
from swingup.plant.plant import ROBOTS
from swingup.policy.network import Layer, Network
from swingup.tasks.acrobot_swingup import AcrobotSwingup
from swingup.tasks.adapters import EnvelopeTask, GymnaxTask, as_task
from swingup.tasks.presets import smooth_task
from swingup.tasks.task import AbstractTask

from . import corridors
from .corridors import PACES, Corridor, Discrete, Hall, Logged, Params, Passage, Room
from .environments import TINY, Lever

SMOOTH = dataclasses.replace(smooth_task(ROBOTS["acrobot"]), truncation_probability=0.0)
ACROBOT = PendulumEnvironment("acrobot", SMOOTH)


class Like(gymnasium.Env):
    """Gymnasium's environment with methods and attributes of other packages' names."""

    action_size, init = 3, print
    observation_space = action_space = gymnasium.spaces.Box(-1.0, 1.0)


def test_a_task_of_another_kind_is_not_in_gymnaxs_form():
    assert "AcrobotSwingup is not in gymnax's form" in refusal(PendulumEnvironment, "acrobot", AcrobotSwingup())


def test_an_environment_of_gymnasiums_is_one_whatever_it_has_besides():
    for env in (Like(), SyncVectorEnv([Like])):
        assert as_task(env) is env


def moved_by(place, time):
    return lambda starts: starts + np.array([place, time])


Ending = namedtuple("Ending", "action steps terminated last")
"""An action that, held from the start, ends an episode after some steps, of the task or of its time; and the last
observations as a function of the first ones."""
Shown = namedtuple("Shown", "starts observation reward terminated truncated")
"""What the learner is shown of two episodes: their starts, then the steps, with the axes (step, episode)."""


@functools.partial(jax.jit, static_argnames="steps")
def play(task, keys, actions, steps):
    """Starts, and the steps in one scan, which takes states of one type alone."""

    def advance(states, _):
        step = jax.vmap(task.step)(states, actions, keys)
        return step.state, step

    starts = jax.vmap(task.reset)(keys)
    return jax.vmap(task.observe)(starts), jax.lax.scan(advance, starts, None, steps)[1]


def hold(env, action, steps, seed=5):
    """Two episodes in which an action, the policy's, is held."""
    actions, task = np.tile(np.atleast_1d(action), (2, 1)), as_task(env)
    if isinstance(task, AbstractTask):
        starts, found = play(task, jax.random.split(jax.random.key(seed)), actions, steps)
        return Shown(starts, found.observation, found.reward, found.terminated, found.truncated)
    environments = make_environments(task, 2)
    starts = environments.reset(seed)
    rows = [environments.step(actions) for _ in range(steps)]
    names = "true_next", "rewards", "terminated", "truncated"
    return Shown(starts, *(np.stack([getattr(row, name) for row in rows]) for name in names))


def check_starts(make, endings):
    """Starts are functions of the seed, of the promised shape; two episodes differ."""
    one, again, other = (hold(make(), *endings[0][:2], seed).starts for seed in (5, 5, 6))
    assert (one.shape[0], one.ndim, one.dtype) == (2, 2, np.float32)
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one[0], one[1])
    assert not np.array_equal(one, other)


def check_ends(make, endings):
    """An end is the task's or a time limit's, never both, and comes with the observation before any reset."""
    for action, steps, terminated, last in endings:
        shown = hold(make(), action, steps)
        ended = np.asarray(shown.terminated | shown.truncated)
        assert ended.tolist() == [[False, False]] * (steps - 1) + [[True, True]]
        assert shown.terminated[-1].tolist() == [terminated] * 2
        assert shown.truncated[-1].tolist() == [not terminated] * 2
        np.testing.assert_allclose(shown.observation[-1], last(np.asarray(shown.starts)), rtol=1e-5, atol=1e-6)


def check_repeats(make, endings):
    """The same seed and actions give the same bits; rewards are numbers in single precision."""
    one, again = (hold(make(), *endings[0][:2]) for _ in range(2))
    for left, right in zip(one, again, strict=True):
        np.testing.assert_array_equal(left, right)
    assert (one.reward.dtype, one.reward.shape) == (np.float32, (endings[0].steps, 2))
    assert np.isfinite(one.reward).all()


def check_evaluation(make, endings):
    """An evaluation counts steps, and resets without time limits."""
    adapted = as_task(make())
    known = adapted if isinstance(adapted, AbstractTask) else make_environments(adapted, 2)
    size, _, choices = dataclasses.astuple(known.spaces)
    for action, steps, terminated, _ in endings:
        wanted = np.atleast_1d(action)
        bias = np.concatenate([np.eye(n)[k] for n, k in zip(choices, wanted, strict=True)]) if choices else wanted
        head = Layer(np.zeros((len(bias), size), np.float32), np.float32(bias))
        policy = make_policy(Network((), (), head, choices=choices or None, bounds="clip"))
        found = make_problem(make()).evaluate(policy, 5, 2, known.actions.describe())
        assert (found.mean_length, found.resets_per_1000_steps) == (steps, 1000.0 / steps * terminated)


PROPERTIES = [check_starts, check_ends, check_repeats, check_evaluation]


def check_contract(make, endings):
    """Check all that adapters promise."""
    for check in PROPERTIES:
        check(make, endings)


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


# Instances of a class without __eq__ are compiled anew.
CORRIDOR, LOGGED, BARE_ONE, CHOOSING = Corridor(), Logged(Corridor()), Bare(), Corridor(Discrete(3))


def passages(mode):
    return lambda: SyncVectorEnv([Passage] * 2, autoreset_mode=mode)


ADAPTERS = {
    "gymnasium box": (lambda: Passage, WALKS),
    "gymnasium discrete": (lambda: functools.partial(Passage, 2.25, 6, gymnasium.spaces.Discrete(3)), STEPS),
    **{f"vector {mode.value}": (passages(mode), WALKS) for mode in AutoresetMode},
    "gymnax box": (lambda: CORRIDOR, WALKS),
    "gymnax wrapper": (lambda: LOGGED, WALKS),
    "gymnax step_env": (lambda: BARE_ONE, WALKS),
    "gymnax discrete": (lambda: (CHOOSING, Params(door=2.25)), STEPS),
    "envelope box": (Hall, WALKS),
    "envelope choices": (lambda: Hall(2.25, action_space=CROSSING), [STEPS[0]._replace(action=(1, 1))]),
}


@pytest.mark.parametrize("adapter", ADAPTERS)
@pytest.mark.parametrize("check", PROPERTIES)
def test_adapters_keep_the_contract(adapter, check):
    check(*ADAPTERS[adapter])


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
    short = params.replace(max_steps_in_episode=4)
    for each in (env, wrappers.LogWrapper(env)):
        assert GymnaxTask(each, short).choices == (2,)

        def last(starts):
            """Where four pushes to the right lead from each start, by the package alone."""
            seen = []
            for start in starts:
                state = env.reset(jax.random.key(0), params)[1].replace(
                    **dict(zip(("x", "x_dot", "theta", "theta_dot"), map(jnp.asarray, start), strict=True))
                )
                for _ in range(4):
                    observation, state, *_ = env.step_env(jax.random.key(0), state, jnp.array(1), short)
                seen.append(observation)
            return np.stack(seen)

        check_contract(lambda each=each: (each, short), [Ending(1, 4, False, last)])
    gymnax.register("Acrobot-swingup", lambda: ACROBOT)
    ours, ours_params = gymnax.make("Acrobot-swingup")
    check_starts(lambda: (ours, ours_params.replace(max_steps_in_episode=2)), [Ending(0.0, 2, False, None)])


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


def envelope_with(package):
    """jax-envelope, where it is installed with a suite."""
    pytest.importorskip(package, reason=f"{package} is not installed: see docs/learner.md")
    return pytest.importorskip("envelope", reason="jax-envelope is not installed: pip install 'swingup[envelope]'")


@pytest.mark.slow  # the packages are not installed with the tests
@pytest.mark.filterwarnings("default")  # theirs
def test_a_terminating_environment_of_the_package():
    """In jumanji's Snake the head runs into a wall."""
    envelope = envelope_with("jumanji")
    inner = envelope.create("jumanji::Snake-v1", {"num_rows": 4, "num_cols": 4}, max_episode_steps=9)
    env = envelope.FlattenObservationWrapper(envelope.ContinuousObservationWrapper(inner))
    assert "several arrays: wrap it in envelope.ContinuousObservationWrapper" in refusal(EnvelopeTask, inner)
    assert EnvelopeTask(env).choices == (4,)
    check_starts(lambda: env, [Ending(0, 1, True, None)])
    # Always up, 0: stepped here by the package alone.
    step, shown = jax.jit(inner.step), hold(env, 0, 4)
    for episode, key in enumerate(jax.random.split(jax.random.key(5))):
        state, info = jax.jit(inner.init)(key)
        for index in range(4):
            state, info = step(state, jnp.array(0))
            seen = np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(info.obs)])
            np.testing.assert_allclose(shown.observation[index, episode], seen, rtol=1e-5, atol=1e-6)
            assert bool(shown.terminated[index, episode]) is bool(info.terminated)
            if info.terminated:
                break
        assert info.terminated
        assert not info.truncated


@pytest.mark.slow  # compiles for a minute
@pytest.mark.filterwarnings("default")  # theirs
@pytest.mark.parametrize(
    ("package", "name"),
    [("brax", "brax::inverted_pendulum"), ("mujoco_playground", "mujoco_playground::CartpoleBalance")],
)
def test_a_suite_of_the_package(package, name):
    """A limit truncates; starts and repeats are the seed's."""
    task = EnvelopeTask(envelope_with(package).create(name, max_episode_steps=3))
    ending = Ending(np.zeros(task.action_size), 3, False, None)
    check_starts(lambda: task, [ending])
    check_repeats(lambda: task, [ending])
    assert hold(task, *ending[:2]).truncated.tolist() == [[False, False]] * 2 + [[True, True]]


class TooLong(Lever):
    """Shows two numbers where it says one."""

    def observe(self, state):
        return jnp.stack([state, state])


class Branching(Lever):
    """Branches in Python on a traced number."""

    def step(self, state, action, key):
        return super().step(state if state < 5.0 else 0.0 * state, action, key)


class Numbered(Lever):
    """Ends by a number, not by a truth value."""

    def step(self, state, action, key):
        return dataclasses.replace(super().step(state, action, key), terminated=jnp.zeros(()))


class Growing(Lever):
    """Its state becomes a vector."""

    def step(self, state, action, key):
        return dataclasses.replace(super().step(state, action, key), state=jnp.zeros(2))


@pytest.mark.parametrize(
    ("task", "message"),
    [
        (TooLong(), "observe() of TooLong has shape (2,): the task needs (1,)"),
        (Branching(), "tracing reset, observe and step of Branching raised TracerBoolConversionError"),
        (Growing(), "step() of Growing changes shapes or types of the state"),
        (Numbered(), "terminated of step() of Numbered is float32: give a truth value"),
        (Lever, "pass the task itself"),
    ],
    ids=["observation", "branch", "state", "type", "class"],
)
def test_a_task_in_jax_that_cannot_be_learnt_is_told_before(task, message):
    assert message in refusal(AREAPO, task, "continuing", **TINY)
