"""``estimate`` and the paper's task beside the authors' own learner and environment (data/README.md)."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from swingup.areapo import algorithm
from swingup.areapo.networks import Critic, Linear
from swingup.areapo.state import LearnerState, Rollout
from swingup.learner.presets import get_preset
from swingup.tasks.pendulum import PendulumState
from swingup.tasks.presets import get_task

DATA = Path(__file__).parent / "data"
PAPER = get_preset("paper")
estimate = jax.jit(algorithm.estimate)


def read_excerpt(robot):
    with np.load(DATA / f"authors-{robot.name}.npz") as file:
        return dict(file)


@pytest.fixture
def authors(robot):
    return read_excerpt(robot)


def both(numbers, reward_name, entropy_name):
    return np.stack([numbers[reward_name], numbers[entropy_name]], axis=-1)


def estimate_of(authors, gains):
    """``estimate`` with the authors' values for a critic.

    The observations are the values themselves, and the critic, without a hidden layer, hands them on.
    """
    following = both(authors, "next_value", "next_entropy_value")
    given = {
        "critic": Critic(trunk=(), activation="relu", heads=Linear(jnp.eye(2), jnp.zeros(2))),
        "gains": jnp.array(gains[:2], jnp.float32),
        "gain_trace": jnp.array(gains[2], jnp.float32),
        "observations": following[-1],  # no environment of the excerpt was truncated in the last step
        "iterations": jnp.array(0),
    }
    state = LearnerState(**dict.fromkeys(LearnerState.__dataclass_fields__) | given)
    rollout = Rollout(
        observations=both(authors, "value", "entropy_value"),
        latents=None,
        log_probs=authors["log_prob"],
        rewards=authors["reward"],
        next_observations=following,
        terminated=np.zeros_like(authors["truncated"]),
        truncated=authors["truncated"],
    )
    return estimate(state, rollout, PAPER.config)


def test_advantages_and_returns_are_the_authors(authors):
    assert authors["truncated"].sum(axis=0).tolist() == [0, 4]
    assert not authors["truncated"][-1].any()
    _, frames, means = estimate_of(authors, authors["gains_before"])
    expected = both(authors, "advantage", "entropy_advantage")
    values = both(authors, "value", "entropy_value")
    # Values near 300 are rounded to 3e-5 in single precision, here and there; advantages reach 6.
    np.testing.assert_allclose(frames.advantages, expected.sum(axis=-1), rtol=0, atol=2e-4)
    np.testing.assert_allclose(frames.returns, expected + values, rtol=0, atol=2e-4)
    np.testing.assert_allclose(means, values.mean(axis=(0, 1)), rtol=1e-6)


@pytest.mark.parametrize("trace", [1.0, 0.5])
def test_gains_move_as_the_authors(authors, trace):
    after, _, _ = estimate_of(authors, [*authors["gains_before"][:2], trace])
    # The authors' gains moved by the mean over 64 environments; these move by that over two.
    share = both(authors, "advantage", "entropy_advantage").mean(axis=(0, 1)) / authors["advantage_means"]
    moved = (authors["gains_after"] - authors["gains_before"])[:2] * share
    # The authors' trace was 1 and stayed there. From 0.5 it grows to 0.5 + 0.01 · 0.5 first, and divides the step.
    grown = {1.0: authors["gains_after"][2], 0.5: 0.505}[trace]
    assert float(after.gain_trace) == pytest.approx(grown, rel=1e-6)
    found = np.array(after.gains) - authors["gains_before"][:2]
    np.testing.assert_allclose(found, moved / grown, rtol=2e-4)


@pytest.mark.usefixtures("x64")
def test_transitions_are_those_of_the_authors_environment(either_robot):
    authors, task = read_excerpt(either_robot), get_task(PAPER.task, either_robot)

    @jax.jit
    @jax.vmap
    def step(x, action):
        return task.step(PendulumState(x, jnp.array(0)), action, jax.random.key(0))

    found = step(authors["transition_state"], authors["transition_action"])
    q1, q2, *rates = authors["transition_next"].T
    # Angles on both sides of where the reward wraps them, and velocities that the observation clips.
    assert min((q1 < 0).sum(), (q1 > 2 * np.pi).sum(), (np.abs(q2) > np.pi).sum()) >= 2
    assert (np.abs(rates) > 20).any(axis=0).sum() >= 5
    np.testing.assert_allclose(found.state.x, authors["transition_next"], rtol=0, atol=2e-12)
    np.testing.assert_allclose(found.reward, authors["transition_reward"], rtol=5e-14)
    np.testing.assert_allclose(found.observation, authors["transition_observation"], rtol=0, atol=1e-13)
    assert not found.terminated.any()
