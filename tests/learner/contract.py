"""The contract of tasks that adapt environments of other packages: what the learner counts on."""

from collections import namedtuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

TINY = {
    "num_envs": 2, "num_steps": 16, "num_epochs": 1, "batch_size": 32, "policy_layers": (8,), "value_layers": (8,),
    "evaluate_every": 64, "checkpoint_every": 128, "evaluation_episodes": 2,
}  # fmt: skip
"""Of trainings that only have to run."""


def moved_by(place, time):
    return lambda start: start + np.array([place, time])


Ending = namedtuple("Ending", "action steps terminated last")
"""An action that, held from the start, ends an episode after some steps, of the task or of its time; and the last
observation as a function of the first one."""


def check_contract(task, endings):
    """Check a task, and each of its endings."""
    first, second = jax.random.split(jax.random.key(5))
    _check_resets(task, first, second)
    for ending in endings:
        run = _holding(task, ending)
        steps, start = run(first)
        ended = np.asarray(steps.terminated | steps.truncated)
        assert ended.tolist() == [False] * (ending.steps - 1) + [True]
        # One flag alone: a time limit is no end of the task, and the other way round.
        assert bool(steps.terminated[-1]) is ending.terminated
        assert bool(steps.truncated[-1]) is not ending.terminated
        np.testing.assert_allclose(steps.observation[-1], ending.last(np.asarray(start)), rtol=1e-5, atol=1e-6)
        assert steps.reward.shape == (ending.steps,)
        again, _ = run(first)
        assert eqx.tree_equal(steps, again)


def _check_resets(task, first, second):
    """Resets are a function of the key, one by one and side by side, in the shapes that the task promises."""

    def observe(key):
        return task.observe(task.reset(key))

    side_by_side = jax.jit(jax.vmap(observe))(jnp.stack([first, second, first]))
    assert side_by_side.shape == (3, task.observation_size)
    assert side_by_side.dtype == jnp.float32
    np.testing.assert_array_equal(side_by_side[0], side_by_side[2])
    assert not np.array_equal(side_by_side[0], side_by_side[1])
    np.testing.assert_allclose(jax.jit(observe)(first), side_by_side[0], rtol=1e-5, atol=1e-6)


def _holding(task, ending):
    """A function of a key: an episode's steps, in one scan, which takes states of one type alone; and its start."""
    action = jnp.atleast_1d(jnp.asarray(ending.action, int if task.choices else jnp.float32))

    @jax.jit
    def run(key):
        start = task.reset(key)

        def advance(state, key):
            step = task.step(state, action, key)
            return step.state, step

        return jax.lax.scan(advance, start, jax.random.split(key, ending.steps))[1], task.observe(start)

    return run
