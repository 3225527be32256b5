"""A recurrent policy: its memory along episodes, in the update and in files, and a task that needs it."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from policies import load_any_policy
from swingup.areapo import train
from swingup.areapo.act import decide, forget
from swingup.areapo.config import Config
from swingup.areapo.layers import LayerKind, Linear
from swingup.areapo.networks import init_policy
from swingup.areapo.recurrence import GRU
from swingup.areapo.state import Rollout
from swingup.areapo.unroll import unroll
from swingup.common.errors import SwingupError
from swingup.controllers.stack.policy import Policy, remember, save_policy
from swingup.tasks.task import Spaces

from .probes import Probe

STEPS, ENVS, WIDTH = 6, 3, 5


@pytest.fixture(scope="module")
def actor():
    """A policy of one of three actions for two numbers, with weights and biases at random."""
    random = np.random.default_rng(1)
    shapes = jax.eval_shape(
        lambda key: init_policy(key, Spaces(2, 1, (3,)), (8,), -1.0, LayerKind(gru_width=WIDTH)), jax.random.key(0)
    )
    return jax.tree.map(lambda leaf: random.normal(0.1, 0.5, leaf.shape).astype(np.float32), shapes)


def test_a_step_by_hand():
    """One number remembered: r = σ(1), z = σ(0), n = tanh(2 + r (3 + 0.5)), h' = (n + h) / 2."""
    inputs, hidden = np.float32([[1], [0], [2]]), np.float32([[0], [0], [6]])
    gru = GRU(Linear(inputs, np.zeros(3, np.float32)), Linear(hidden, np.float32([0, 0, 0.5])))
    after = float(jax.jit(GRU.__call__)(gru, np.float32([0.5]), np.float32([1.0]))[0])
    r = 1 / (1 + np.exp(-1.0))
    assert after == pytest.approx((np.tanh(2 + r * 3.5) + 0.5) / 2, rel=1e-6)


def test_the_update_sees_what_was_remembered(actor):
    """Log probabilities of an unrolled rollout are those of its collection, across the ends of episodes."""
    random = np.random.default_rng(0)
    observations = random.normal(size=(STEPS, ENVS, 2)).astype(np.float32)
    ended = random.uniform(size=(STEPS, ENVS)) < 0.4

    @jax.jit
    def step(seen, key, memory, ends):
        chosen = decide(actor, seen, actor.noise(key, (ENVS,)), memory)
        return chosen, forget(chosen.memory, ends)

    start = memory = random.normal(size=(ENVS, WIDTH)).astype(np.float32)
    rows, kept = [], []
    for index in range(STEPS):
        chosen, memory = step(observations[index], jax.random.key(index), memory, ended[index])
        rows.append(chosen)
        kept.append(memory)
    # Episodes start with the initial memory.
    assert not np.array(kept)[ended].any()
    assert np.all(np.array(kept)[~ended].any(axis=-1))
    latents, log_probs, after = (
        np.array([getattr(row, name) for row in rows]) for name in ("latents", "log_probs", "memory")
    )

    @jax.jit
    def replayed(observations):
        features = unroll(actor, start, observations, ended)
        each = jax.vmap(jax.vmap(lambda own, latent: actor.distribution(own).log_prob(latent)))
        return features, each(features, latents)

    features, found = replayed(observations)
    np.testing.assert_allclose(features, after, atol=1e-6)
    np.testing.assert_allclose(found, log_probs, atol=1e-6)
    assert np.ptp(log_probs) > 0.01


def test_a_memory_ends_with_the_row_of_a_reset():
    flags = np.array([[0, 1, 0, 0, 0]], bool).T
    rollout = Rollout(*[None] * 5, terminated=flags, truncated=np.roll(flags, 2), counted=1.0 - np.roll(flags, 1))
    assert rollout.forgets[:, 0].tolist() == [False, True, True, True, False]
    assert dataclasses.replace(rollout, counted=None).forgets[:, 0].tolist() == [False, True, False, True, False]


def test_a_file_keeps_the_recurrent_layer(actor, tmp_path):
    policy, observations = Policy((), actor), np.ones((4, 2), np.float32)
    save_policy(tmp_path / "p.safetensors", policy, {})
    loaded, metadata = load_any_policy(tmp_path / "p.safetensors")
    assert (metadata["gru"], loaded.memory_size) == (True, WIDTH)
    jax.tree.map(np.testing.assert_array_equal, loaded.actor, actor)
    memory, actions = remember(loaded, loaded.start(4), observations)
    assert (memory.shape, actions.shape) == ((4, WIDTH), (4, 1))
    with pytest.raises(SwingupError, match="this policy has a memory: pass it with each observation"):
        loaded(observations[0])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"gru_width": 8}, "gru_width = 8 needs shared_trunk"),
        (
            {"gru_width": 8, "shared_trunk": True, "num_steps": 64, "batch_size": 32},
            "batch_size = 32 is no multiple of num_steps = 64: with gru_width",
        ),
        ({"gru_width": -1}, "gru_width = -1: use a whole number from 0"),
    ],
)
def test_what_cannot_work_is_refused(wrong, message):
    with pytest.raises(SwingupError, match=message):
        Config(**wrong)


class Cue(Probe):
    """Shows ±1 at the first step only; afterwards the choice that it means pays 1."""

    choices = (2,)
    max_steps: int = 5

    def reset(self, key):
        return jnp.stack([jax.random.rademacher(key, (), float), 0.0])

    def observe(self, state):
        return jnp.where(state[1] == 0.0, state[:1], 0.0)

    def outcome(self, value, action):
        return (action == (value > 0)).astype(float), value

    def step(self, state, action, key):
        made = super().step(state, action, key)
        return dataclasses.replace(made, reward=jnp.where(state[1] == 0.0, 0.0, made.reward))


@pytest.mark.slow
@pytest.mark.parametrize(("gru_width", "least", "most"), [(8, 0.7, 0.8), (0, 0.3, 0.5)])
def test_a_cue_is_remembered(gru_width, least, most):
    """Four of five steps pay: 0.8 a step with memory, 0.4 without."""
    config = Config(
        num_envs=32, num_steps=20, num_epochs=4, batch_size=160, policy_layers=(16,), value_layers=(16,),
        shared_trunk=True, gru_width=gru_width, average_reward=False, discount=0.9, entropy_discount=0.9,
        temperature=0.01, clip_range=0.2, learning_rate=5e-3, gae_lambda=0.95,
    )  # fmt: skip
    task, init, advance = Cue(), jax.jit(train.init), jax.jit(train.train)
    state, _ = advance(init(jax.random.key(0), task, config), task, config, 100)
    _, metrics = advance(state, task, config, 10)
    assert least < float(metrics.reward) <= most
