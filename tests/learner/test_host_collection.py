"""The host loop: the same algorithm, on environments with known answers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from areapo.test_probes import SMALL, softmax_policy, values
from swingup.areapo.config import Config
from swingup.areapo.initial import begin_episodes, init_learner
from swingup.learner import host_collection as host
from swingup.learner.environments import make_environments
from swingup.learner.host_backend import HostBackend
from swingup.learner.host_collection import collect_on_host

from .environments import Stairs, chains


def learn(mode, temperature):
    """Train on a cycle, at a high learning rate, then at a low one to settle; the metrics are the last part's."""
    # Many environments and few steps: the host pays by the step.
    sizes = {"num_envs": 64, "num_steps": 8, "temperature": temperature, "gain": Config().gain}
    config = Config(**(vars(SMALL) | sizes | {"gain_step_size": 0.05}))
    fine = Config(**(vars(config) | {"learning_rate": config.learning_rate / 10, "gain_step_size": 0.01}))
    env = chains(config.num_envs, "cycle", mode)
    first, second = (HostBackend(env, "cycle", c, [0], 0) for c in (config, fine))
    state = first.begin(first.init(), 0)
    state, _ = first.train(state, 120)
    state, _ = second.train(second.begin(state, 120), 50)
    state, (row,) = second.train(state, 60)
    return state, row


@pytest.mark.slow
@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP])
def test_gain_bias_and_policy_of_a_cycle(mode):
    # As without the choice ρ = 1 and v(1) - v(0) = 1; the choice adds softmax((0, 1, 2) / τ), whose soft gain is
    # τ log(1 + e^(1/τ) + e^(2/τ)). The time limit after 9 steps shows in the reward collected, not in the gain.
    best, objective = softmax_policy([0.0, 1.0, 2.0], 0.4)
    state, row = learn(mode, 0.4)
    assert row["gain"] + row["entropy_gain"] == pytest.approx(1.0 + objective, rel=0.02)
    assert row["gain"] == pytest.approx(1.0 + best @ [0, 1, 2], rel=0.02)
    assert row["reward"] == pytest.approx(8 / 9 + best @ [0, 1, 2], rel=0.02)
    stage = state.statistics.stage()
    policies = [np.asarray(jax.nn.softmax(state.actor(stage(jnp.array([s]))).logits)) for s in (0.0, 1.0)]
    np.testing.assert_allclose(policies, [best, best], atol=0.02)
    # v(0) = r(0) - ρ + v(1) and v(1) = r(1) - ρ + v(0), so that v(1) - v(0) = (r(1) - r(0)) / 2 of this policy.
    zero, one = values(state, [0.0, 1.0])[:, 0]
    assert one - zero == pytest.approx(1.0 + (policies[1] - policies[0]) @ [0, 1, 2] / 2, rel=0.02)
    assert row["episode_length"] == 9.0
    assert row["episode_return"] == pytest.approx(9 * row["reward"], rel=0.02)


TINY = Config(num_envs=2, num_steps=16, num_epochs=1, batch_size=32, policy_layers=(8,), value_layers=(8,))


@pytest.mark.parametrize("terminates", [False, True])
@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP])
def test_a_rollout_holds_what_the_actor_saw_and_did(mode, terminates):
    config = Config(**(vars(SMALL) | {"num_envs": 3, "num_steps": 10, "batch_size": 30}))
    environments = make_environments(SyncVectorEnv([lambda: Stairs(terminates)] * 3, autoreset_mode=mode), 3)
    state = jax.jit(init_learner, static_argnums=1)(jax.random.key(0), environments.spaces, config)
    state = begin_episodes(state, environments.reset(0))
    after, rollout = collect_on_host(state, environments, config)
    log_prob = jax.jit(jax.vmap(jax.vmap(lambda o, z: state.actor(o).log_prob(z))))
    log_probs = log_prob(rollout.observations, rollout.latents)
    np.testing.assert_allclose(log_probs, rollout.log_probs, atol=1e-5)
    assert np.ptp(rollout.latents) > 0.1
    # Where nothing ended the next observation is the next row's.
    following = np.concatenate([rollout.observations[1:], np.asarray(after.observations)[None]])
    same = np.isclose(rollout.next_observations, following, atol=1e-6)[..., 0]
    ended, never = (rollout.terminated, rollout.truncated)[:: 1 if terminates else -1]
    assert not never.any()
    np.testing.assert_array_equal(same, ~ended)
    # Episodes of three steps, and in one mode a row for the reset.
    every = 3 if mode is AutoresetMode.SAME_STEP else 4
    np.testing.assert_array_equal(np.flatnonzero(ended[:, 0]), np.arange(2, 10, every))
    if mode is AutoresetMode.NEXT_STEP:
        np.testing.assert_array_equal(np.flatnonzero(rollout.counted[:, 0] == 0), [3, 7])
    # 11 batches of three: the reset and ten steps.
    assert after.statistics.count == pytest.approx(33.0, abs=0.01)


def test_nothing_is_compiled_twice():
    # Episodes of three steps: rows with and without an end both come in the first rollout.
    backend = HostBackend(Stairs, "stairs", TINY, [0], 0)
    state, _ = backend.train(backend.begin(backend.init(), 0), 1)
    compiled = (host._sample, host._noise, host._advance, host._update)
    before = [function._cache_size() for function in compiled]
    state, _ = backend.train(state, 2)
    backend.train(backend.begin(state, 3), 1)
    assert [function._cache_size() for function in compiled] == before
