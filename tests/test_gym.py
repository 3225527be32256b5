"""The pendulums as Gymnasium environments, and pictures of them."""

import dataclasses
import math
import subprocess
import sys

import gymnasium
import jax
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode

from refusals import refusal
from swingup.drawing import DRIVEN, LINK_2, draw_frame
from swingup.gym import PendulumEnv, PendulumVectorEnv
from swingup.plant.plant import get_robot
from swingup.tasks.presets import get_task

IDS = {"acrobot": "swingup/Acrobot-v0", "pendubot": "swingup/Pendubot-v0"}
PUSH = np.ones(1, np.float32)
START = [1.0, -2.0, 3.0, -4.0]


def changed_task(robot="acrobot", **changes):
    return dataclasses.replace(get_task("paper", get_robot(robot)), **changes)


def make_two(robot="acrobot", **arguments):
    return PendulumVectorEnv(robot, num_envs=2, **arguments)


def actions(steps, *shape):
    return np.random.default_rng(0).uniform(-1, 1, (steps, *shape, 1)).astype(np.float32)


def states(env, steps=5, seed=None):
    """States of an episode under constant actions, the first included."""
    _, info = env.reset(seed=seed)
    return np.array([info["state"], *(env.step(PUSH)[4]["state"] for _ in range(steps))])


def test_gymnasiums_checker_passes(either_robot):
    check_env(PendulumEnv(either_robot.name), skip_render_check=True)  # which needs a spec
    made = gymnasium.make(IDS[either_robot.name], task="smooth").unwrapped
    assert isinstance(made, PendulumEnv)
    check_env(made)


def test_dm_controls_acrobot_by_its_ids():
    for kind, reward in (("", 0.1 ** (0.4**2)), ("Sparse", 0.0)):
        env = gymnasium.make(f"swingup/AcrobotSwingup{kind}-v0").unwrapped
        observation, _ = env.reset(options={"state": [np.pi + 0.3, 0.0, 0.0, 0.0]})
        assert env.observation_space.contains(observation)
        # The tip is some 4 sin(0.15) = 0.6 m from its highest place.
        assert env.step(np.zeros(1, np.float32))[1] == pytest.approx(reward, abs=0.01)
        assert (env.dt, env.metadata["render_fps"]) == (0.01, 100)


def test_id_with_module_registers_without_import_and_without_pillow():
    code = """if True:
        import sys, gymnasium
        env = gymnasium.make("swingup.gym:swingup/Pendubot-v0")
        assert env.unwrapped.task.robot.name == "pendubot"
        assert "PIL" not in sys.modules and "matplotlib" not in sys.modules
    """
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""


