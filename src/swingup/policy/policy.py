"""A policy of any task by NumPy alone: from an observation to an action of the environment."""

import abc
import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..common.checks import positive_number
from ..common.errors import SwingupError, naming, quoted
from .file import read_metadata, read_network
from .network import LOG_STD_RANGE, STD_OUTPUT_RANGE, TANH, Activation, Bounds, MagnifyStage, Network
from .spaces import Space, read_space

TASK, OBSERVATION_SPACE, ACTION_SPACE, PERIOD = "task", "observation_space", "action_space", "period"
"""Keys of a task's policy file."""

ACTIVATIONS: dict[Activation, Callable[[np.ndarray], np.ndarray]] = {
    "relu": lambda x: np.maximum(x, 0.0, out=x),
    "tanh": np.tanh,
    # Clipped, since both branches are computed: the exponential of a large x overflows.
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))),
    # The logistic function by tanh, which never overflows.
    "silu": lambda x: 0.5 * x * (1.0 + np.tanh(0.5 * x)),
    "gelu": lambda x: 0.5 * x * (1.0 + np.tanh(math.sqrt(2.0 / math.pi) * (x + 0.044715 * x**3))),
}
BOUNDS: dict[Bounds, Callable[[np.ndarray], np.ndarray]] = {"tanh": np.tanh, "clip": lambda z: z.clip(-1.0, 1.0)}


class NumpyNetwork:
    """The stages, the hidden layers and the head in double precision.

    A call with one observation works in buffers of its own: use one object in one thread.
    """

    def __init__(self, network: Network) -> None:
        """Take the arrays of a network without the stage ``plant``."""
        self._stages: list[Any] = list(network.stages)
        self._activate = ACTIVATIONS[network.activation]
        # Transposed views, so that one observation and rows of several take the same product.
        self.layers = [
            (layer.weight.astype(np.float64).T, layer.bias.astype(np.float64), np.empty(layer.bias.shape))
            for layer in network.layers
        ]

    def features(self, observation: np.ndarray) -> np.ndarray:
        """The outputs (..., width) of the last hidden layer for one observation (n,), or for rows (b, n)."""
        features = observation
        for stage in self._stages:
            features = stage(features)
        single = features.ndim == 1
        for weight, bias, buffer in self.layers[:-1]:
            result = np.dot(features, weight, out=buffer if single else None)
            np.add(result, bias, out=result)
            features = self._activate(result)
        return features

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """The head's outputs (..., m): means before their bounds, or logits."""
        weight, bias, _ = self.layers[-1]
        return np.dot(self.features(observation), weight) + bias


class Policy(abc.ABC):
    """A policy with its spaces: a :class:`TaskPolicy`, or for a robot a :class:`.PendulumPolicy`."""

    network: Network
    """The network of the file."""
    metadata: Mapping[str, Any]
    """All entries of the file: preset, command, scores and others."""

    @property
    @abc.abstractmethod
    def task(self) -> str:
        """The id or the description of the environment, or the robot."""

    @property
    @abc.abstractmethod
    def observation_space(self) -> Space:
        """What ``predict`` takes."""

    @property
    @abc.abstractmethod
    def action_space(self) -> Space:
        """What ``predict`` returns."""

    @property
    @abc.abstractmethod
    def period(self) -> float | None:
        """Time between two actions (s); None where the task has none, or any will do."""

    @property
    @abc.abstractmethod
    def folded(self) -> Network:
        """The network that back ends run: of the observation alone."""

    def predict(
        self, observation: Any, state: None = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, None]:
        """Actions of the environment for an observation, or for several along a leading axis.

        Args:
            observation: finite numbers in the shape of the observation space, or with one axis more in front.
            state: None: a policy has no memory.
            episode_start: ignored, as a policy has no memory.
            deterministic: the policy's mode. Otherwise a sample of the Gaussian, which the bounds follow, or of the
                choices' probabilities, from a generator that :meth:`seed` sets.

        Returns:
            The actions, and None for the state, as Stable-Baselines3's ``predict`` does.

        Raises:
            SwingupError: the observation has another shape or is not finite, a state is given, or a sample is asked
                of a file without a standard deviation.
        """
        if state is not None:
            raise SwingupError(f"state = {quoted(state)}, but a policy has no memory: leave it out")
        rows, single = self.observation_space.batch(observation)
        features = self._numpy.features(rows.astype(np.float64))
        weight, bias, _ = self._numpy.layers[-1]
        actions = self.action_space(self._actions(features, features @ weight + bias, deterministic))
        return (actions[0] if single else actions), None

    def seed(self, seed: int | np.random.Generator | None = None) -> None:
        """Set the generator of the samples that follow; None for one that the system seeds."""
        # The dataclasses are frozen for what defines a policy, which the generator does not.
        self.__dict__["_generator"] = np.random.default_rng(seed)

    @functools.cached_property
    def _generator(self) -> np.random.Generator:
        return np.random.default_rng()

    @functools.cached_property
    def _numpy(self) -> NumpyNetwork:
        return NumpyNetwork(self.folded)

    def _actions(self, features: np.ndarray, outputs: np.ndarray, deterministic: bool) -> np.ndarray:
        """The policy's actions (b, m): in [-1, 1], or choices from 0."""
        network = self.folded
        if network.choices is not None:
            if not deterministic:
                # The largest sum with Gumbel noise is a sample of the probabilities.
                outputs = outputs + self._generator.gumbel(size=outputs.shape)
            ends = np.cumsum(network.choices)[:-1]
            chosen = np.stack([each.argmax(axis=-1) for each in np.split(outputs, ends, axis=-1)], axis=-1)
            return chosen if self.action_space.choices else spaced(chosen, network.choices)
        if not deterministic:
            outputs = outputs + _deviation(network, features) * self._generator.normal(size=outputs.shape)
        return BOUNDS[network.bounds](outputs)


