"""The problem that a run solves, as an object: a robot, a task in JAX, or environments that the host steps.

:func:`make_problem` and :func:`problem_from_record` alone know the kinds. A problem knows its default preset and
intervals, its record in a run's files and its name on the command line, and makes the back end.
"""

import abc
import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..areapo.config import Config
from ..common.checks import one_of
from ..common.errors import SwingupError, one_line, quoted
from ..controllers.stack.policy import Policy
from ..loop.resolve import resolve
from ..plant.files import SHIPPED_PLANTS, is_plant_name, load_plant
from ..plant.plant import FRICTIONLESS_SUFFIX, LEADERBOARD, ROBOTS, Plant, PlantLike, get_robot, make_plant
from ..tasks.acrobot_swingup import IDS as ACROBOT_IDS
from ..tasks.acrobot_swingup import AcrobotSwingup, acrobot_practice
from ..tasks.adapters import AbstractAdaptedTask, as_task
from ..tasks.pendulum import AbstractPendulumTask
from ..tasks.presets import get_task
from ..tasks.task import AbstractTask, check_task
from .backend import EPISODES, AbstractBackend, check_actions, check_spaces
from .compiled_backend import CompiledBackend, ReturnEvaluator, SwingUpEvaluator
from .metrics import Evaluation
from .presets import (
    ACROBOT_PRESET,
    CONTINUING_PRESET,
    DM_ACROBOT,
    ENV_PRESET,
    ENVIRONMENT,
    PENDULUM,
    PENDULUM_PRESET,
    PRESETS,
    get_preset,
)

CONTINUING = "swingup/Continuing"  # Beginning of the ids of continuing tasks (:mod:`swingup.continuing`)


@dataclass(frozen=True)
class Intervals:
    """How often a run is evaluated and saved, and how many episodes an evaluation has."""

    evaluate_every: int = 65_536  # Frames of a seed between evaluations
    checkpoint_every: int = 262_144
    """Frames of a seed between checkpoints, at which the environments that the host steps are reset."""
    evaluation_episodes: int = 5


INTERVALS = {
    "environment": Intervals(),
    "robot": Intervals(checkpoint_every=1_048_576, evaluation_episodes=1),
    # A stream of 2,000 steps for every 10,000.
    "continuing task": Intervals(10_000, 1_000_000, 1),
    # Its checkpoints do not touch it, and its steps cannot be had again.
    "stream": Intervals(10_000, 20_000, 0),
    DM_ACROBOT: Intervals(1_048_576, 4_194_304, 128),
}
"""The default intervals by what is trained on."""


class AbstractProblem(abc.ABC):
    """A problem with its defaults, its names, its back end and its evaluation."""

    name: str  # The robot, the id of an environment, or a description of an object that was passed in
    stream: bool = False  # Whether an environment is reset once in its life

    @property
    @abc.abstractmethod
    def kind(self) -> str:
        """The kind of task, for which a preset may be alone."""

    @property
    @abc.abstractmethod
    def preset(self) -> str | None:
        """The default preset; None: it must be named."""

    @property
    @abc.abstractmethod
    def intervals(self) -> Intervals:
        """The default intervals."""

    @property
    @abc.abstractmethod
    def continuing(self) -> bool:
        """Whether it is one endless stream, whose measure is the reward rate."""

    @property
    @abc.abstractmethod
    def record(self) -> dict[str, Any]:
        """The problem's entries of config.json: the robot and its plant, or the environment."""

    @property
    @abc.abstractmethod
    def command(self) -> Mapping[str, Any] | None:
        """The options that name it on the command line, a robot's word as ``robot``; None where only Python can."""

    @property
    @abc.abstractmethod
    def arguments(self) -> str:
        """The arguments that name it in a call of ``swingup.AREAPO``."""

    @property
    def own_number(self) -> int | None:
        """The number of environments that were passed in; None where any number is made."""
        return None

    def sizes(self, config: Config) -> dict[str, int]:
        """The rollout's sizes that are not those of the preset."""
        return {}

    @abc.abstractmethod
    def on(self, env: Any) -> "AbstractProblem":
        """The same problem on an environment that is passed in again; None: on the one that it names."""

    @abc.abstractmethod
    def check_episodes(self, episodes: int) -> None:
        """Refuse a number of episodes that an evaluation cannot have."""

    @abc.abstractmethod
    def backend(self, preset: str, config: Config, seeds: Sequence[int], episodes: int) -> AbstractBackend:
        """The back end that trains on it, with its evaluator."""

    @abc.abstractmethod
    def evaluate(self, policy: Policy[Any], seed: int, episodes: int | None, trained: Any) -> Evaluation:
        """Evaluate a policy that was trained elsewhere, with actions that ``trained`` describes.

        Without a number of episodes it is one in each environment that was passed in, or else ``EPISODES``.
        """

    def choose_preset(self, named: str | None) -> str:
        """The named preset, or else the default; no other code decides this."""
        chosen = self.preset if named is None else named
        fitting = ", ".join(name for name, preset in PRESETS.items() if preset.only in (None, self.kind))
        if chosen is None:
            raise SwingupError(f"no preset was named for {self.name}: pass preset=, one of {fitting}")
        if (only := get_preset(chosen).only) not in (None, self.kind):
            raise SwingupError(f"preset {chosen!r} is for {only}, not for {self.name}: use one of {fitting}")
        return chosen


