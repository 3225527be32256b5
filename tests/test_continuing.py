"""The continuing MuJoCo tasks: each difference from Gymnasium's own, by hand, and the learner on one of them."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from swingup import AREAPO
from swingup.cli import main
from swingup.continuing import CONTINUING

IDS = [name for name in gymnasium.registry if name.startswith("swingup/Continuing")]
V4 = {"HumanoidStandup": (348, 17), "Humanoid": (348, 17), "Ant": (27, 8), "SpecialAnt": (27, 8)}


def made(task, **arguments):
    env = gymnasium.make(f"swingup/Continuing{task}-v0", **arguments).unwrapped
    env.reset(seed=0)
    env.action_space.seed(0)
    return env


@pytest.mark.filterwarnings("ignore::UserWarning")  # the checker's own: bounds of observations are infinite
@pytest.mark.parametrize("name", IDS)
def test_gymnasiums_checker(name):
    check_env(gymnasium.make(name, disable_env_checker=True).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("name", CONTINUING)
def test_the_stream_never_ends_and_a_reset_costs(name):
    dear, free = made(name, reset_cost=100.0), made(name, reset_cost=0.0, reward_offset=7.0)
    low, high = dear.action_space.low, dear.action_space.high
    for step in range(120):
        action = high if step % 20 < 10 else low  # the runners fall soon
        (seen, reward, *ends, info), (_, other, *_) = dear.step(action), free.step(action)
        assert ends == [False, False]
        assert seen.shape == dear.observation_space.shape
        assert reward == pytest.approx(other - 7.0 - 100.0 * info["reset"], abs=1e-9)
    falls = name in ("Hopper", "Humanoid", "Walker2d")
    assert (dear.own_resets > 0) == (free.own_resets > 0) == falls
    if name in V4:
        assert (*dear.observation_space.shape, *dear.action_space.shape) == V4[name]
    assert dear.dt == gymnasium.make(CONTINUING[name].base).unwrapped.dt


def test_the_cheetah_falls_below_15_cm():
    env = made("HalfCheetah")
    qpos = env._env.data.qpos.copy()
    for height, fell in ((0.2, False), (0.1, True)):
        qpos[1] = height - 0.7  # the slider's zero is at 0.7 m
        env._env.set_state(qpos, np.zeros_like(env._env.data.qvel))
        assert CONTINUING["HalfCheetah"].fell(env._env) == fell


def test_angles_of_the_swimmer_are_wrapped():
    env = made("Swimmer")
    env._env.set_state(np.array([0.0, 0.0, 4.0, 0.5, -0.5]), np.zeros(5))
    seen = env.step(np.zeros(2))[0]
    assert seen[:3] == pytest.approx([4.0 - 2 * np.pi, 0.5, -0.5], abs=0.01)


def test_the_special_ants_joints_bend_both_ways():
    model, usual = made("SpecialAnt")._env.model, made("Ant")._env.model
    for leg in (1, 2, 3, 4):
        assert np.rad2deg(model.joint(f"ankle_{leg}").range) == pytest.approx([-70, 70])
        assert np.rad2deg(model.joint(f"hip_{leg}").range) == pytest.approx([-30, 30])
        assert np.rad2deg(np.ptp(usual.joint(f"ankle_{leg}").range)) == pytest.approx(40)


@pytest.mark.parametrize(("task", "every", "place"), [("Reacher", 50, slice(4, 6)), ("Pusher", 100, slice(17, 19))])
def test_a_target_or_an_object_moves_at_intervals(task, every, place):
    env, places, still = made(task), [], np.zeros(made(task).action_space.shape)
    before = env.step(still)[0]
    for step in range(2, 4 * every + 1):
        arm, seen = env._env.data.qpos[:2].copy(), env.step(still)[0]
        if step % every == 0:
            places.append(seen[place])
            assert np.abs(env._env.data.qpos[:2] - arm).max() < 0.02
        elif task == "Reacher":
            assert seen[place] == pytest.approx(before[place])
        before = seen
    norms = np.linalg.norm(places, axis=1)
    assert len(np.unique(places, axis=0)) == 4
    assert (norms < 0.2).all() if task == "Reacher" else (norms > 0.17).all()


def test_the_reachers_reward_is_v4s():
    env = made("Reacher")
    for _ in range(120):  # beyond two moves of the target
        body, action = env._env.get_body_com, env.action_space.sample()
        distance = np.linalg.norm(body("fingertip") - body("target"))
        assert env.step(action)[1] == pytest.approx(-distance - np.sum(action**2))


def test_chosen_resets():
    env = made("HopperChosenResets")
    assert (env.action_space.low[-1], env.action_space.high[-1], env.action_space.shape) == (0.0, 1.0, (4,))
    never, always = np.array([1.0, 1.0, 1.0, 0.0], np.float32), np.array([0.0, 0.0, 0.0, 1.0], np.float32)
    assert not any(env.step(never)[4]["reset"] for _ in range(100))  # it lies on the floor by now
    assert env.step(never)[0][0] < 0.7
    observation, reward, *_ = env.step(always)
    # Standing at 1.25 m but for noise of 0.005, and at rest.
    assert observation[0] == pytest.approx(1.25, abs=0.006)
    assert np.abs(observation[5:]).max() < 0.006
    assert reward < -5.0


def test_the_learner_counts_the_resets_and_the_command_shows_them(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("swingup.learner.host_backend.EPISODE_STEPS", 200)  # a step takes a millisecond
    sizes = {"num_envs": 2, "num_steps": 100, "batch_size": 100, "num_epochs": 1}
    reports = []
    model = AREAPO("swingup/ContinuingHopper-v0", folder=tmp_path / "run", evaluate_every=400, **sizes)
    model.learn(600, lambda _, report: reports.append(report))
    assert model.settings.checkpoint_every == 1_000_000
    assert [report.frames for report in reports] == [400, 600]
    row = reports[-1].best.as_dict()
    assert row["termination_rate"] > 0.005  # a hopper that has learnt nothing falls every 20 to 60 steps
    assert row["score"] == row["reward_rate"]
    assert (row["mean_length"], row["resets_per_1000_steps"] > 0) == (200, True)
    assert model.evaluate(1)["reward_rate"] == row["reward_rate"]
    model.close()
    assert main(["train", "--resume", str(tmp_path / "run"), "--frames", "800"]) == 0
    table = [line.split() for line in capsys.readouterr().out.splitlines() if line.strip()]
    assert table[0] == ["frames", "reward", "rate", "resets", "per", "1,000", "steps", "deterministic", "rate"]
    assert [line[0] for line in table[2:5]] == ["400", "600", "800"]
    assert float(table[3][1]) == pytest.approx(row["reward"], rel=1e-3)
    assert float(table[3][3]) == pytest.approx(row["reward_rate"], rel=1e-3)
