"""Options of networks, rewards, reset costs and schedules on both back ends: bits after a resume, policies."""

import dataclasses

import jax
import numpy as np
import pytest

from policies import load_any_policy
from swingup import AREAPO
from swingup.areapo.config import Config
from swingup.areapo.layers import LayerKind
from swingup.areapo.networks import init_policy
from swingup.common.errors import SwingupError
from swingup.controllers.stack.policy import Policy
from swingup.learner.policy_memory import memory_before
from swingup.learner.run_settings import RunSettings
from swingup.learner.start import resume_run, start_run
from swingup.tasks.task import Spaces

from .corridors import Corridor
from .environments import Noisy
from .test_run import assert_same_files, measured

TINY = Config(
    num_envs=2, num_steps=16, num_epochs=1, batch_size=16, policy_layers=(8, 8), value_layers=(8,),
    centre_values=True,
)  # fmt: skip
FRAMES = 32
"""Frames of one iteration."""
OPTIONS = {
    "activation": {"activation": "tanh"},
    "layer_norm": {"layer_norm": True},
    "shared_trunk": {"shared_trunk": True},
    "normalise_rewards": {"normalise_rewards": True},
    "one deviation": {"state_dependent_std": False},
    "gru": {"gru_width": 4, "shared_trunk": True},
    "adaptive": {"adaptive_reset_cost": "auto", "reset_cost": 2.0},
    "all": {"activation": "silu", "layer_norm": True, "shared_trunk": True, "normalise_rewards": True},
}
ON = {
    "host": lambda config: (RunSettings(None, "mujoco", 3, 1, 64, 128, config, "<noisy>", 2), Noisy),
    "compiled": lambda config: (RunSettings(None, "mujoco", 3, 1, 64, 128, config, "<corridor>", 2), Corridor()),
}


@pytest.mark.slow
@pytest.mark.parametrize("back_end", ON)
@pytest.mark.parametrize("option", OPTIONS)
def test_killed_and_resumed_equals_uninterrupted(tmp_path, option, back_end):
    changes = OPTIONS[option]
    settings, env = ON[back_end](dataclasses.replace(TINY, **changes))
    list(start_run(settings, tmp_path / "whole", 8 * FRAMES, env).advance())
    run = start_run(settings, tmp_path / "part", 8 * FRAMES, env)
    for report in run.advance():
        if report.frames == 6 * FRAMES:  # past the checkpoint at 4: what came since is lost
            break
    run = resume_run(tmp_path / "part", env=env)
    assert run.frames == 4 * FRAMES
    list(run.advance())
    assert_same_files(tmp_path / "whole", tmp_path / "part")
    assert measured(tmp_path / "whole") == measured(tmp_path / "part")
    costs = {row["reset_cost"] for row in measured(tmp_path / "part")}
    assert (len(costs) > 1) == (option == "adaptive")
    loaded, _ = load_any_policy(tmp_path / "whole" / "last.safetensors")
    kept = run.policy().actor
    assert (loaded.actor.activation, len(loaded.actor.norms)) == (kept.activation, 2 * ("layer_norm" in changes))
    # A file does not say that the deviation's weights were not to learn: they are 0.
    for found, expected in zip(jax.tree.leaves(loaded.actor), jax.tree.leaves(kept), strict=True):
        np.testing.assert_array_equal(found, expected)
    assert loaded.memory_size == changes.get("gru_width", 0)
    assert bool(run.progress.state.critic.trunk) == ("shared_trunk" not in changes)


def test_a_pendulums_controller_has_no_such_memory(tmp_path):
    config = dataclasses.replace(TINY, **OPTIONS["gru"])
    with pytest.raises(SwingupError, match="gru_width = 4 does not go with the acrobot, whose controllers have no"):
        start_run(RunSettings("acrobot", "default", 3, 1, 64, 128, config), None, FRAMES)


