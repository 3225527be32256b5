"""The interfaces of a back end, which steps the environments of a run's seeds, and of its policies' evaluator."""

import abc
import contextlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from ..areapo.state import LearnerState
from ..common.errors import SwingupError
from ..controllers.stack.policy import Policy, network_of, save_policy
from ..policy.policy import Policy as FilePolicy
from ..policy.policy import TaskPolicy, task_metadata
from ..policy.spaces import Space
from ..tasks.task import Spaces, Stage
from .metrics import Evaluation, TrainingMetrics, make_evaluation

TreeT = TypeVar("TreeT")

EPISODES = 10  # Episodes of an evaluation without a given number
EPISODE_STEPS = 2000
"""Longest episode of an evaluation (steps), so that an endless task is scored, too.

No task of Gymnasium that these networks can see has a higher limit: BipedalWalkerHardcore-v3 has this one.
"""


class AbstractEvaluator(abc.ABC):
    """Scores the policies of a task and writes their files."""

    measure: str = "episodes"  # Name under which policy files keep their scores
    default_episodes: int = EPISODES  # Episodes of an evaluation without a given number
    stages: tuple[Stage, ...] = ()  # Observation stages before the normalisation
    task: str  # The robot, or the id or the description of the environment
    observation_space: Space
    """The input of the first stage, or without stages of the normalisation."""
    action_space: Space
    step_time: float | None = None  # Time of a step (s), where the task has one

    @property
    def described(self) -> dict[str, Any]:
        """The task as a policy file describes it."""
        return task_metadata(self.task, self.observation_space, self.action_space, self.step_time)

    @abc.abstractmethod
    def evaluate(self, policy: Policy[Any], episodes: int | None = None) -> Evaluation:
        """Evaluate the deterministic policy."""

    def file_policy(self, policy: Policy[Any]) -> FilePolicy:
        """What a file holds of a policy, in NumPy."""
        return TaskPolicy(network_of(policy), self.described)

    def save(self, path: Path, policy: Policy[Any], provenance: Mapping[str, Any]) -> None:
        """Write a policy file with where it comes from."""
        save_policy(path, policy, {**self.described, **provenance})


class AbstractBackend(abc.ABC):
    """A task, compiled or stepped by the host, on which seeds train; the state of several has a leading axis."""

    evaluator: AbstractEvaluator  # Scores and saves the policies
    pause: float | None = None  # Time of an update, in which environments of the host wait (s); None: not known yet

    @abc.abstractmethod
    def init(self) -> LearnerState:
        """The state before the first iteration."""

    @abc.abstractmethod
    def compile(self, state: LearnerState) -> None:
        """Compile the functions that training calls, from the shapes of a state."""

    @abc.abstractmethod
    def begin(self, state: LearnerState, iterations: int) -> LearnerState:
        """Prepare to continue from a checkpoint after this number of iterations.

        State that a checkpoint does not hold is reset, in a way that depends only on the seed and the iterations.
        """

    @abc.abstractmethod
    def train(
        self, state: LearnerState, iterations: int, stopping: Callable[[], bool] = lambda: False
    ) -> tuple[LearnerState, list[TrainingMetrics]]:
        """Run iterations; return the state and the metrics of each seed.

        ``stopping`` is called every few seconds; once it returns true, training stops early.
        """

    def policy(self, member: LearnerState) -> Policy[Any]:
        """The policy of one seed, in NumPy: the evaluator's stages, the present normalisation, the actor.

        Stages and normalisation are in double precision, which the judge uses, although training is in single.
        """
        stages = (*self.evaluator.stages, member.statistics.stage())
        # Done here, in NumPy: outside a local x64 context, JAX would round them to float32.
        stages = jax.tree.map(lambda leaf: np.asarray(leaf, np.float64), stages)
        return Policy(stages, jax.tree.map(np.asarray, member.actor))

    @abc.abstractmethod
    def evaluate(self, policies: Sequence[Policy[Any]]) -> list[Evaluation]:
        """The results of the policies of all seeds, by which :func:`.rank` compares them."""

    def occupied(self) -> contextlib.AbstractContextManager[None]:
        """While a run advances, also in its callbacks: nobody else may reset its environments."""
        return contextlib.nullcontext()

    def memory(self) -> Any:
        """What it knows of its environments beside the learner's state, as JSON values, for a checkpoint."""
        return None

    def remember(self, memory: Any) -> None:
        """Take up what :meth:`memory` gave before."""
        del memory  # nothing

    def find_fault(self) -> str:
        """The fault of the environment after training diverged, with its remedy; empty if there is none."""
        return ""  # the host checks every observation and reward when it comes

    @abc.abstractmethod
    def close(self) -> None:
        """Free the environments."""


