"""The public class: learning, going on, predicting, saving, loading, evaluating."""

import doctest
import functools
import types

import equinox as eqx
import gymnasium
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode

from array_files import change_file
from policies import load_any_policy
from refusals import refusal
from swingup import AREAPO, load_policy, play
from swingup.common.errors import SwingupError
from swingup.export.c_header import c_header
from swingup.export.onnx_graph import onnx_model
from swingup.learner.metrics import read_metrics
from swingup.learner.run_folder import RunFolder
from swingup.plant.plant import ROBOTS
from swingup.tasks.presets import smooth_task
from swingup.tasks.task import Step

from .environments import LENT, TINY, Failing, Lever, Noisy, Stairs, chains, stairs


@pytest.fixture(scope="module")
def noisy():
    return AREAPO(Noisy, seed=3, **TINY).learn(64)


def same_weights(one, other):
    return eqx.tree_equal(*(model._run.snapshot()[0] for model in (one, other)))


def test_whoever_loads_what_a_callback_saved_goes_on_as_the_saver_did(tmp_path):
    def save_at_64(model, report):
        if report.frames == 64:  # no checkpoint is due here
            model.save(tmp_path / "model.safetensors")

    one = AREAPO(Noisy, seed=3, **TINY).learn(192, save_at_64)
    other = AREAPO.load(tmp_path / "model.safetensors", env=Noisy)
    assert (other.frames, other.settings) == (64, one.settings)
    other.learn(128)
    assert one.frames == other.frames == 192
    assert same_weights(one, other)
    assert not same_weights(one, AREAPO(Noisy, seed=4, **TINY).learn(192))


@pytest.mark.parametrize("raised", [ValueError("no\nway"), KeyboardInterrupt("now")])
def test_an_interrupted_learner_stands_where_it_stood(tmp_path, monkeypatch, raised):
    faulty = isinstance(raised, ValueError)
    message = r"step\(\) of .* raised ValueError \(no way\)" if faulty else "now"
    monkeypatch.setattr(Failing, "steps", 0)
    monkeypatch.setattr(Failing, "raises", raised)
    model = AREAPO(Failing, seed=3, folder=tmp_path / "run", **(TINY | {"evaluation_episodes": 0}))
    with pytest.raises(SwingupError if faulty else KeyboardInterrupt, match=message):
        model.learn(128)
    assert model.frames == 64
    model.predict(np.zeros((2, 1)))
    model.save(tmp_path / "model.safetensors")
    monkeypatch.setattr(Failing, "raises", None)
    assert model.learn(64).frames == 128
    assert same_weights(model, AREAPO.load(tmp_path / "model.safetensors", env=Failing).learn(64))


class Told(Noisy):
    """Says of every end that it was a success."""

    def step(self, action):
        *step, _ = super().step(action)
        return *step, {"is_success": True} if step[3] else {}


def test_a_loaded_learner_knows_that_its_environments_name_successes(tmp_path):
    model = AREAPO(Told, **TINY).learn(512)
    model.save(tmp_path / "model.safetensors")
    for found in (model, AREAPO.load(tmp_path / "model.safetensors", env=Told)):
        assert [each.names_goals for each in found._run.backend._environments] == [True]


def test_a_callback_that_raises_lets_the_folder_go(tmp_path):
    model = AREAPO(Noisy, folder=tmp_path / "run", **TINY)
    with pytest.raises(ZeroDivisionError) as caught:
        model.learn(64, lambda model, report: 1 / 0)
    assert caught.tb is not None  # it holds the frame of learn()
    assert model.learn(64).frames == 128


