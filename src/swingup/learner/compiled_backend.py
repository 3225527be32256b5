"""The back end of tasks in JAX: environments are compiled with the learner, seeds train side by side.

The pendulum's policies are scored by the benchmark, others by their mean return.
"""

import contextlib
import dataclasses
import functools
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from ..areapo import algorithm
from ..areapo.config import Config
from ..areapo.state import LearnerState, Metrics, Purpose, root_key
from ..benchmark.judge import judge
from ..common import cores
from ..common.errors import SwingupError
from ..common.types import Flag, Key, Observation, Scalar
from ..controllers.interface import from_zeros
from ..controllers.stack.policy import Policy, PolicyController, policy_of, save_controller
from ..plant.plant import LEADERBOARD, Plant
from ..policy.pendulum import STATES, TORQUE_SHARE, policy_plant
from ..policy.policy import Policy as FilePolicy
from ..policy.spaces import box
from ..tasks.acrobot_swingup import MAGNIFY, AcrobotPractice
from ..tasks.adapters import AbstractAdaptedTask
from ..tasks.pendulum import AbstractPendulumTask
from ..tasks.task import AbstractTask
from .backend import EPISODE_STEPS, AbstractBackend, AbstractEvaluator, split_seeds, summarise_episodes
from .metrics import Evaluation, TrainingMetrics, step_time

# Compiled once for all runs of a program. A single seed runs without vmap, which is slower on a CPU.
# The state is not donated: an interrupted run can continue from the state before the chunk.
_init = jax.jit(algorithm.init)
_init_seeds = jax.jit(jax.vmap(algorithm.init, in_axes=(0, None, None)))
_train = jax.jit(algorithm.train)

COUNT_FLAG = "xla_force_host_platform_device_count"  # In XLA_FLAGS: how many devices a CPU shows
AXIS = "seeds"  # Along which devices share the seeds
CALL_WORK = 5e9  # Frames times weights of all seeds in a compiled call on a CPU: about a second of two cores
RESETS_TRIED = 1024  # Resets that are inspected after training diverged


class CompiledBackend(AbstractBackend):
    """One or several seeds of a task in JAX; several devices share the seeds."""

    pause = 0.0  # Nothing waits

    def __init__(
        self, task: AbstractTask[Any], config: Config, seeds: Sequence[int], evaluator: AbstractEvaluator
    ) -> None:
        self._task, self._config, self._seeds, self.evaluator = task, config, seeds, evaluator
        self._advance = _train if len(seeds) == 1 else _train_shared(sharing_mesh(len(seeds)))

    def init(self) -> LearnerState:
        """The state before the first iteration."""
        keys = [root_key(seed, Purpose.TRAINING) for seed in self._seeds]
        if len(keys) == 1:
            return _init(keys[0], self._task, self._config)
        return _init_seeds(jnp.stack(keys), self._task, self._config)

    def compile(self, state: LearnerState) -> None:
        """Compile a chunk of training, and an evaluation by running one."""
        # Shared among the devices first: where arrays lie is part of what is compiled.
        state = self.begin(state, 0)
        # One iteration stands for any number, since the number is traced.
        self._advance.lower(state, self._task, self._config, 1).compile()
        self.evaluator.evaluate(self.policy(split_seeds(state, len(self._seeds))[0]))

    def begin(self, state: LearnerState, iterations: int) -> LearnerState:
        """Share the seeds among the devices. Nothing is reset: a checkpoint holds everything."""
        if len(self._seeds) == 1:
            return state
        return jax.device_put(state, NamedSharding(sharing_mesh(len(self._seeds)), PartitionSpec(AXIS)))

    def train(
        self, state: LearnerState, iterations: int, stopping: Callable[[], bool] = lambda: False
    ) -> tuple[LearnerState, list[TrainingMetrics]]:
        """Run some iterations, on a CPU in compiled calls of about a second: they know no signals."""
        weights = sum(leaf.size for leaf in jax.tree.leaves((state.actor, state.critic)))
        call_iterations = max(1, int(CALL_WORK / (weights * self._config.rollout_size)))
        call_iterations = call_iterations if jax.default_backend() == "cpu" else iterations
        counts: list[int] = []
        parts = []
        while sum(counts) < iterations and not (counts and stopping()):
            counts.append(min(call_iterations, iterations - sum(counts)))
            state, metrics = self._advance(state, self._task, self._config, counts[-1])
            parts.append(jax.device_get(metrics))
        means = jax.tree.map(lambda *leaves: np.average(leaves, 0, counts).astype(np.float32), *parts)
        return state, list(map(TrainingMetrics, split_seeds(means, len(self._seeds))))

    def evaluate(self, policies: Sequence[Policy[Any]]) -> list[Evaluation]:
        """The results of the policies of all seeds."""
        if len(policies) == 1:
            return [self.evaluator.evaluate(policies[0])]
        # A simulation is a chain of small steps, which a second core does not shorten: each seed has a thread.
        with ThreadPoolExecutor(len(policies)) as pool:
            return list(pool.map(self.evaluator.evaluate, policies))

    def find_fault(self) -> str:
        """Whether resets of the task, or first steps with random actions, give numbers that are not finite."""

        def try_out(key: Key) -> tuple[Observation, Observation, Scalar]:
            state, spaces = self._task.reset(key), self._task.spaces
            action = jax.random.uniform(key, (spaces.action_size,), minval=-1.0, maxval=1.0)
            if spaces.choices:
                action = jnp.floor(0.5 * (action + 1.0) * jnp.asarray(spaces.choices)).astype(int)
            taken = self._task.step(state, action, key)
            return self._task.observe(state), self._task.observe(taken.state), taken.reward

        keys = jax.random.split(root_key(self._seeds[0], Purpose.FAULT_SEARCH), RESETS_TRIED)
        what = "resets gave an observation", "steps gave an observation", "steps gave a reward"
        for words, found in zip(what, jax.jit(jax.vmap(try_out))(keys), strict=True):
            if broken := int(np.sum(~np.isfinite(np.asarray(found)).reshape(RESETS_TRIED, -1).all(axis=1))):
                return f"{broken} of {RESETS_TRIED} {words} that is not finite: correct the task"
        return ""

    def close(self) -> None:
        """Nothing to free."""


