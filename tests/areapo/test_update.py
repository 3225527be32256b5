"""One update from a rollout made by hand: its parts in their order, and rows that must not count."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from refusals import refusal
from swingup.areapo import algorithm, checkpoint
from swingup.areapo.checkpoint import load_checkpoint, read_metadata, save_checkpoint
from swingup.areapo.config import Config
from swingup.areapo.initial import init_learner
from swingup.areapo.state import Purpose, Rollout, root_key
from swingup.tasks.task import Spaces

CONFIG = Config(
    num_envs=1, num_steps=7, num_epochs=1, batch_size=7, policy_layers=(8,), value_layers=(8,), temperature=0.0,
    gain="td", gae_lambda=(1.0, 1.0), terminations="reset_cost", reset_cost=2.0, normalise_rewards=True,
    schedule="anneal_lambda", schedule_frames=700,
)  # fmt: skip
RESET = 3
"""The row in which the environment did nothing but reset itself, after the task had ended in the row before."""


@jax.jit
def updated(noise):
    """The learner and its metrics after the rollout, at the schedule's end; noise stands in the reset row."""
    state = init_learner(jax.random.key(0), Spaces(3, 1), CONFIG)
    # All values are 0, so that only rewards make advantages.
    critic = state.critic.with_values(jnp.zeros(2), jnp.zeros(2))
    state = dataclasses.replace(state, critic=critic, iterations=jnp.array(1000))
    observations = jax.random.normal(jax.random.key(1), (7, 1, 3)).at[RESET].add(noise)
    latents = jax.random.normal(jax.random.key(2), (7, 1, 1)).at[RESET].add(noise)
    log_probs = jax.vmap(jax.vmap(lambda o, z: state.actor(o).log_prob(z)))(observations, latents)
    rollout = Rollout(
        observations=observations,
        latents=latents,
        log_probs=log_probs,
        rewards=jnp.array([3.0, 3.0, 5.0, noise, -3.0, -3.0, -3.0])[:, None],
        next_observations=observations,
        terminated=jnp.zeros((7, 1), bool).at[RESET - 1].set(True),
        truncated=jnp.zeros((7, 1), bool),
        counted=jnp.ones((7, 1)).at[RESET].set(0.0),
    )
    return algorithm.update(state, rollout, CONFIG)


def test_an_update_by_hand():
    state, metrics = updated(0.0)
    # As collected: (3 + 3 + 5 - 9) / 6, of which the learner sees 5 - 2, hence the mean 0.
    assert float(metrics.reward) == pytest.approx(1 / 3)
    assert float(metrics.reset_cost) == 2.0
    assert float(metrics.gain) == pytest.approx(0.0, abs=1e-6)
    assert float(metrics.termination_rate) == pytest.approx(1 / 6)
    # The rewards' unit has λ = 1, before the schedule: the sums are 3, 6, 9 and, after the reset, -3, -6, -9.
    assert float(state.sum_statistics.variance) == pytest.approx(2 * (9 + 36 + 81) / 6)
    # The schedule's end is λ = 0.9: returns of (3 / √42) times 2.71, 1.9 and 1, and their negatives.
    assert float(metrics.losses.value_loss) == pytest.approx(9 / 42 * (2.71**2 + 1.9**2 + 1) / 3, rel=1e-5)
    # At the ratio 1 it is minus the mean of the normalised advantages of the rows that count.
    assert float(metrics.losses.policy_loss) == pytest.approx(0.0, abs=1e-6)
    assert float(metrics.gradient_norm) > 0.01


def test_what_stands_in_the_row_of_a_reset_changes_nothing():
    jax.tree.map(np.testing.assert_array_equal, *(jax.tree.map(words, updated(noise)) for noise in (0.0, 5.0)))


def words(leaf):
    return jax.random.key_data(leaf) if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key) else leaf


def test_each_purpose_of_each_seed_has_a_key_of_its_own():
    keys = [root_key(seed, purpose) for seed in (0, 1) for purpose in Purpose]
    assert len({jax.random.key_data(key).tobytes() for key in keys}) == 2 * len(Purpose)


TREE = {
    "weights": jnp.array([1.0, jnp.pi, 1e-38]),
    "nested": (jnp.arange(3), jnp.array(True)),
    "key": jax.random.key(7),
    "keys": jax.random.split(jax.random.key(8), 2),
}
LIKE = jax.eval_shape(lambda: TREE)


@pytest.fixture
def path(tmp_path):
    save_checkpoint(tmp_path / "c.safetensors", TREE, {"frames": 12, "best": [0.1]})
    return tmp_path / "c.safetensors"


def test_round_trip_is_exact(path):
    tree, metadata = load_checkpoint(path, LIKE)
    assert eqx.tree_equal(tree, TREE)
    assert (metadata["frames"], metadata["best"]) == (12, [0.1])
    # The keys draw what they drew.
    np.testing.assert_array_equal(jax.random.normal(tree["key"], (3,)), jax.random.normal(TREE["key"], (3,)))


def test_other_configurations_are_refused(path):
    for changes, named in (
        ({"weights": jnp.zeros(4)}, "weights as float32[3]"), ({"weights": jnp.zeros(3, jnp.int32)}, "needs int32"),
        ({"extra": jnp.zeros(1)}, "lacks extra"),
    ):  # fmt: skip
        assert named in refusal(load_checkpoint, path, TREE | changes)


def test_a_large_configuration_is_read_and_a_large_foreign_array_is_not(path, monkeypatch):
    # The bound of files is 2 kB here: the tree of 17 kB is more than that, and what it needs.
    monkeypatch.setattr(checkpoint, "LARGEST_ARRAYS", 2000)
    large = {"weights": jnp.zeros(4096)}
    save_checkpoint(path, large, {})
    assert eqx.tree_equal(load_checkpoint(path, jax.eval_shape(lambda: large))[0], large)
    small = {"weights": jax.ShapeDtypeStruct((3,), jnp.float32)}
    assert "MB of arrays, where a swingup checkpoint file may have" in refusal(load_checkpoint, path, small)
    # Names that the configuration does not have are not even looked at.
    assert load_checkpoint(path, {})[0] == {}
    assert read_metadata(path)["format"] == "swingup checkpoint"