@pytest.mark.parametrize("vector", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_policies_of_a_task_without_an_end_are_ranked_by_the_reward_rate(tmp_path, vector):
    endless = stairs(ends=None, pays=2.0)
    env = gymnasium.vector.SyncVectorEnv([endless] * 2) if vector else endless
    model = AREAPO(env, folder=tmp_path / "run", **LENT).learn(64)
    row = read_metrics(tmp_path / "run" / "metrics.jsonl")[-1]
    assert (row["score"], row["best_score"], row["episode_return"]) == (None, None, None)
    assert (row["reward_rate"], row["resets_per_1000_steps"], row["truncation_rate"]) == (2.0, 0.0, 0.0)
    assert load_any_policy(tmp_path / "run" / "best.safetensors")[1]["scores"]["episodes"]["reward_rate"] == 2.0
    model.close()
    # A resumed run has the rank as well.
    assert AREAPO.load(tmp_path / "run", env=env)._run.progress.best == ((False, 2.0),)


def test_a_return_is_not_compared_with_the_reward_of_a_step(tmp_path):
    """After 32 steps no episode has ended, and the reward of a step, -1, is above all returns, -40."""
    reports = []
    settings = TINY | {"evaluation_episodes": 0, "checkpoint_every": 10_000}
    model = AREAPO(stairs(ends=40, pays=-1.0), folder=tmp_path / "run", **settings)
    model.learn(192, lambda model, report: reports.append(report))
    assert [report.score for report in reports] == [None, -40.0, -40.0]
    assert [report.best_score for report in reports] == [None, -40.0, -40.0]
    metadata = load_any_policy(tmp_path / "run" / "best.safetensors")[1]
    assert (metadata["frames"], metadata["scores"]["episodes"]["score"]) == (128, -40.0)


def test_predict_and_the_policy_file(noisy, tmp_path):
    space = Noisy().action_space
    single, state = noisy.predict(np.zeros((2, 1)))
    assert state is None
    assert space.contains(single)
    several, _ = noisy.predict(np.zeros((5, 2, 1)))
    np.testing.assert_array_equal(several, np.tile(single, (5, 1)))
    assert noisy.predict(np.zeros((0, 2, 1)))[0].shape == (0, *space.shape)
    drawn, _ = noisy.predict(np.zeros((200, 2, 1)), deterministic=False)
    assert all(space.contains(action) for action in drawn)
    assert len(np.unique(drawn, axis=0)) == 6
    # As Stable-Baselines3's evaluate_policy calls it.
    given = {"state": None, "episode_start": np.ones(3, bool), "deterministic": True}
    actions, state = noisy.predict(np.zeros((3, 2, 1)), **given)
    np.testing.assert_array_equal(actions, several[:3])
    assert state is None
    assert "shape (3,): pass (2, 1)" in refusal(noisy.predict, np.zeros(3))
    noisy.export_policy(tmp_path / "p.safetensors")
    policy, metadata = load_any_policy(tmp_path / "p.safetensors")
    assert metadata["action_space"] == {"type": "multi_discrete", "nvec": [3, 2], "start": [1, 5], "dtype": "int64"}
    observations = np.random.default_rng(0).normal(size=(20, 2, 1)).astype(np.float32)
    actions = [np.add(policy(observation.ravel()), [1, 5]) for observation in observations]
    np.testing.assert_array_equal(actions, noisy.predict(observations)[0])
    for choices in ([3, 3], [], [3.5], "32"):
        change_file(tmp_path / "p.safetensors", {"choices": choices})
        assert "p.safetensors" in refusal(load_any_policy, tmp_path / "p.safetensors")


@pytest.mark.parametrize("notebook", [False, True])
def test_a_progress_bar_is_a_terminals_or_a_notebooks(noisy, monkeypatch, capfd, notebook):
    shown = []
    handle = types.SimpleNamespace(update=lambda content: shown.append(content.data))
    monkeypatch.setattr("rich.console._is_jupyter", lambda: notebook)
    monkeypatch.setattr("IPython.display.display", lambda content, display_id: handle)
    noisy.learn(total_timesteps=128, callback=None, progress_bar=True)
    assert [line.partition("max=128></progress> ")[0] for line in shown] == (
        ["<progress value=64 ", "<progress value=128 "] if notebook else []
    )
    output, errors = capfd.readouterr()
    assert (output, f"{noisy.frames:,} frames" in errors) == ("", not notebook)


class Watched(Noisy):
    closed = False

    def close(self):
        self.closed = True


def test_what_is_being_trained_on_is_not_evaluated_on():
    env, refused = Watched(), []

    def evaluate(model, report):
        refused.extend(refusal(entry) for entry in (lambda: play(model, env), lambda: model.evaluate(env=env)))

    settings = LENT | {"num_envs": 1, "batch_size": 16}
    model = AREAPO(env, **settings).learn(64, evaluate)
    assert len(refused) == 2
    assert all("is being trained on, and its episode would be lost" in told for told in refused)
    assert not env.closed
    assert play(model, env, 2).lengths  # now nothing is lost: the next learn begins with a reset


@pytest.mark.parametrize(("seeds", "episodes"), [(1, 2), (1, 1), (2, 0)])
def test_a_function_that_returns_one_environment_is_refused_at_once(seeds, episodes):
    settings = TINY | {"num_envs": 1, "batch_size": 16, "evaluation_episodes": episodes}
    env = Watched()
    assert "pass the environment itself" in refusal(AREAPO, lambda: env, seeds=seeds, **settings)
    assert not env.closed  # it is the caller's


def test_what_is_trained_on_is_named_and_not_its_wrapper():
    for env, name in ((gymnasium.make("CartPole-v1"), "CartPoleEnv"), (Noisy, "Noisy"), ([Stairs] * 2, "Stairs")):
        assert AREAPO(env).settings.problem.name.endswith(f".{name}>")


def test_a_tasks_whole_numbers_are_traced():
    class Sized(Lever):
        n: int = 1

        def observe(self, state):
            return jnp.full(self.n, state)

    assert "a field that is a shape, a branch or a word" in refusal(AREAPO, Sized(), **TINY)


def test_a_policy_goes_on_learning_on_one_environment(tmp_path):
    AREAPO(Noisy, **(TINY | {"num_envs": 4})).learn(64).export_policy(tmp_path / "p.safetensors")
    model = AREAPO.load(tmp_path / "p.safetensors", Noisy())
    assert (model.config.num_envs, model.config.num_steps, model.config.batch_size) == (1, 64, 32)
    assert model.learn(64).frames == 64


def test_a_task_may_show_whole_numbers():
    """They are normalised in training, in evaluations and in predict alike."""

    class Counting(Lever):
        def observe(self, state):
            return state.astype(int)[None]

        def step(self, state, action, key):
            right = (state < 5.0) == (action[0] > 0)  # what the count says
            after = state + 1.0
            return Step(
                after, self.observe(after), jnp.where(right, 1.0, 0.0), jnp.array(False), after >= self.ends
            )

    model = AREAPO(
        Counting(), "ppo", seed=0, **(TINY | {"num_steps": 128, "batch_size": 64, "learning_rate": 1e-2})
    )
    model.learn(12_000)
    actions = model.predict(np.arange(10.0, dtype=np.float32)[:, None], deterministic=True)[0].ravel()
    counts = np.arange(10)
    assert model.evaluate()["score"] == np.sum((counts < 5) == (actions > 0)) > 6


def test_a_discounted_rival_of_the_average_reward_has_a_folder(tmp_path):
    changes = {"gain": "none", "terminations": "end", "discount": (0.99, 0.99), "centre_values": False}
    model = AREAPO(Noisy, "continuing", folder=tmp_path / "run", **changes, **TINY).learn(64)
    assert {name: model.settings.changes[name] for name in changes} == changes
    model.export_policy(tmp_path / "p.safetensors")
    assert load_policy(tmp_path / "p.safetensors").task


def test_callbacks_see_reports_and_may_stop():
    frames = []
    model = AREAPO(Noisy, **TINY)
    # Comparisons of NumPy and JAX give no plain False.
    model.learn(1000, [lambda _, report: frames.append(report.frames), lambda _, r: np.int64(r.frames) < 128])
    assert frames == [64, 128]
    assert model.frames == 128
    # Asked again it goes on.
    assert model.learn(64, lambda _, report: frames.append(str(report))).frames == 192
    assert frames[2].startswith("192 frames, ")
    for answer in (jnp.array(False), np.array([True, False])):
        before = model.frames
        assert model.learn(1000, lambda _, report, answer=answer: answer).frames == before + 64


def test_seeds_train_as_each_does_alone(tmp_path):
    model = AREAPO(Noisy, seed=3, seeds=2, folder=tmp_path / "run", **TINY)
    reports = []
    model.learn(192, lambda _, report: reports.append(report))
    assert [row.seed for report in reports for row in report.rows] == [3, 4] * 3
    last, best = ([getattr(row, name) for row in reports[-1].rows] for name in ("score", "best_score"))
    assert (reports[-1].score, reports[-1].best_score) == (max(last), max(best))
    alone = AREAPO(Noisy, seed=4, **TINY).learn(192)
    assert eqx.tree_equal(model._run.policies()[1].actor, alone._run.policies()[0].actor)
    # The learner acts by the best seed, also where it was loaded.
    assert model._run.progress.best_seed == best.index(max(best))
    model.save(tmp_path / "model.safetensors")
    model.export_policy(tmp_path / "policy.safetensors")
    assert load_any_policy(tmp_path / "policy.safetensors")[1]["seed"] == 3 + best.index(max(best))
    seen = np.random.default_rng(0).normal(size=(20, 2, 1))
    for other in (AREAPO.load(tmp_path / "model.safetensors", Noisy), AREAPO.load(tmp_path / "run", Noisy)):
        np.testing.assert_array_equal(other.predict(seen)[0], model.predict(seen)[0])
        assert same_weights(other.learn(64), AREAPO.load(tmp_path / "model.safetensors", Noisy).learn(64))


def test_evaluate_is_the_mean_return():
    # Stairs pay 1 + 2 + 3 in three steps, whatever is done.
    model = AREAPO(Stairs, **TINY)
    rates = {"reward_rate": 2.0, "resets_per_1000_steps": 0.0}  # a time limit is no reset of the task
    assert model.evaluate(4) == {"score": 6.0, "mean_length": 3.0, **rates}
    ending = functools.partial(Stairs, terminates=True)
    rates["resets_per_1000_steps"] = pytest.approx(1000 / 3)
    assert model.evaluate(3, env=ending) == {"score": 6.0, "mean_length": 3.0, **rates}
    assert model.evaluate(3, env=stairs(dt=0.5))["reward_per_second"] == 4.0
    assert "episodes = 5" in refusal(model.evaluate, 5, env=chains(3, "cycle"))


def test_evaluations_of_any_length_leave_no_environments_open():
    running = []

    class Counted(Stairs):
        def __init__(self):
            super().__init__()
            running.append(self)

        def close(self):
            running.remove(self)

    model = AREAPO(Counted, **TINY)
    for episodes in (1, 2, 3, 4):
        model.evaluate(episodes)
        model.evaluate(episodes, env=Counted)
    # Those of training and of the usual evaluation.
    assert len(running) == TINY["num_envs"] + TINY["evaluation_episodes"]
    model.close()
    assert running == []


def test_loading_a_folder_writes_nothing_and_needs_no_lock(tmp_path):
    AREAPO(Stairs, folder=tmp_path / "r", **TINY).learn(64)
    before = {path: path.stat().st_mtime_ns for path in sorted((tmp_path / "r").rglob("*"))}
    with RunFolder(tmp_path / "r").exclusive():
        for which, frames in (("last", 128), ("best", 64)):
            assert AREAPO.load(tmp_path / "r", Stairs, which).learn(64).frames == frames
    assert {path: path.stat().st_mtime_ns for path in sorted((tmp_path / "r").rglob("*"))} == before


def test_a_policy_file_begins_a_new_learner(tmp_path):
    model = AREAPO(Noisy, seed=3, **TINY).learn(64)
    model.export_policy(tmp_path / "p.safetensors")
    other = AREAPO.load(tmp_path / "p.safetensors", Noisy)
    assert (other.frames, other.config, other.settings.seed) == (0, model.config, 3)
    seen = np.random.default_rng(0).normal(size=(50, 2, 1))
    np.testing.assert_array_equal(other.predict(seen)[0], model.predict(seen)[0])
    # Statistics of as many rows: the normalisation goes on from where it was.
    assert float(other._run.progress.state.statistics.count) == 64
    assert other.learn(64).frames == 64
    path = tmp_path / "p.safetensors"
    assert "unknown policy to load 'worst'" in refusal(AREAPO.load, path, Noisy, "worst")
    assert "pass it again as env" in refusal(AREAPO.load, path)
    assert "with actions multi_discrete" in refusal(AREAPO.load, path, Stairs)
    change_file(path, {"hyperparameters": {**load_any_policy(path)[1]["hyperparameters"], "policy_layers": [9]}})
    assert "another form than these hyperparameters" in refusal(AREAPO.load, path, Noisy)


def test_actions_have_the_bounds_of_the_space_and_no_others(tmp_path):
    """Other bounds would scale the policy's actions in silence."""
    model = AREAPO(Stairs(), folder=tmp_path / "r", **(LENT | {"num_envs": 1, "batch_size": 16}))
    drawn, _ = model.predict(np.zeros((500, 1)), deterministic=False)
    assert np.all((drawn >= [-2.0, 0.0]) & (drawn <= [2.0, 1.0]))
    # The mean starts near the middle of the bounds.
    np.testing.assert_allclose(model.predict([0.0])[0], [0.0, 0.5], atol=0.05)
    model.save(tmp_path / "m.safetensors")
    stronger = functools.partial(Stairs, actions=Box(np.array([-4.0, 0.0]), np.array([4.0, 1.0]), dtype=np.float64))
    named = "the environment has box, shape = [2], low = [-4.0, 0.0]"
    for path in (tmp_path / "m.safetensors", tmp_path / "r"):
        assert named in refusal(AREAPO.load, path, env=stronger())
        assert AREAPO.load(path, env=Stairs()).config.num_envs == 1
    assert named in refusal(model.evaluate, 1, env=stronger)


def test_a_list_of_functions_is_a_vector_environment_and_an_instance_is_one():
    given = {name: value for name, value in LENT.items() if name != "num_envs"}
    assert AREAPO([Stairs] * 4, **given).config.num_envs == 4
    model = AREAPO(Stairs(), **(given | {"batch_size": 16}))
    assert (model.config.num_envs, model.settings.problem.name) == (1, "<learner.environments.Stairs>")
    # Each plays one episode of 1 + 2 + 3.
    assert model.evaluate(env=Stairs())["score"] == model.evaluate(env=[Stairs] * 2)["score"] == 6.0


def test_a_task_in_jax_is_compiled():
    settings = TINY | {"num_steps": 64, "learning_rate": 0.01, "evaluate_every": 10_000}
    model = AREAPO(Lever(), temperature=0.0, **settings).learn(20_000)
    assert model.predict([0.0])[0] == [2]
    # Ten steps of the best choice.
    assert model.evaluate(4)["score"] == 30.0


def test_an_evaluation_means_the_same_on_both_back_ends():
    for env in (Lever(ends=3000.0), stairs(ends=3000, pays=2.0)):
        model = AREAPO(env, **TINY)
        each = 1.0 + model.predict([0.0])[0][0] if isinstance(env, Lever) else 2.0
        assert model.evaluate(2) == {
            "score": 2000 * each, "mean_length": 2000.0, "reward_rate": each, "resets_per_1000_steps": 0.0,
        }  # fmt: skip


def test_a_pendulum_task_takes_the_preset_that_is_named():
    model = AREAPO(smooth_task(ROBOTS["acrobot"]), "small", **TINY)
    assert (model.settings.preset, model.settings.problem.record["robot"]) == ("small", None)
    assert model.config.learning_rate == 1e-3


@pytest.mark.parametrize("preset", ["continuing", pytest.param("ppo", marks=pytest.mark.slow)])
def test_the_family_trains_on_a_gymnasium_id(preset):
    row = []
    model = AREAPO("CartPole-v1", preset, **TINY)
    assert model.config.learning_rate == 3e-4
    model.learn(64, lambda _, report: row.extend(each.as_dict() for each in report.rows))
    assert row[0]["gradient_norm"] > 0.0
    # Without average reward there is no gain; without temperature no entropy reward.
    assert (row[0]["gain"] != 0.0) == (row[0]["entropy_gain"] != 0.0) == (preset != "ppo")


def test_numbers_of_numpy_become_pythons():
    given = {"learning_rate": np.float32(1e-3), "num_envs": np.int64(2), "policy_layers": np.array([8]).tolist()}
    model = AREAPO(Noisy, seed=np.int64(3), **(TINY | given | {"value_layers": (np.int32(8),)}))
    plain = AREAPO(Noisy, seed=3, **(TINY | {"learning_rate": float(np.float32(1e-3))}))
    assert model.settings.as_dict() == plain.settings.as_dict()


@pytest.mark.slow
def test_the_docstrings_example():
    from swingup.learner import agent

    assert doctest.testmod(agent) == (0, 4)


def test_evaluation_elsewhere(monkeypatch):
    closed = []
    monkeypatch.setattr(Stairs, "close", lambda self: closed.append(self))
    model = AREAPO(chains(2, "cycle", AutoresetMode.NEXT_STEP), **LENT)
    for wrong, named in (
        ({}, "pass evaluate another"),
        ({"env": Noisy}, "the policy sees 1 numbers, the environment shows 2"),
        ({"episodes": 3, "env": Stairs}, "policy's actions are 1 choices of 3, the environment's are 2 num"),
        *(({"episodes": episodes, "env": Stairs}, "episodes = ") for episodes in (-1, "2")),
    ):
        assert named in refusal(model.evaluate, **wrong)
    assert len(closed) >= 1  # what it made
    assert model.evaluate(env=chains(3, "walk"))["mean_length"] == 4.0


def test_a_robot_by_name():
    model = AREAPO("pendubot", **{**TINY, "evaluation_episodes": 1})
    assert (model.settings.preset, model.settings.problem.name) == ("pendulum", "pendubot")
    assert model.predict(np.zeros(4))[0].shape == (1,)
    assert 0.0 <= model.evaluate()["score"] < 0.1


@pytest.mark.slow  # a program of its own, and two episodes of 1,000 steps
def test_dm_controls_acrobot_is_acted_in_itself(tmp_path, monkeypatch):
    """The file keeps what its preset adds: the magnified observation, and torques to choose from."""
    monkeypatch.setattr("swingup.tasks.acrobot_swingup.winnable_states", lambda *_, **__: jnp.zeros((2, 4)))
    env = "swingup/AcrobotSwingup-v0"
    model = AREAPO(env, num_envs=2, num_steps=4, batch_size=8, evaluation_episodes=1)
    model.export_policy(tmp_path / "p.safetensors")
    policy = load_policy(tmp_path / "p.safetensors")
    seen = np.random.default_rng(0).normal(size=(200, 6)).astype(np.float32)
    actions, _ = policy.predict(seen)
    assert actions.shape == (200, 1)
    assert set(actions.ravel().tolist()) <= {-1.0, 0.0, 1.0}
    drawn, _ = policy.predict(seen, deterministic=False)
    assert set(drawn.ravel().tolist()) == {-1.0, 0.0, 1.0}
    np.testing.assert_array_equal(actions, AREAPO.load(tmp_path / "p.safetensors").predict(seen)[0])
    for export in (onnx_model, c_header):
        assert "no observation stage 'magnify'" in refusal(export, policy)
    # Both back ends and NumPy play it, in the task itself.
    sparse = "swingup/AcrobotSwingupSparse-v0"
    assert model.evaluate(1, env=sparse)["mean_length"] == play(policy, sparse, 1).lengths[0] == 1000