def even_shares(seeds: int, devices: int) -> int:
    """The maximum number of devices that share the seeds evenly: JAX cuts an axis into equal parts."""
    return max(count for count in range(1, devices + 1) if seeds % count == 0)


def share_cores(seeds: int) -> None:
    """Make JAX show as many of the CPU's cores as devices as share the seeds evenly.

    It works only before JAX's first computation. Afterwards, and where the user's XLA_FLAGS set the number of
    devices, nothing changes: the seeds then train on the devices that there are.

    Asynchronous dispatch is switched off as well. Programs on several devices run in threads of XLA, of which a CPU
    has one for each core. With asynchronous dispatch, programs on one device, such as evaluations, hold these
    threads, too; without it they run in the thread that calls them.
    """
    count = even_shares(seeds, cores())
    if count == 1 or COUNT_FLAG in os.environ.get("XLA_FLAGS", ""):
        return
    with contextlib.suppress(RuntimeError):
        jax.config.update("jax_num_cpu_devices", count)
        jax.config.update("jax_cpu_enable_async_dispatch", False)


def sharing_mesh(seeds: int) -> Mesh:
    """The devices that share the seeds."""
    devices = jax.devices()
    return Mesh(np.array(devices[: even_shares(seeds, len(devices))]), (AXIS,))


@functools.cache
def _train_shared(mesh: Mesh) -> Any:
    """A compiled function that trains several seeds; a device that has one trains it without vmap."""

    def train_own(state: LearnerState, *rest: Any) -> tuple[LearnerState, Metrics]:
        if state.iterations.shape[0] > 1:
            return jax.vmap(algorithm.train, in_axes=(0, None, None, None))(state, *rest)
        trained = algorithm.train(jax.tree.map(lambda leaf: leaf[0], state), *rest)
        return jax.tree.map(lambda leaf: leaf[None], trained)

    own, common = PartitionSpec(AXIS), PartitionSpec()
    # No seed sees another: there is nothing to check between devices.
    return jax.jit(
        jax.shard_map(train_own, mesh=mesh, in_specs=(own, common, common, common), out_specs=own, check_vma=False)
    )


