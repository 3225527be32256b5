"""One stream that is never reset: its only reset, its pauses and late steps, and how a loaded learner goes on."""

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from refusals import refusal
from swingup import AREAPO, evaluate_policy
from swingup.cli import main
from swingup.learner.environments import make_environments
from swingup.learner.host_backend import collect_on_host
from swingup.learner.metrics import read_metrics

from .environments import LENT, Lever
from .test_agent import same_weights

STREAM = {
    **LENT, "num_envs": 1, "batch_size": 16, "resets": "never",
}  # fmt: skip


class Plant(gymnasium.Env):
    """A random walk that can be reset once, of which some steps are late; ``ends`` is what its steps say."""

    observation_space, action_space = Box(-np.inf, np.inf, (1,), np.float32), Box(-1.0, 1.0, (1,), np.float32)

    def __init__(self, late=(), ends=(False, False)):
        self.resets, self.steps, self.late, self.ends = 0, 0, late, ends

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.resets += 1
        assert self.resets == 1
        self.position = 0.0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.steps += 1
        self.position = 0.9 * self.position + 0.1 * float(action[0]) + 0.1 * self.np_random.normal()
        info = {"late": 0.004} if self.steps in self.late else {}
        return np.float32([self.position]), -abs(self.position - 0.5), *self.ends, info


def test_a_plant_is_reset_once_whatever_happens_and_a_loaded_learner_goes_on_bit_for_bit(tmp_path, monkeypatch):
    """Checkpoints, callbacks that save, a second ``learn`` and ``load`` leave no trace in what is learned."""
    monkeypatch.setattr("swingup.learner.host_backend.EPISODE_STEPS", 200)
    file, plants, reports = tmp_path / "model.safetensors", [Plant(), Plant()], []
    whole = AREAPO(plants[0], seed=3, **(STREAM | {"checkpoint_every": 10_000})).learn(320)
    first = AREAPO(plants[1], seed=3, folder=tmp_path / "run", **STREAM)
    first.learn(128, lambda model, report: (model.save(tmp_path / "other.safetensors"), reports.append(report)))
    first.learn(64).save(file)
    second = AREAPO.load(file, plants[1]).learn(128)
    assert [plant.resets for plant in plants] == [1, 1]
    assert [plant.steps for plant in plants] == [320, 320]
    assert same_weights(whole, second)
    rows = read_metrics(tmp_path / "run" / "metrics.jsonl")
    assert [row["score"] == row["reward_rate"] == row["reward"] for row in rows] == [True] * 3
    assert reports[0].best.reward == rows[0]["reward"]
    # The pause was measured before the first step, and what it was is in the metrics.
    assert first.pause > 0.0
    assert all(row["longest_pause"] > 0.0 and row["late_steps"] == 0 for row in rows)
    assert "what was passed in trains" in refusal(second.evaluate)
    for again in (lambda: second.evaluate(env=plants[1]), lambda: evaluate_policy(second, plants[1])):
        assert "runs as a stream that is never reset" in refusal(again)
    assert second.evaluate(env=Plant())["mean_length"] == 200


def test_a_stream_seen_through_another_wrapper_is_refused():
    plant = Plant()
    AREAPO(plant, **STREAM).learn(16)
    wrapped = StackedTwice(plant)
    assert "observations of shape (1, 1), and has (1, 2) now" in refusal(AREAPO(wrapped, **STREAM).learn, 16)
    assert plant.resets == 1


class StackedTwice(gymnasium.ObservationWrapper):
    def __init__(self, env):
        super().__init__(env)
        self.observation_space = Box(-np.inf, np.inf, (2,), np.float32)

    def observation(self, observation):
        return np.repeat(observation, 2)


def test_who_did_not_see_the_last_steps_goes_on_from_what_the_stream_shows(tmp_path):
    plant = Plant()
    AREAPO(plant, **STREAM).learn(64).save(tmp_path / "model.safetensors")
    AREAPO(plant, **STREAM).learn(64)  # another learner, with the same plant
    model = AREAPO.load(tmp_path / "model.safetensors", plant)
    assert model.learn(64).frames == 128
    assert (plant.resets, plant.steps) == (1, 192)


