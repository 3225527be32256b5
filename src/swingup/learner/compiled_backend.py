"""The world of tasks in JAX: environments are compiled with the learner, seeds train side by side."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Float, Shaped

from ..areapo import train
from ..areapo.config import Config
from ..areapo.state import LearnerState, Metrics
from ..policy.jax_backend.policy import Policy
from ..tasks.task import AbstractTask
from .backend import AbstractBackend, batched, portable_policy
from .evaluators import AbstractEvaluator

# Compiled once for all runs of a program. A single seed goes without vmap, which costs it speed on a CPU.
# The state is not donated: a run that is interrupted stands where it was.
_init = jax.jit(train.init)
_init_seeds = jax.jit(jax.vmap(train.init, in_axes=(0, None, None)))
_train = jax.jit(train.train)
_train_seeds = jax.jit(jax.vmap(train.train, in_axes=(0, None, None, None)))


class CompiledBackend(AbstractBackend):
    """One or several seeds of a task in JAX; several devices share the seeds."""

    def __init__(
        self, task: AbstractTask[Any], config: Config, seed: int, seeds: int, judge: AbstractEvaluator
    ) -> None:
        """Consecutive seeds of a task, and who judges their policies."""
        self.measure = judge.measure
        self._task, self._config, self._seeds, self._judge = task, config, range(seed, seed + seeds), judge

    def init(self) -> LearnerState:
        """The state before the first iteration."""
        keys = [jax.random.key(seed) for seed in self._seeds]
        if len(keys) == 1:
            return _init(keys[0], self._task, self._config)
        return _init_seeds(jnp.stack(keys), self._task, self._config)

    def begin(self, state: LearnerState, iterations: int) -> LearnerState:
        """A checkpoint holds everything; the devices take their shares."""
        return state if len(self._seeds) == 1 else spread(state, len(self._seeds))

    def train(self, state: LearnerState, iterations: int) -> tuple[LearnerState, Metrics, dict[str, Any]]:
        """Run some iterations in one compiled call."""
        advance = _train if len(self._seeds) == 1 else _train_seeds
        return *advance(state, self._task, self._config, iterations), {}

    def policy(self, member: LearnerState) -> Policy[Any]:
        """The policy of one seed."""
        return portable_policy(self._judge.stages, member, self._config)

    def evaluate(self, policy: Policy[Any], episodes: int | None = None) -> dict[str, Any]:
        """As the judge does."""
        return self._judge.evaluate(policy, episodes)

    def save(self, path: Path, policy: Policy[Any], provenance: Mapping[str, Any]) -> None:
        """As the judge does."""
        self._judge.save(path, policy, provenance)

    def flatten(self, observation: Any) -> tuple[Float[np.ndarray, "b n"], bool]:
        """What the policy is shown, as a batch: the pendulum's states, or the task's observations."""
        return batched(observation, (self._judge.input_size,))

    def to_actions(self, actions: Shaped[np.ndarray, "b m"]) -> Shaped[np.ndarray, "b ..."]:
        """The task's actions are the policy's."""
        return actions

    def close(self) -> None:
        """Nothing to free."""


def spread(state: LearnerState, seeds: int) -> LearnerState:
    """Share the seeds among as many devices as divide them evenly."""
    count = max(n for n in range(1, len(jax.devices()) + 1) if seeds % n == 0)
    if count == 1:
        return state
    mesh = Mesh(np.array(jax.devices()[:count]), ("seeds",))
    return jax.device_put(state, NamedSharding(mesh, PartitionSpec("seeds")))