def test_states_of_predict():

    def of_width(width):
        kind = LayerKind(gru_width=width)
        return jax.eval_shape(lambda: Policy((), init_policy(jax.random.key(0), Spaces(2, 1), (4,), -1.0, kind)))

    policy, plain = of_width(3), of_width(0)
    state = np.arange(6.0).reshape(2, 3)
    assert not memory_before(policy, None, None, 2).any()
    np.testing.assert_array_equal(memory_before(policy, state, None, 2), state)
    np.testing.assert_array_equal(memory_before(policy, state, [True, False], 2), state * [[0], [1]])
    np.testing.assert_array_equal(memory_before(policy, state[0], np.bool_(False), 1), state[:1])
    with pytest.raises(SwingupError, match=r"state has shape \(3, 2\): pass what predict returned, \(2, 3\)"):
        memory_before(policy, state.T, None, 2)
    for words in ([[1.0], [2.0, 3.0]], [["a", "b", "c"]] * 2):
        with pytest.raises(SwingupError, match="state has no numbers"):
            memory_before(policy, words, None, 2)
    with pytest.raises(SwingupError, match="state is not finite"):
        memory_before(policy, state * np.nan, None, 2)
    with pytest.raises(SwingupError, match="pass a truth value"):
        memory_before(policy, None, [float("nan"), 1.0], 2)
    with pytest.raises(SwingupError, match=r"episode_start = \[True\]: pass a truth value for each of 2"):
        memory_before(policy, None, [True], 2)
    assert memory_before(plain, None, None, 2) is None
    with pytest.raises(
        SwingupError, match="state is for a policy with a memory: leave it out, or train with gru_width"
    ):
        memory_before(plain, state, None, 2)


@pytest.mark.slow
def test_predict_carries_the_state():
    model = AREAPO(Corridor(), num_envs=2, num_steps=16, batch_size=32, gru_width=4, shared_trunk=True).learn(32)
    seen = np.random.default_rng(0).normal(size=(5, 1, 2))
    states, actions = [None], []
    for each in seen:
        action, state = model.predict(each, state=states[-1])
        actions.append(action)
        states.append(state)
    again, first = model.predict(seen[0], state=states[-1], episode_start=True)
    np.testing.assert_array_equal(again, actions[0])
    np.testing.assert_array_equal(first, states[1])
    # Two episodes side by side are what each is alone.
    both, state = model.predict(seen[:2], state=np.concatenate([states[1], states[1]]), episode_start=[True, False])
    np.testing.assert_allclose(both, [actions[0], actions[1]], atol=1e-6)
    np.testing.assert_allclose(state, np.concatenate([states[1], states[2]]), atol=1e-6)
    sampled, _ = model.predict(seen[0], deterministic=False)
    assert not np.array_equal(sampled, actions[0])


@pytest.mark.slow
@pytest.mark.parametrize("back_end", ON)
def test_schedules_work(tmp_path, back_end):
    """Entropy counts nothing, the first of two iterations clips almost everything, and the second moves nothing."""
    config = dataclasses.replace(
        TINY, num_epochs=2, learning_rate=0.01, schedule_frames=2 * FRAMES,
        learning_rate_schedule=(0.0, 1.0, 0.25, 0.0), clip_range_schedule=(0.0, 0.01),
        temperature_schedule=(0.0, 0.0),
    )  # fmt: skip
    settings, env = ON[back_end](config)
    run = start_run(settings, None, 2 * FRAMES, env)
    state = run.backend.begin(run.progress.state, 0)
    first, metrics, _ = run.backend.train(state, 1)
    second, later, _ = run.backend.train(first, 1)
    run.close()
    # Each minibatch after the first sees other ratios than 1, which leave any range this narrow.
    assert float(metrics.losses.clip_fraction) > 0.5
    assert float(later.losses.clip_fraction) == 0.0
    assert float(metrics.entropy_gain) == float(later.entropy_gain) == 0.0
    assert not np.array_equal(state.actor.trunk[0].weight, first.actor.trunk[0].weight)
    jax.tree.map(np.testing.assert_array_equal, first.actor, second.actor)