class Telling(gymnasium.vector.SyncVectorEnv):
    """A vector environment of one plant with other infos."""

    def step(self, actions):
        return (*super().step(actions)[:4], self.infos)


def test_infos_that_say_nothing_and_late_steps_of_another_shape():
    vector = Telling([Plant])
    environments = make_environments(vector, 1, stream=True)
    environments.reset(0)
    for vector.infos in ([], None, {}):
        assert not environments.step(np.zeros((1, 1))).late.any()
    for vector.infos in ({"late": np.ones(3)}, {"late": "yes"}):
        assert "gave late" in refusal(environments.step, np.zeros((1, 1)))


@pytest.mark.parametrize("mode", AutoresetMode)
def test_a_vector_of_streams_that_ends_is_not_reset_either(mode):
    plants = [Plant(ends=(False, True)) for _ in range(2)]
    several = SyncVectorEnv([lambda plant=plant: plant for plant in plants], autoreset_mode=mode)
    model = AREAPO(several, **(STREAM | {"num_envs": 2}))
    for _ in range(2):
        assert "truncated, but is never to be reset" in refusal(model.learn, 64)
    assert [plant.resets for plant in plants] == [1, 1]


def test_a_stream_of_an_id_has_no_time_limit():
    environments = make_environments("Pendulum-v1", 1, stream=True)
    environments.reset(0)
    assert not any(environments.step(np.zeros((1, 1))).ended.any() for _ in range(201))


def test_late_steps_are_counted_and_cut_the_stream():
    """Step 1 comes first in its rollout, where a pause is expected; steps 6 and 7 come late within it."""
    plant = Plant(late=(1, 6, 7))
    model = AREAPO(plant, **(STREAM | {"num_steps": 32}))
    environments = make_environments(Plant(late=(1, 6, 7)), 1, stream=True)
    backend = model._run.backend
    backend._environments = [environments]
    _, rollout = collect_on_host(backend.begin(model._run.progress.state, 0), environments, model.config)
    assert np.flatnonzero(rollout.counted[:, 0] == 0.0).tolist() == [0, 5, 6]
    # What came before a late step is cut off from it.
    assert np.flatnonzero(rollout.truncated[:, 0]).tolist() == [4, 5]
    assert environments.late_steps == 2
    assert rollout.rewards[5, 0] == 0.0
    model._run.backend._environments = [make_environments(plant, 1, stream=True)]
    rows = []
    model.learn(64, lambda model, report: rows.append(report.best.as_dict()))
    assert rows[0]["late_steps"] == 2
    assert rows[0]["longest_pause"] > 0.0


def test_what_is_one_stream():
    """Whatever is passed in is itself stepped, and fills the preset's rollout alone."""
    made = gymnasium.make("Pendulum-v1", max_episode_steps=-1)
    model = AREAPO(made, resets="never")
    assert (model.config.num_envs, model.config.num_steps) == (1, 2000)
    assert model._run.backend._environments[0]._source is made.unwrapped
    # They follow from what is passed in.
    assert model.settings.command(5) == (
        "swingup.AREAPO(env, resets='never', preset='continuing', seed=0).learn(5)"
        f"  # env: {model.settings.problem.name}"
    )
    assert AREAPO([Plant, Plant], resets="never").config.num_steps == 1000
    assert AREAPO([Plant] * 3, resets="never").config.num_steps == 650  # minibatches of 50 divide the rollout
    for env in (Lever(), "acrobot"):
        assert "is compiled, and checkpoints hold its state" in refusal(AREAPO, env, resets="never")
    assert "resets" in refusal(AREAPO, Plant, resets="sometimes")
    assert "scored by its reward rate" in refusal(AREAPO, Plant, resets="never", evaluation_episodes=3)