def spaced(chosen: Any, choices: tuple[int, ...]) -> Any:
    """Numbers from -1 to 1 for choices (..., m) of evenly spaced ones, in which a box is acted in."""
    return 2.0 * chosen / (np.array(choices, np.float32) - 1.0) - 1.0


def require_plain(policy: Policy, program: str) -> None:
    """Refuse what a program, whose name starts the sentence, does not run."""
    spaces_choices = policy.network.choices is not None and not policy.action_space.choices
    if spaces_choices or any(isinstance(stage, MagnifyStage) for stage in policy.network.stages):
        raise SwingupError(
            f"{program} has no observation stage 'magnify' and no choices in a box: export the policy to NumPy"
        )


def _deviation(network: Network, features: np.ndarray) -> np.ndarray:
    """Standard deviations of the means before their bounds: softplus(w·h + b), or with clip exp(b)."""
    std = network.std
    if std is None:
        raise SwingupError("this policy has no standard deviation: ask for its deterministic action")
    bias = std.bias.astype(np.float64)
    if network.bounds == TANH:
        outputs = features @ std.weight.astype(np.float64).T + bias
        return np.log1p(np.exp(outputs.clip(*STD_OUTPUT_RANGE)))
    return np.exp(bias.clip(*LOG_STD_RANGE))


@dataclass(frozen=True)
class TaskPolicy(Policy):
    """A policy of an environment; the file's metadata describe its spaces."""

    network: Network
    metadata: Mapping[str, Any]

    def __post_init__(self) -> None:
        """Compare the network with the spaces."""
        seen, space = self.network.input_size, self.action_space
        if self.observation_space.choices or seen != self.observation_space.size:
            raise SwingupError(f"its network sees {seen} numbers, its observations are {self.observation_space}")
        choices = self.network.choices or ()
        outputs = len(choices or self.network.head.bias)
        # Choices in a box are of evenly spaced numbers between its bounds.
        fits = space.choices == choices or (not space.choices and min(choices) > 1)
        if not fits or outputs != space.size:
            counts = f"{outputs} actions, {choices or 'continuous'}"
            raise SwingupError(
                f"its network has {counts}, its action_space {space.size}, {space.choices or 'a box'}"
            )
        if not space.choices and space.low is None:
            raise SwingupError("its action_space has no bounds")
        if self.metadata.get(PERIOD) is not None:
            positive_number(PERIOD, self.metadata[PERIOD])

    @functools.cached_property
    def task(self) -> str:
        """The id or the description of the environment."""
        return str(self.metadata.get(TASK, "a task without a name"))

    @functools.cached_property
    def observation_space(self) -> Space:
        """What ``predict`` takes."""
        return read_space(OBSERVATION_SPACE, self.metadata.get(OBSERVATION_SPACE))

    @functools.cached_property
    def action_space(self) -> Space:
        """What ``predict`` returns."""
        return read_space(ACTION_SPACE, self.metadata.get(ACTION_SPACE))

    @property
    def period(self) -> float | None:
        """Time of a step (s); None where the environment has none."""
        return self.metadata.get(PERIOD)

    @property
    def folded(self) -> Network:
        """The network itself."""
        return self.network


def task_metadata(task: str, observations: Space, actions: Space, period: float | None) -> dict[str, Any]:
    """What a task's policy file says of the task, as JSON values."""
    found = {TASK: task, OBSERVATION_SPACE: observations.describe(), ACTION_SPACE: actions.describe()}
    return found if period is None else {**found, PERIOD: period}


def is_of_task(path: str | Path) -> bool:
    """Whether a policy file is of a task with spaces of its own, and so not of a pendulum."""
    return ACTION_SPACE in read_metadata(path)


def read_task_policy(path: str | Path) -> TaskPolicy:
    """Read a policy file of a task."""
    network, metadata = read_network(path)
    with naming(f"policy file {path}", "; see docs/policy-format.md"):
        return TaskPolicy(network, metadata)