@dataclass(frozen=True)
class RobotProblem(AbstractProblem):
    """A robot's pendulum, judged by the benchmark's swing-up on its plant."""

    name: str
    plant: Plant = LEADERBOARD  # The pendulum, in whose units the task is
    task: AbstractPendulumTask | None = field(default=None, compare=False, repr=False)
    """A task in place of the preset's."""

    kind, preset = PENDULUM, PENDULUM_PRESET
    intervals = INTERVALS["robot"]
    continuing = False

    def __post_init__(self) -> None:
        get_robot(self.name)

    @property
    def record(self) -> dict[str, Any]:
        """The robot and its plant."""
        return {"robot": self.name, "env": None, "plant": self.plant}

    @property
    def command(self) -> Mapping[str, Any] | None:
        """The robot and its plant; None for a plant without a name."""
        if self.plant == LEADERBOARD:
            return {"robot": self.name}
        name = self.plant.name.removesuffix(FRICTIONLESS_SUFFIX)
        # Changed numbers may have kept a shipped plant's name.
        if name in SHIPPED_PLANTS:
            shipped = load_plant(name)
            named = self.plant == (shipped if name == self.plant.name else shipped.frictionless())
        else:
            named = is_plant_name(name)
        frictionless = name != self.plant.name or None
        return {"robot": self.name, "plant": name, "frictionless": frictionless} if named else None

    @property
    def arguments(self) -> str:
        """The robot, and its plant's numbers if it is not the leaderboards'."""
        numbers = ", ".join(f"{name}={value!r}" for name, value in self.plant.values().items())
        return repr(self.name) if self.plant == LEADERBOARD else f"{self.name!r}, plant=Plant({numbers})"

    def on(self, env: Any) -> "RobotProblem":
        """The robot on a task that is passed in, or else on the preset's."""
        if not (env is None or env == self.name or isinstance(env, AbstractPendulumTask)):
            raise SwingupError(
                f"env = {one_line(env, 80)}, but this is a run of the robot {self.name}: leave env out"
            )
        return dataclasses.replace(self, task=env if isinstance(env, AbstractPendulumTask) else None)

    def check_episodes(self, episodes: int) -> None:
        """Refuse any number but one: the score of a robot is that of one episode."""
        if episodes != 1:
            raise SwingupError(
                f"evaluation_episodes = {episodes}, but a robot is scored by one episode: leave it out"
            )

    def preset_task(self, preset: str) -> AbstractPendulumTask:
        """The variant of the task that a preset trains on."""
        return get_task(get_preset(preset).task, get_robot(self.name), self.plant)

    def backend(self, preset: str, config: Config, seeds: Sequence[int], episodes: int) -> AbstractBackend:
        """The compiled back end with the benchmark's swing-up as its evaluator."""
        task = self.task or self.preset_task(preset)
        return CompiledBackend(task, config, seeds, SwingUpEvaluator(task, self.plant))

    def evaluate(self, policy: Policy[Any], seed: int, episodes: int | None, trained: Any) -> Evaluation:
        """Refuse every policy: those trained elsewhere have other observations."""
        raise SwingupError(f"env = {self.name!r}: a robot judges its own policies, without env")


class AbstractEnvironmentProblem(AbstractProblem):
    """A problem with the id or the description of an environment as its name."""

    @property
    def record(self) -> dict[str, Any]:
        """The id or the description, and that it is a stream."""
        return {"robot": None, "env": self.name, **self._resets}

    @property
    def _resets(self) -> dict[str, Any]:
        return {"resets": "never"} if self.stream else {}

    def on(self, env: Any) -> AbstractProblem:
        """The problem of an environment that is passed in, under the same name."""
        return self if env is None else _passed_in(self.name, env, self.stream)


