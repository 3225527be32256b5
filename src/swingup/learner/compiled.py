"""Worlds whose environments are compiled with the learner: the pendulum, and any other task in JAX."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Float, Shaped

from ..areapo import policy as policies
from ..areapo import train
from ..areapo.config import Config
from ..areapo.policy import Policy
from ..areapo.state import LearnerState, Metrics
from ..benchmark.evaluate import evaluate
from ..control.learned import PolicyController, save_controller
from ..physics.parameters import TORQUE_LIMIT, Robot
from ..tasks.pendulum import PendulumTask
from ..tasks.task import AbstractTask
from ..types import Key, Scalar
from .world import AbstractWorld, batched, portable_policy, seed_keys

EPISODE_STEPS = 1000
"""Longest episode of an evaluation of a task in JAX (steps)."""

# Compiled once for all runs of a program. A single seed goes without vmap, which costs it speed on a CPU.
_init = jax.jit(train.init)
_init_seeds = jax.jit(jax.vmap(train.init, in_axes=(0, None, None)))
_train = jax.jit(train.train, donate_argnums=0)
_train_seeds = jax.jit(jax.vmap(train.train, in_axes=(0, None, None, None)), donate_argnums=0)


@dataclasses.dataclass(frozen=True)
class Members:
    """One or several seeds of a compiled task, side by side; several devices share the seeds."""

    task: AbstractTask[Any]
    config: Config
    seed: int
    seeds: int

    def init(self) -> LearnerState:
        """The state of all seeds."""
        keys = seed_keys(self.seed, self.seeds)
        if self.seeds == 1:
            return _init(keys[0], self.task, self.config)
        return spread(_init_seeds(keys, self.task, self.config), self.seeds)

    def begin(self, state: LearnerState) -> LearnerState:
        """A state that was read from a file, on the devices."""
        return state if self.seeds == 1 else spread(state, self.seeds)

    def train(self, state: LearnerState, iterations: int) -> tuple[LearnerState, Metrics]:
        """Run some iterations in one compiled call."""
        advance = _train if self.seeds == 1 else _train_seeds
        return advance(state, self.task, self.config, iterations)


def spread(state: LearnerState, seeds: int) -> LearnerState:
    """Share the seeds among as many devices as divide them evenly."""
    count = max(n for n in range(1, len(jax.devices()) + 1) if seeds % n == 0)
    if count == 1:
        return state
    mesh = Mesh(np.array(jax.devices()[:count]), ("seeds",))
    return jax.device_put(state, NamedSharding(mesh, PartitionSpec("seeds")))


class PendulumWorld(AbstractWorld):
    """The double pendulum; policies are judged by the RealAI score."""

    measure = "v2"

    def __init__(self, task: PendulumTask, config: Config, seed: int, seeds: int) -> None:
        """Seeds of a task of the pendulum."""
        self.task = task
        self._members = Members(task, config, seed, seeds)

    def init(self) -> LearnerState:
        """The state before the first iteration."""
        return self._members.init()

    def begin(self, state: LearnerState, iterations: int) -> LearnerState:
        """The checkpoint holds everything."""
        return self._members.begin(state)

    def train(self, state: LearnerState, iterations: int) -> tuple[LearnerState, Metrics, dict[str, Any]]:
        """Run some iterations in one compiled call."""
        return *self._members.train(state, iterations), {}

    def policy(self, member: LearnerState) -> Policy[Any]:
        """The policy of a pendulum's state [q1, q2, dq1, dq2]."""
        return portable_policy((self.task.observation,), member, self._members.config)

    def evaluate(self, policy: Policy[Any], episodes: int | None = None) -> dict[str, Any]:
        """The criteria and the score of the one deterministic episode (rules v2)."""
        return dataclasses.asdict(evaluate(self._controller(policy), self._robot).criteria)

    def save(self, path: Path, policy: Policy[Any], provenance: Mapping[str, Any]) -> None:
        """Write a controller's policy file."""
        save_controller(path, self._controller(policy), provenance)

    def flatten(self, observation: Any) -> tuple[Float[np.ndarray, "b n"], bool]:
        """States [q1, q2, dq1, dq2] as a batch."""
        return batched(observation, (4,))

    def to_actions(self, actions: Shaped[np.ndarray, "b m"]) -> Shaped[np.ndarray, "b ..."]:
        """The task's actions are the policy's."""
        return actions

    def close(self) -> None:
        """Nothing to free."""

    @property
    def _robot(self) -> Robot:
        return self.task.robot

    def _controller(self, policy: Policy[Any]) -> PolicyController:
        return PolicyController(policy, TORQUE_LIMIT, self._robot)