def test_environment_follows_the_task_step_by_step_and_clips_actions(either_robot):
    robot = either_robot.name
    task = changed_task(robot, truncation_probability=0.2)
    env = PendulumEnv(robot, task)
    reset, step = jax.jit(task.reset), jax.jit(task.step)

    observation, info = env.reset(seed=7)
    reset_key, key = jax.random.split(jax.random.key(7))
    state = reset(reset_key)
    np.testing.assert_allclose(info["state"], state.x, rtol=1e-6)
    np.testing.assert_allclose(observation, task.observe(state), rtol=1e-6)
    flags = []
    for action in actions(30):
        observation, reward, terminated, truncated, info = env.step(2.0 * action)
        step_key, key = jax.random.split(key)
        expected = step(state, np.clip(2.0 * action, -1.0, 1.0), step_key)
        state = expected.state
        np.testing.assert_allclose(info["state"], state.x, rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(observation, expected.observation, rtol=1e-4, atol=1e-5)
        assert reward == pytest.approx(float(expected.reward), rel=1e-4)
        assert truncated == bool(expected.truncated)
        assert not terminated
        flags.append(truncated)
        assert observation.flags.writeable
        assert info["state"].flags.writeable
    assert 0 < sum(flags) < 30


def test_seeds_repeat_and_differ():
    one, other, *unseeded = (PendulumEnv("acrobot") for _ in range(4))
    for seed in (1, None):  # the second episode goes on with the first one's keys
        np.testing.assert_array_equal(states(one, seed=seed), states(other, seed=seed))
    different = [states(one, seed=1), states(one), states(one, seed=2), *map(states, unseeded)]
    assert len(np.unique(different, axis=0)) == 5


def test_reset_starts_from_a_given_state():
    for env, states in ((PendulumEnv("acrobot"), START), (make_two(), [START, START])):
        np.testing.assert_allclose(env.reset(options={"state": START})[1]["state"], states)


BAD_RESETS = [
    {"seed": -1}, {"seed": 2**32}, {"seed": 1.5}, {"options": {"state": [0.0, 0.0, 0.0]}},
    {"options": {"state": [0.0, 0.0, float("nan"), 0.0]}}, {"options": {"state": [0.0, 0.0, 0.0, 2e3]}},
    {"options": {"state": "up"}}, {"options": {"start": START}},
]  # fmt: skip
BAD_ACTIONS = [np.array([np.nan]), np.array([np.inf]), np.zeros(2), 0.5, "up"]


@pytest.mark.parametrize("kind", [PendulumEnv, make_two])
def test_bad_resets_and_actions_are_refused_and_change_nothing(kind):
    env, untouched = kind("acrobot"), kind("acrobot")
    for each in (env, untouched):
        assert "call reset() before" in refusal(each.step, np.zeros(each.action_space.shape))
        each.reset(seed=3)
    for arguments in BAD_RESETS:
        told = refusal(env.reset, **arguments)
        assert any(word in told for word in ("seed = ", "state ", "'start'"))
    for action in BAD_ACTIONS:
        if kind is make_two and isinstance(action, np.ndarray):
            action = np.stack([np.zeros_like(action), action])
        told = refusal(env.step, action)
        assert any(word in told for word in ("is not finite", "pass shape", "is not numeric"))
    good = np.ones(env.action_space.shape)
    np.testing.assert_array_equal(env.step(good)[0], untouched.step(good)[0])


def test_the_plant_is_an_argument():
    env = gymnasium.make("swingup/Acrobot-v0", plant="cloudpendulum-rods").unwrapped
    assert float(env.task.parameters.tl2) == pytest.approx(0.13)
    assert float(env.task.parameters.l1) == pytest.approx(0.05)
    # Its own unit of time is 0.38 of C.1's 10 ms: 1 / 3.8 ms.
    assert env.metadata["render_fps"] == 263
    assert make_two("acrobot", task=changed_task(dt=0.02)).metadata["render_fps"] == 50
    vector = gymnasium.make_vec("swingup/Acrobot-v0", num_envs=2, plant="cloudpendulum-rods")
    assert float(vector.unwrapped.task.dt) == float(env.task.dt)


def test_second_environment_compiles_nothing(caplog):
    def run(env):
        states(env, steps=2, seed=0)
        env.reset(options={"state": START})

    run(PendulumEnv("acrobot"))
    with jax.log_compiles():
        run(PendulumEnv("acrobot"))
        # A task with other numbers (not other shapes) shares the code, too.
        run(PendulumEnv("acrobot", changed_task(reset_noise=0.5, dt=0.02)))
        assert "XLA compilation" not in caplog.text
        run(PendulumEnv("acrobot", changed_task(max_steps=2)))  # which is compiled in
        assert "XLA compilation" in caplog.text


def test_vector_equals_gymnasiums_batch_of_single_environments(either_robot):
    robot = either_robot.name
    # Environment i of both is seeded with seed + i and draws in the same order: all the randomness is the same.
    task = changed_task(robot, max_steps=3, truncation_probability=0.2)
    mine = gymnasium.make_vec(IDS[robot], num_envs=2, task=task)
    assert isinstance(mine, PendulumVectorEnv)
    same_step = {"autoreset_mode": AutoresetMode.SAME_STEP}
    theirs = gymnasium.make_vec(IDS[robot], 2, "sync", vector_kwargs=same_step, task=task)
    for name in ("metadata", "observation_space", "action_space"):
        assert getattr(mine, name) == getattr(theirs, name)
    assert data_equivalence(mine.reset(seed=5), theirs.reset(seed=5))
    ended = []
    for action in actions(30, 2):
        actual, expected = mine.step(action), theirs.step(action)
        assert data_equivalence(actual, expected)
        assert mine.observation_space.contains(actual[0])
        ended.append(actual[3][0])
    lengths = np.diff(np.flatnonzero(ended))
    assert min(lengths) < max(lengths) == 3  # at random, and by the limit
    assert data_equivalence(mine.reset(), theirs.reset())  # the keys go on, too


def test_pictures_show_the_state_and_the_torque():
    env = gymnasium.make(IDS["acrobot"], render_mode="rgb_array")
    env.reset(options={"state": START})
    frame = env.render()
    assert (frame.shape, frame.dtype) == ((400, 400, 3), np.uint8)
    state = env.step(PUSH)[4]["state"]
    pushed = env.render()
    env.reset(options={"state": state})
    assert not np.array_equal(env.render(), pushed)  # the same state, without the arrow
    blind = PendulumEnv("acrobot")
    blind.reset()
    assert blind.render() is None


L1, L2 = 0.2, 0.3
SCALE = 400 / (2 * 1.15 * 0.5)  # pixels per metre: the picture is 2 * 1.15 (l1 + l2) wide
RED, BLUE = (np.array([*bytes.fromhex(colour[1:])]) for colour in (DRIVEN, LINK_2))
HANGING = [0.0, 0.0, 0.0, 0.0]


def pixel(frame, right, up):
    """The colour at a place relative to the shoulder (m)."""
    return frame[round(200 - up * SCALE), round(200 + right * SCALE)]


def red_columns(frame):
    return np.nonzero(np.all(np.abs(frame - RED.astype(float)) < 20, axis=2))[1]


def test_tip_is_where_the_angles_put_it():
    for q1, q2, tip in (
        (0.0, 0.0, (0.0, -0.5)),  # hanging
        (math.pi, 0.0, (0.0, 0.5)),  # upright
        (math.pi / 2, 0.0, (0.5, 0.0)),  # counter-clockwise from hanging is to the right
        (0.0, math.pi / 2, (0.3, -0.2)),  # only link 2 to the right, from the elbow
        (math.pi / 2, math.pi / 2, (0.2, 0.3)),  # the elbow's angle is relative to link 1
    ):
        frame = draw_frame([q1, q2, 0.0, 0.0], L1, L2)
        assert (frame.shape, frame.dtype) == ((400, 400, 3), np.uint8)
        np.testing.assert_array_equal(pixel(frame, *tip), BLUE)


@pytest.mark.parametrize(("driven", "place", "other"), [(0, (0, 0), (0, -L1)), (1, (0, -L1), (0, 0))])
def test_driven_joint_is_marked(driven, place, other):
    frame = draw_frame(HANGING, L1, L2, driven=driven)
    np.testing.assert_array_equal(pixel(frame, *place), RED)
    assert not np.array_equal(pixel(frame, *other), RED)
    assert red_columns(draw_frame(HANGING, L1, L2)).size == 0


def test_torque_is_an_arrow_that_turns_with_its_sign():
    left, right, small, none = (
        red_columns(draw_frame([math.pi, 0.0, 0.0, 0.0], L1, L2, torque=[0.0, u])) for u in (4.0, -4.0, 1.0, 0.0)
    )
    # The arrow starts above the joint at column 200: counter-clockwise leads to the left.
    assert left.mean() < 195
    assert right.mean() > 205
    assert none.size == 0 < small.size < left.size > 50