@pytest.mark.parametrize(("ends", "message"), [
    ((True, False), "terminated, but is never to be reset: return False"),
    ((False, True), "truncated, but is never to be reset: make it without a limit"),
])  # fmt: skip
def test_a_stream_that_ends_names_the_remedy(ends, message):
    plant = Plant(ends=ends)
    model = AREAPO(plant, **STREAM)
    assert message in refusal(model.learn, 64)
    plant.ends = (False, False)
    assert model.learn(64).frames == 64
    assert plant.resets == 1


class Queue(gymnasium.Env):
    """A customer comes with probability 0.4 a step and is served with 0.3 for nothing, or with 0.6 for 6.

    Each that waits costs 1 a step, and at most ``ROOM`` fit in.
    """

    ROOM = 10
    observation_space, action_space = Box(0.0, 1.0, (1,), np.float64), Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.waiting = 0
        return np.zeros(1), {}

    def step(self, action):
        reward = -self.waiting - 6.0 * int(action)
        served = self.waiting > 0 and self.np_random.random() < (0.3, 0.6)[action]
        self.waiting = min(self.waiting - served + (self.np_random.random() < 0.4), self.ROOM)
        return np.array([self.waiting / self.ROOM]), float(reward), False, False, {}


def queue_rate(chosen=None):
    """The queue's long-run rate under chosen services, or its best one; and what is chosen.

    By relative value iteration: v + rate = r + P v, or the maximum of this over the services.
    """
    waiting = np.arange(Queue.ROOM + 1)
    values, fewer = np.zeros(len(waiting)), np.maximum(waiting - 1, 0)
    for _ in range(5000):
        after = 0.4 * values[np.minimum(waiting + 1, Queue.ROOM)] + 0.6 * values
        after_service = 0.4 * values[np.minimum(fewer + 1, Queue.ROOM)] + 0.6 * values[fewer]
        options = [(1 - p) * after + p * after_service - waiting - cost for p, cost in ((0.3, 0.0), (0.6, 6.0))]
        best = np.max(options, axis=0) if chosen is None else np.choose(chosen, options)
        rate, values = best[0] - values[0], best - best[0]
    return rate, np.argmax(options, axis=0) if chosen is None else chosen


@pytest.mark.slow
def test_a_queue_is_served_almost_at_the_optimal_rate():
    """Its best policy serves fast from two customers on, and the gain is the rate of the exploring one."""
    rate, chosen = queue_rate()
    assert rate == pytest.approx(-4.669, abs=1e-3)  # as the stationary distribution of that threshold gives it
    assert chosen.tolist() == [0, 0, *[1] * 8, 0]  # where the room is full, nobody is added
    # The thresholds beside it, and the slow service alone.
    assert [round(queue_rate([0] * n + [1] * (11 - n))[0], 3) for n in (1, 3, 11)] == [-5.197, -4.902, -8.297]
    rows = []
    model = AREAPO(Queue(), seed=1, resets="never", evaluate_every=20_000)
    model.learn(120_000, lambda model, report: rows.append(report.best))
    learned = model.predict(np.arange(Queue.ROOM + 1)[:, None] / Queue.ROOM)[0]
    assert queue_rate(learned)[0] > rate - 0.3
    assert rows[-1].reward == pytest.approx(rate, abs=0.6)  # by 20,000 steps and with its exploration
    assert rows[-1].gain == pytest.approx(rows[-1].reward, abs=0.05)


def test_the_command_says_how_long_nobody_acts(tmp_path, capsys):
    sizes = "--num-steps 32 --batch-size 32 --num-epochs 1 --policy-layers 8 --value-layers 8 --evaluate-every 64"
    out = tmp_path / "run"
    words = f"train --env swingup/ContinuingReacher-v0 --resets never --frames 128 --out {out} {sizes}"
    assert main(words.split()) == 0
    told = capsys.readouterr()
    assert "in which nobody acts" in told.err + told.out
    assert "deterministic" not in told.out
    assert main(["train", "--resume", str(out), "--frames", "256"]) == 0