class TaskWorld(AbstractWorld):
    """Any task in JAX; policies are judged by their mean return."""

    measure = "episodes"

    def __init__(self, task: AbstractTask[Any], config: Config, seed: int, seeds: int, episodes: int) -> None:
        """Seeds of a task."""
        self.task, self._episodes = task, episodes
        self._members = Members(task, config, seed, seeds)

    def init(self) -> LearnerState:
        """The state before the first iteration."""
        return self._members.init()

    def begin(self, state: LearnerState, iterations: int) -> LearnerState:
        """The checkpoint holds everything."""
        return self._members.begin(state)

    def train(self, state: LearnerState, iterations: int) -> tuple[LearnerState, Metrics, dict[str, Any]]:
        """Run some iterations in one compiled call."""
        return *self._members.train(state, iterations), {}

    def policy(self, member: LearnerState) -> Policy[Any]:
        """The policy of an observation."""
        return portable_policy((), member, self._members.config)

    def evaluate(self, policy: Policy[Any], episodes: int | None = None) -> dict[str, Any]:
        """Returns of episodes, cut after 1,000 steps."""
        keys = jax.random.split(jax.random.key(self._members.seed), episodes or self._episodes)
        total, length = jax.device_get(_episodes(policy, self.task, keys))
        return summary(total.tolist(), length.tolist())

    def save(self, path: Path, policy: Policy[Any], provenance: Mapping[str, Any]) -> None:
        """Write a policy file."""
        policies.save_policy(path, policy, provenance)

    def flatten(self, observation: Any) -> tuple[Float[np.ndarray, "b n"], bool]:
        """Observations as a batch."""
        return batched(observation, (self.task.observation_size,))

    def to_actions(self, actions: Shaped[np.ndarray, "b m"]) -> Shaped[np.ndarray, "b ..."]:
        """The task's actions are the policy's."""
        return actions

    def close(self) -> None:
        """Nothing to free."""


def summary(returns: list[float], lengths: list[int]) -> dict[str, Any]:
    """Means over episodes: the return, which is the score, its length, and the reward of a step."""
    mean_return = float(np.mean(returns))
    return {
        "score": mean_return,
        "mean_length": float(np.mean(lengths)),
        "mean_reward": float(np.sum(returns) / np.sum(lengths)),
    }


@jax.jit
def _episodes(policy: Policy[Any], task: AbstractTask[Any], keys: Key) -> tuple[jax.Array, jax.Array]:
    """Returns and lengths of the deterministic policy's episodes, one a key."""

    def episode(key: Key) -> tuple[Scalar, Scalar]:
        reset_key, steps_key = jax.random.split(key)

        def advance(carry: tuple[Any, ...], key: Key) -> tuple[tuple[Any, ...], None]:
            state, running, total, length = carry
            step = task.step(state, policy(task.observe(state)), key)
            after = (total + running * step.reward, length + running)
            return (step.state, running & ~(step.terminated | step.truncated), *after), None

        start = (task.reset(reset_key), jnp.array(True), jnp.zeros(()), jnp.array(0))
        (_, _, total, length), _ = jax.lax.scan(advance, start, jax.random.split(steps_key, EPISODE_STEPS))
        return total, length

    return jax.vmap(episode)(keys)