class SwingUpEvaluator(AbstractEvaluator):
    """Evaluates by the criteria and the score of one swing-up on the task's plant."""

    measure = "v2"
    default_episodes = 1
    observation_space, action_space = STATES, TORQUE_SHARE

    def __init__(self, task: AbstractPendulumTask, plant: Plant = LEADERBOARD) -> None:
        """The evaluator of a variant of the pendulum's task, on its plant, with the name that the plant has."""
        self.stages, self._robot, self.task = (task.observation,), task.robot, task.robot.name
        # A task that was passed in may have a plant of its own.
        own = task.parameters != plant.driven(task.robot)
        self._plant = dataclasses.replace(task.parameters, name="the task's" if own else plant.name)

    def evaluate(self, policy: Policy[Any], episodes: int | None = None) -> Evaluation:
        """The criteria of the one deterministic episode."""
        if episodes not in (None, 1):
            raise SwingupError(f"episodes = {episodes}, but a robot is scored by one episode: leave it out")
        controller = from_zeros(self._controller(policy), self._plant)
        criteria = judge(controller, self._robot, plant=self._plant).criteria
        return Evaluation(criteria.score, criteria=criteria)

    def file_policy(self, policy: Policy[Any]) -> FilePolicy:
        """What a file holds of a controller."""
        return policy_of(self._controller(policy))

    def save(self, path: Path, policy: Policy[Any], provenance: Mapping[str, Any]) -> None:
        """Write a controller's policy file."""
        save_controller(path, self._controller(policy), provenance)

    def _controller(self, policy: Policy[Any]) -> PolicyController:
        facts = policy_plant(self._plant, self._robot)
        return PolicyController(policy, facts.limit(self._robot.joint), self._robot, plant=facts)


class ReturnEvaluator(AbstractEvaluator):
    """Evaluates by the mean return of episodes of any task in JAX; they are the same each time."""

    def __init__(self, task: AbstractTask[Any], seed: int, episodes: int, name: str) -> None:
        adapted = task if isinstance(task, AbstractAdaptedTask) else None
        self.observation_space = box(adapted.observation_shape if adapted else (task.observation_size,))
        self.action_space = adapted.actions if adapted else task.own_actions
        if isinstance(task, AcrobotPractice):
            # A file's policy acts in the task itself, whose action is a number.
            self.stages, self.action_space = () if task.magnifies else (MAGNIFY,), box((1,), -1.0, 1.0)
        self._game, self._seed, self._episodes, self.task = task, seed, episodes, name
        self.step_time = step_time(*(adapted.timed if adapted else (task,)))

    def evaluate(self, policy: Policy[Any], episodes: int | None = None) -> Evaluation:
        """Means over the episodes."""
        # The same episodes each time, so that scores differ by the policy alone.
        keys = jax.random.split(root_key(self._seed, Purpose.EVALUATION), episodes or self._episodes)
        total, length, resets = jax.device_get(_episodes(policy, self._game, keys))
        return summarise_episodes(total.tolist(), length.tolist(), int(resets.sum()), self.step_time)


@jax.jit
def _episodes(policy: Policy[Any], task: AbstractTask[Any], keys: Key) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Returns, lengths and terminations of the deterministic policy's episodes, one a key."""
    reset_keys, step_keys = jax.vmap(jax.random.split, out_axes=1)(keys)
    none = jnp.zeros(len(keys), jnp.int32)

    def goes_on(carry: tuple[Any, ...]) -> Flag:
        time, _, running, *_ = carry
        return (time < EPISODE_STEPS) & jnp.any(running)

    def advance(carry: tuple[Any, ...]) -> tuple[Any, ...]:
        time, state, running, total, length, resets = carry
        action = jax.vmap(policy)(jax.vmap(task.observe)(state))
        step = jax.vmap(task.step)(state, action, jax.vmap(jax.random.fold_in, (0, None))(step_keys, time))
        # An episode that ended is still stepped until the last one ends, but no longer counted.
        total = jnp.where(running, total + step.reward, total)
        after = (total, length + running, resets + (running & step.terminated))
        return time + 1, step.state, running & ~(step.terminated | step.truncated), *after

    start = (jax.vmap(task.reset)(reset_keys), none == 0, none * 0.0, none, none)
    _, _, _, total, length, resets = jax.lax.while_loop(goes_on, advance, (jnp.array(0), *start))
    return total, length, resets