@dataclass(frozen=True)
class TaskProblem(AbstractEnvironmentProblem):
    """A task in JAX, scored by the mean return of its episodes."""

    name: str
    task: AbstractTask[Any] = field(compare=False, repr=False)
    judged: AbstractTask[Any] | None = field(default=None, compare=False, repr=False)
    """The task that scores policies, if it is another."""

    intervals = INTERVALS["environment"]
    continuing = False
    command = None
    arguments = "env"

    @property
    def kind(self) -> str:
        """By the class of the task."""
        if isinstance(self.task, AcrobotSwingup):
            return DM_ACROBOT
        return PENDULUM if isinstance(self.task, AbstractPendulumTask) else ENVIRONMENT

    @property
    def preset(self) -> str | None:
        """The preset of environments; a pendulum's task has none, since its numbers suit several presets."""
        return None if isinstance(self.task, AbstractPendulumTask) else ENV_PRESET

    def check_episodes(self, episodes: int) -> None:
        """Refuse an evaluation without episodes."""
        if not episodes:
            raise SwingupError("evaluation_episodes = 0, but a task in JAX is scored by episodes: use 1 or more")

    def backend(self, preset: str, config: Config, seeds: Sequence[int], episodes: int) -> AbstractBackend:
        """The compiled back end with the mean return as its score."""
        self.check_episodes(episodes)
        evaluator = ReturnEvaluator(self.judged or self.task, seeds[0], episodes, self.name)
        return CompiledBackend(self.task, config, seeds, evaluator)

    def evaluate(self, policy: Policy[Any], seed: int, episodes: int | None, trained: Any) -> Evaluation:
        """Play episodes of the task under a policy with its spaces."""
        check_spaces(policy, self.task.spaces)
        evaluator = ReturnEvaluator(self.task, seed, episodes or EPISODES, self.name)
        check_actions(trained, evaluator.action_space)
        return evaluator.evaluate(policy)


@dataclass(frozen=True)
class HostProblem(AbstractEnvironmentProblem):
    """An environment that the host steps: a Gymnasium id, an environment, or what makes environments."""

    name: str
    env: Any = field(compare=False, repr=False)
    """The environment that the name describes; None where it is not known."""
    stream: bool = False

    @property
    def continuing(self) -> bool:
        """Whether it is a stream, one of the continuing tasks, or an object that counts resets as they do."""
        if self.stream or id_of(self.name).startswith(CONTINUING):
            return True
        if self.env is None or isinstance(self.env, str):
            return False
        from .environments import counts_resets

        return counts_resets(self.env)

    @property
    def kind(self) -> str:
        """By the id."""
        return DM_ACROBOT if id_of(self.name) in ACROBOT_IDS else ENVIRONMENT

    @property
    def preset(self) -> str | None:
        """The preset of streams and continuing tasks, of dm_control's acrobot, or of tasks with episodes."""
        if self.kind == DM_ACROBOT and not self.stream:
            return ACROBOT_PRESET
        return CONTINUING_PRESET if self.continuing else ENV_PRESET

    @property
    def intervals(self) -> Intervals:
        """The intervals of streams, continuing tasks, dm_control's acrobot or environments."""
        if self.stream:
            return INTERVALS["stream"]
        if self.continuing:
            return INTERVALS["continuing task"]
        return INTERVALS[DM_ACROBOT if self.kind == DM_ACROBOT else "environment"]

    @property
    def command(self) -> Mapping[str, Any] | None:
        """The id; None for an environment that was passed in."""
        return None if self.name.startswith("<") else {"env": self.name, **self._resets}

    @property
    def arguments(self) -> str:
        """The id, or the name ``env`` of the variable with the environment."""
        env = "env" if self.command is None else repr(self.name)
        return ", ".join([env, *(f"{name}={value!r}" for name, value in self._resets.items())])

    def sizes(self, config: Config) -> dict[str, int]:
        """The number of environments that were passed in; of a stream one, which fills the preset's rollout."""
        number = self.own_number
        if self.stream:
            number = number or 1
            return {"num_envs": number, "num_steps": filling(config.rollout_size, number, config.batch_size)}
        return {} if number is None else {"num_envs": number}

    @property
    def own_number(self) -> int | None:
        """That of a list, a vector environment or one environment."""
        if self.env is None or isinstance(self.env, str):
            return None
        # Imported here: Gymnasium is slow to load, and neither robots nor ids need it yet.
        from .environments import own_number

        return own_number(self.env, self.stream)

    def check_episodes(self, episodes: int) -> None:
        """Refuse to evaluate on a stream. Otherwise, with 0, the training episodes give the score."""
        if self.stream and episodes:
            raise SwingupError(
                f"evaluation_episodes = {episodes}, but a stream is scored by its reward rate while training: "
                "leave it out"
            )

    def backend(self, preset: str, config: Config, seeds: Sequence[int], episodes: int) -> AbstractBackend:
        """The host's back end; dm_control's acrobot has a task in JAX for its own preset."""
        if self.env is None:
            raise SwingupError(f"this run's environment was passed in ({self.name}): pass it again as env")
        named = id_of(self.env) if isinstance(self.env, str) else None
        if not self.stream and preset == ACROBOT_PRESET and named in ACROBOT_IDS:
            practice = _passed_in(self.name, acrobot_practice(ACROBOT_IDS[named]))
            return practice.backend(preset, config, seeds, episodes)
        from .host_backend import HostBackend

        return HostBackend(self.env, self.name, config, seeds, episodes, self.stream)

    def evaluate(self, policy: Policy[Any], seed: int, episodes: int | None, trained: Any) -> Evaluation:
        """Play episodes in new environments, or in the one that was passed in."""
        from .host_backend import play_once

        return play_once(policy, self.env, episodes, seed, trained)


