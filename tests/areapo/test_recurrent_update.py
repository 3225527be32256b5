"""What a recurrent policy learns from: whole rollouts of environments and values along them, unrolled by NumPy."""

import jax
import numpy as np
import pytest

from swingup.areapo.config import Config
from swingup.areapo.layers import LayerKind, Linear
from swingup.areapo.loss import Frames, loss
from swingup.areapo.minibatches import minibatches
from swingup.areapo.networks import Critic, init_policy
from swingup.areapo.state import LearnerState, Rollout
from swingup.areapo.targets import estimate_values
from swingup.tasks.task import Spaces

STEPS, ENVS, WIDTH, CHOICES = 3, 4, 5, 3
CONFIG = Config(
    num_envs=ENVS, num_steps=STEPS, num_epochs=2, batch_size=2 * STEPS, policy_layers=(6,), shared_trunk=True,
    gru_width=WIDTH,
)  # fmt: skip


@pytest.fixture(scope="module")
def networks():
    """A policy of one of three actions for two numbers, and values that read its memory; all weights at random."""
    random = np.random.default_rng(1)
    shapes = jax.eval_shape(
        lambda key: init_policy(key, Spaces(2, 1, (CHOICES,)), (6,), -1.0, LayerKind(gru_width=WIDTH)),
        jax.random.key(0),
    )
    critic = Critic((), Linear(normal(random, 2, WIDTH), normal(random, 2)), shared=True)
    return jax.tree.map(lambda leaf: normal(random, *leaf.shape), shapes), critic


@pytest.fixture(scope="module")
def rollout():
    """At random, but for a truncation in the first environment and a termination in the second."""
    random = np.random.default_rng(2)
    ends = np.zeros((2, STEPS, ENVS), bool)
    ends[0, 1, 0] = ends[1, 0, 1] = True
    latents = random.integers(CHOICES, size=(STEPS, ENVS, 1))
    observations, following = normal(random, STEPS, ENVS, 2), normal(random, STEPS, ENVS, 2)
    memory = normal(random, ENVS, WIDTH)
    return Rollout(observations, latents, None, None, following, ends[1], ends[0], memory=memory)


def normal(random, *shape):
    return random.normal(0.0, 0.7, shape).astype(np.float32)


def remember(actor, memory, observation):
    """The memory after one observation of one environment."""
    (hidden,), gru = actor.trunk, actor.gru
    features = np.maximum(hidden.weight @ observation + hidden.bias, 0.0)
    r, z, n = np.split(gru.inputs.weight @ features + gru.inputs.bias, 3)
    by_r, by_z, by_n = np.split(gru.hidden.weight @ memory + gru.hidden.bias, 3)
    reset, keep = 1 / (1 + np.exp(-r - by_r)), 1 / (1 + np.exp(-z - by_z))
    return (1 - keep) * np.tanh(n + reset * by_n) + keep * memory


def along(actor, rollout):
    """Memories after each step (steps, envs, w), and before the first step that follows the rollout (envs, w)."""
    after, before = np.zeros((STEPS, ENVS, WIDTH)), np.array(rollout.memory)
    for step, env in np.ndindex(STEPS, ENVS):
        after[step, env] = remember(actor, before[env], rollout.observations[step, env])
        ended = rollout.terminated[step, env] or rollout.truncated[step, env]
        before[env] = 0.0 if ended else after[step, env]
    return after, before


def test_each_minibatch_repeats_what_was_collected(networks, rollout):
    """With unchanged weights log probabilities are those of the rollout, and values 2 and 3 below their targets."""
    actor, critic = networks
    after, _ = along(actor, rollout)
    logits = after @ actor.logits_head.weight.T + actor.logits_head.bias
    log_probs = np.take_along_axis(logits, rollout.latents, -1)[..., 0] - np.log(np.exp(logits).sum(-1))
    targets = after @ critic.heads.weight.T + critic.heads.bias + [2.0, 3.0]
    frames = Frames(
        rollout.observations, rollout.latents, log_probs.astype(np.float32), np.ones((STEPS, ENVS), np.float32),
        targets.astype(np.float32), None, rollout.memory, np.array(rollout.forgets),
    )  # fmt: skip

    @jax.jit
    def metrics(frames):
        orders, pick = minibatches(jax.random.key(3), frames, CONFIG)
        return orders, jax.vmap(lambda rows: loss(networks, pick(rows), CONFIG)[1])(orders)

    orders, found = metrics(frames)
    # Two environments a minibatch, each of them once in each of two epochs.
    assert orders.shape == (4, 2)
    assert np.sort(orders.reshape(2, ENVS)).tolist() == [[0, 1, 2, 3]] * 2
    np.testing.assert_allclose(found.approximate_kl, np.zeros(4), atol=1e-6)
    np.testing.assert_allclose(found.value_loss, np.full(4, 4.0), rtol=1e-5)
    np.testing.assert_allclose(found.entropy_value_loss, np.full(4, 9.0), rtol=1e-5)


def test_values_are_bootstrapped_with_the_memory_of_their_time(networks, rollout):
    """Of a truncated step with the memory that the reset erased; of a new start with none."""
    actor, critic = networks
    after, last = along(actor, rollout)
    observations = normal(np.random.default_rng(4), ENVS, 2)
    following = np.zeros((STEPS, ENVS, WIDTH))
    for step, env in np.ndindex(STEPS, ENVS):
        if rollout.truncated[step, env]:
            following[step, env] = remember(actor, after[step, env], rollout.next_observations[step, env])
        elif step < STEPS - 1:
            following[step, env] = after[step + 1, env]
        else:
            following[step, env] = remember(actor, last[env], observations[env])
    state = LearnerState(
        actor, critic, None, None, None, None, observations, None, None, memory=last.astype(np.float32)
    )
    found = jax.jit(lambda state, rollout: estimate_values(state, rollout, CONFIG)[1])(state, rollout)
    for values, memories in ((found.values, after), (found.next_values, following)):
        expected = memories @ critic.heads.weight.T + critic.heads.bias
        np.testing.assert_allclose(values, expected, atol=1e-5)
