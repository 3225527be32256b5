"""Evaluators of compiled tasks: the pendulum's score by the benchmark, others by their return."""

import abc
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..areapo.state import Purpose, root_key
from ..benchmark.judge import judge
from ..common.errors import SwingupError
from ..common.types import Flag, Key
from ..controllers.stack.policy import Policy, PolicyController, save_controller, save_policy
from ..plant.plant import LEADERBOARD, Plant
from ..policy.pendulum import policy_plant
from ..tasks.acrobot_swingup import AcrobotPractice
from ..tasks.adapted import AbstractAdaptedTask
from ..tasks.observation import Stage
from ..tasks.pendulum import AbstractPendulumTask
from ..tasks.space_actions import SpaceActions
from ..tasks.task import AbstractTask
from .rates import rates, step_time

EPISODES = 10
"""Episodes of an evaluation that is asked for without a number."""
EPISODE_STEPS = 2000
"""Longest episode of an evaluation (steps), so that an endless task is scored, too.

No task of Gymnasium that these networks can see has a higher limit: BipedalWalkerHardcore-v3 has this one.
"""


class AbstractEvaluator(abc.ABC):
    """Scores the policies of a task and writes their files."""

    measure: str = "episodes"
    """Name under which policy files keep their scores."""
    stages: tuple[Stage, ...] = ()
    """Observation stages before the normalisation."""
    observation_shape: tuple[int, ...]
    """Shape of the input of the first stage, or without stages of the normalisation."""
    actions: SpaceActions | None = None
    """What makes the environment's actions; None where they are the policy's own."""

    @property
    def described_actions(self) -> dict[str, Any]:
        """The environment's actions as a policy file describes them; empty where they are the policy's own."""
        return {} if self.actions is None else self.actions.describe()

    @abc.abstractmethod
    def evaluate(self, policy: Policy[Any], episodes: int | None = None) -> dict[str, Any]:
        """Evaluate the deterministic policy; among the results is ``score``, the higher the better."""

    def save(self, path: Path, policy: Policy[Any], provenance: Mapping[str, Any]) -> None:
        """Write a policy file, with what the environment's actions are."""
        save_policy(path, policy, {**self.described_actions, **provenance})


class SwingUpEvaluator(AbstractEvaluator):
    """Evaluates by the criteria and the score of one swing-up on the task's plant."""

    measure = "v2"
    observation_shape = (4,)

    def __init__(self, task: AbstractPendulumTask, plant: Plant = LEADERBOARD) -> None:
        """The evaluator of a variant of the pendulum's task, on its plant, with the name that the plant has."""
        self.stages, self._robot = (task.observation,), task.robot
        # A task that was passed in may have a plant of its own.
        own = task.parameters != plant.driven(task.robot)
        self._plant = dataclasses.replace(task.parameters, name="the task's" if own else plant.name)

    def evaluate(self, policy: Policy[Any], episodes: int | None = None) -> dict[str, Any]:
        """The criteria of the one deterministic episode."""
        if episodes not in (None, 1):
            raise SwingupError(f"episodes = {episodes}, but a robot is scored by one episode: leave it out")
        return dataclasses.asdict(judge(self._controller(policy), self._robot, plant=self._plant).criteria)

    def save(self, path: Path, policy: Policy[Any], provenance: Mapping[str, Any]) -> None:
        """Write a controller's policy file."""
        save_controller(path, self._controller(policy), provenance)

    def _controller(self, policy: Policy[Any]) -> PolicyController:
        facts = policy_plant(self._plant, self._robot)
        return PolicyController(policy, facts.limit(self._robot.joint), self._robot, plant=facts)


class ReturnEvaluator(AbstractEvaluator):
    """Evaluates by the mean return of episodes of any task in JAX; they are the same each time."""

    def __init__(self, task: AbstractTask[Any], seed: int, episodes: int) -> None:
        """The evaluator of a task, with a default number of episodes."""
        adapted = task if isinstance(task, AbstractAdaptedTask) else None
        self.observation_shape = adapted.observation_shape if adapted else (task.observation_size,)
        self.actions = task.actions if isinstance(task, AbstractAdaptedTask | AcrobotPractice) else None
        self._task, self._seed, self._episodes = task, seed, episodes
        self._step_time = step_time(*(adapted.timed if adapted else (task,)))

    def evaluate(self, policy: Policy[Any], episodes: int | None = None) -> dict[str, Any]:
        """Means over the episodes."""
        # The same episodes each time, so that scores differ by the policy alone.
        keys = jax.random.split(root_key(self._seed, Purpose.EVALUATION), episodes or self._episodes)
        total, length, resets = jax.device_get(_episodes(policy, self._task, keys))
        return summarise_episodes(total.tolist(), length.tolist(), int(resets.sum()), self._step_time)


def check_actions(trained: Mapping[str, Any], found: Mapping[str, Any]) -> None:
    """Refuse an environment whose bounds would scale a policy's actions in another way than in training."""
    if trained != found:
        mine, its = (", ".join(f"{name} = {value}" for name, value in each.items()) for each in (trained, found))
        raise SwingupError(
            f"the policy was trained with {mine or 'actions of its own'}, the environment has {its or 'others'}: "
            "pass one with the same bounds, such as gymnasium.wrappers.RescaleAction gives"
        )


def summarise_episodes(
    returns: list[float], lengths: list[int], terminations: int, step_time: float | None = None
) -> dict[str, Any]:
    """Mean return, which is the score, and mean length of episodes; reward rate and resets of all their steps.

    Terminations are those of the task itself, not of a limit. A task without time has no seconds of a step.
    """
    steps = float(np.sum(lengths))
    means = {"score": float(np.mean(returns)), "mean_length": float(np.mean(lengths))}
    return means | rates(float(np.sum(returns) / steps), terminations / steps, step_time)


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