def split_seeds(tree: TreeT, seeds: int) -> list[TreeT]:
    """The states or metrics of the seeds one by one, in NumPy where there are several.

    Where devices share the seeds, an index in JAX would be a program on all of them for every leaf. Many such
    programs, started at once, can wait for each other without end on a CPU.
    """

    def rows(leaf: jax.Array) -> Any:
        if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
            return [jax.random.wrap_key_data(row) for row in np.asarray(jax.random.key_data(leaf))]
        return list(np.asarray(leaf))

    if seeds == 1:
        return [tree]
    leaves, structure = jax.tree.flatten(tree)
    return [jax.tree.unflatten(structure, member) for member in zip(*map(rows, leaves), strict=True)]


def join_seeds(members: Sequence[LearnerState]) -> LearnerState:
    """The states of several seeds as one, with a leading axis."""
    return members[0] if len(members) == 1 else jax.tree.map(lambda *leaves: jnp.stack(leaves), *members)


def check_actions(trained: Any, found: Space) -> None:
    """Refuse an environment whose bounds would scale a policy's actions in another way than in training.

    ``trained`` is what a file describes them by.
    """
    if _meaning(trained) != _meaning(found.describe()):
        raise SwingupError(
            f"the policy was trained with actions {shown(trained)}, the environment has {shown(found.describe())}: "
            "pass one with the same bounds, such as gymnasium.wrappers.RescaleAction gives"
        )


def _meaning(space: Any) -> Any:
    """What an action means, whatever its type."""
    return {**space, "dtype": None} if isinstance(space, Mapping) else space


def shown(space: Any) -> str:
    """A description of a space for a message, as ``box, low = [-2.0], high = [2.0]``."""
    if not isinstance(space, Mapping) or not space:
        return "of no space"
    kind, *others = (f"{name} = {value}" for name, value in space.items())
    return ", ".join([kind.removeprefix("type = "), *others])


def summarise_episodes(
    returns: list[float], lengths: list[int], terminations: int, step_time: float | None = None
) -> Evaluation:
    """Mean return, which is the score, and mean length of episodes; reward rate and resets of all their steps.

    Terminations are those of the task itself, not of a limit. A task without time has no seconds of a step.
    """
    steps = float(np.sum(lengths))
    rate, means = float(np.sum(returns) / steps), (float(np.mean(returns)), float(np.mean(lengths)))
    return make_evaluation(*means, rate, terminations / steps, step_time)


def check_spaces(policy: Policy[Any], spaces: Spaces) -> None:
    """Refuse an environment whose observations or actions are not the policy's."""
    network = network_of(policy)
    seen, choices = network.input_size, network.choices or ()
    if seen != spaces.observation_size:
        raise SwingupError(f"the policy sees {seen} numbers, the environment shows {spaces.observation_size}")
    size = len(choices) or len(network.head.bias)
    # Choices may be of evenly spaced numbers.
    if size != spaces.action_size or (spaces.choices and choices != spaces.choices):
        mine, its = _actions(size, choices), _actions(spaces.action_size, spaces.choices)
        raise SwingupError(f"the policy's actions are {mine}, the environment's are {its}")


def _actions(size: int, choices: tuple[int, ...]) -> str:
    return f"{size} choices of {', '.join(map(str, choices))}" if choices else f"{size} numbers"