def id_of(name: str) -> str:
    """The id without the module that registers it, of ``module:id``."""
    return name.rpartition(":")[2]


def make_problem(env: Any, plant: PlantLike | None = None, resets: str | None = None) -> AbstractProblem:
    """The problem of anything that ``swingup.AREAPO`` takes as ``env``; a robot may have another plant.

    Raises:
        SwingupError: the environment cannot be adapted, a plant is given without a robot, or what is compiled is
            never to be reset.
    """
    if resets is not None:
        one_of("resets", resets, ("never",))
    if isinstance(env, str) and env in ROBOTS and resets is None:
        return RobotProblem(env, LEADERBOARD if plant is None else resolve(plant).facts)
    if plant is not None:
        raise SwingupError(f"a plant goes with a robot, not with {one_line(env, 80)}")
    return _passed_in(None, env, resets is not None)


def problem_from_record(content: Mapping[str, Any]) -> AbstractProblem:
    """The problem of a ``record``, which does not hold an environment that was passed in."""
    robot, env, facts = content["robot"], content["env"], content.get("plant")
    if (robot is None) == (env is None):
        raise SwingupError(f"robot = {quoted(robot)} and env = {quoted(env)}: one of the two is trained on")
    if not isinstance(name := env if robot is None else robot, str):
        raise SwingupError(f"{quoted(name)} is not a robot or an environment")
    if robot is not None:
        plant = LEADERBOARD if facts is None else make_plant(facts, "its plant", str(facts["name"]))
        return RobotProblem(robot, plant)
    if facts is not None:
        raise SwingupError(f"a plant goes with a robot, not with {one_line(env, 80)}")
    return HostProblem(env, None if env.startswith("<") else env, content.get("resets") == "never")


def _passed_in(name: str | None, env: Any, stream: bool = False) -> AbstractProblem:
    """The problem of an environment that was passed in, by its own name or a given one."""
    adapted = as_task(env)
    name = _describe(adapted) if name is None else name
    if stream and (isinstance(adapted, AbstractTask) or name in ROBOTS):
        raise SwingupError(
            f"resets = 'never' is for Gymnasium's environments: {name} is compiled, and checkpoints hold its state"
        )
    if isinstance(adapted, AbstractTask):
        if not isinstance(adapted, AbstractAdaptedTask):
            check_task(adapted)
        # What dm_control's acrobot is learnt on is judged on the task itself.
        return TaskProblem(name, adapted, getattr(adapted, "judged", None))
    return HostProblem(name, adapted, stream)


def filling(frames: int, number: int, batch_size: int) -> int:
    """Steps of so many environments that fill a rollout of about these frames, which minibatches divide."""
    multiple = batch_size // math.gcd(batch_size, number)
    return max(multiple, frames // number // multiple * multiple)


def _describe(env: Any) -> str:
    """A name for an environment: its id, or its type or function in angle brackets."""
    if isinstance(env, str):
        return env
    if isinstance(env, list | tuple) and env:
        env = env[0]
    if isinstance(env, AbstractAdaptedTask):
        env = env.named_after
    if not isinstance(env, type):  # of a class it is a property
        env = getattr(env, "unwrapped", env)  # a wrapper is not what is trained on
    named = env if hasattr(env, "__qualname__") else type(env)
    return f"<{named.__module__}.{named.__qualname__}>"
