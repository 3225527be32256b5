"""The settings that define a training run, in the config.json of its folder."""

import dataclasses
import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..areapo.config import LARGEST_COUNT, Config, config_from_dict
from ..common import __version__
from ..common.arrays import write_json
from ..common.checks import one_of, whole_number
from ..common.errors import SwingupError, command_line, one_line, quoted
from ..loop.resolve import resolve
from ..plant.files import SHIPPED_PLANTS, is_plant_name, load_plant
from ..plant.plant import FRICTIONLESS_SUFFIX, LEADERBOARD, Plant, get_robot, make_plant
from ..tasks.adapters import AbstractAdaptedTask
from ..tasks.pendulum import AbstractPendulumTask
from ..tasks.presets import get_task
from .presets import PRESETS, choose_preset, get_preset, is_acrobot, is_robot

SETTINGS_FILE = "config.json"

PENDULUM_INTERVALS = {"evaluate_every": 65_536, "checkpoint_every": 1_048_576}
ENV_INTERVALS = {"evaluate_every": 65_536, "checkpoint_every": 262_144}
CONTINUING_INTERVALS = {"evaluate_every": 10_000, "checkpoint_every": 1_000_000}
ACROBOT_EVALUATIONS = {"evaluate_every": 1_048_576, "checkpoint_every": 4_194_304, "evaluation_episodes": 128}
"""Default frames between evaluations and between checkpoints, at which the host's environments are reset; of
dm_control's acrobot also episodes of an evaluation."""
CONTINUING = "swingup/Continuing"
"""Beginning of the ids of continuing tasks (:mod:`swingup.continuing`)."""

MALFORMED = (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError)
"""Errors that content of a wrong type, depth or encoding raises."""

LEAST = {"seed": 0, "seeds": 1, "evaluate_every": 1, "checkpoint_every": 1, "evaluation_episodes": 0}
"""Least values of the fields that are whole numbers."""
SETTINGS = ("preset", *LEAST, "plant")
"""Fields that a user gives beside the hyperparameters, to suggest for a misspelt one."""


@dataclass(frozen=True)
class RunSettings:
    """The settings that define a run, without its length; written to config.json."""

    robot: str | None
    """The pendulum's robot; None for another task."""
    preset: str
    seed: int
    """The first seed."""
    seeds: int
    """How many seeds train side by side."""
    evaluate_every: int
    """Frames of a seed between evaluations and reports; each checkpoint adds one of both."""
    checkpoint_every: int
    """Frames of a seed between checkpoints."""
    config: Config
    """The algorithm's hyperparameters."""
    env: str | None = None
    """Gymnasium id of another task than the pendulum's, or a description of an object that was passed in."""
    evaluation_episodes: int = 5
    """Episodes of an evaluation on another task; 0: training episodes give the score, where the host steps them."""
    plant: Plant = LEADERBOARD
    """The pendulum, in whose units the task is."""

    def __post_init__(self) -> None:
        """Refuse what cannot work."""
        if (self.robot is None) == (self.env is None):
            raise SwingupError(f"robot = {quoted(self.robot)} and env = {quoted(self.env)}: give one of the two")
        if not isinstance(self.name, str):
            raise SwingupError(f"{quoted(self.robot or self.env)} is not a robot or an environment")
        if self.robot is not None:
            get_robot(self.robot)
        one_of("preset", self.preset, PRESETS)
        if self.plant != LEADERBOARD and self.robot is None:
            raise SwingupError(f"a plant goes with a robot, not with {self.name}")
        for name, least in LEAST.items():
            object.__setattr__(self, name, whole_number(name, getattr(self, name), least))
        # Arrays are indexed in 32 bits; a machine's memory ends earlier, which JAX says.
        sizes = {"num_envs x num_steps x seeds": self.config.rollout_size * self.seeds}
        for name in ("policy_layers", "value_layers"):
            sizes |= {f"{name} = {x} x {y}": x * y for x, y in itertools.pairwise(getattr(self.config, name))}
        for name, size in sizes.items():
            whole_number(name, size, 0, LARGEST_COUNT)
        # JAX's keys take seeds of 32 bits; the last seed is seed + seeds - 1.
        whole_number("seed", self.seed, 0, 2**32 - self.seeds)

    @property
    def name(self) -> str:
        """The name of the robot or the environment."""
        return self.robot if self.env is None else self.env  # type: ignore[return-value]

    def next_stop(self, iterations: int, target: int) -> int:
        """The iteration that ends the next chunk: where a report or a checkpoint is due, at most ``target``."""
        intervals = (self._iterations(self.evaluate_every), self._iterations(self.checkpoint_every))
        return min(target, *((iterations // every + 1) * every for every in intervals))

    def is_checkpoint_due(self, before: int, iterations: int) -> bool:
        """Whether a checkpoint falls after iteration ``before`` and not after ``iterations``."""
        every = self._iterations(self.checkpoint_every)
        return iterations // every > before // every

    def _iterations(self, frames: int) -> int:
        return max(1, frames // self.config.rollout_size)

    def task(self) -> AbstractPendulumTask:
        """The pendulum's task that these settings train on."""
        if self.robot is None:
            raise SwingupError(f"{self.env} is not a pendulum task")
        return get_task(get_preset(self.preset).task, get_robot(self.robot), self.plant)

    def command(self, frames: int) -> str:
        """The command that makes such a run from scratch; in Python where environment or plant has no name."""
        passed_in = is_description(self.name)
        if passed_in or not _is_named(self.plant):
            return self._call(frames) + (f"  # env: {self.name}" if passed_in else "")
        options = {"env": self.env, "preset": self.preset, "frames": frames, "seed": self.seed}
        if self.plant != LEADERBOARD:
            name = self.plant.name.removesuffix(FRICTIONLESS_SUFFIX)
            options |= {"plant": name, "frictionless": True if name != self.plant.name else None}
        options |= {"seeds": None if self.seeds == 1 else self.seeds, **self._changed()}
        return command_line("train", *([self.robot] if self.robot else []), **options)

    def _call(self, frames: int) -> str:
        words = ["env" if is_description(self.name) else repr(self.name)]
        words += [f"preset={self.preset!r}", f"seed={self.seed}"]
        numbers = ", ".join(f"{name}={value!r}" for name, value in self.plant.values().items())
        words += [] if self.plant == LEADERBOARD else [f"plant=Plant({numbers})"]
        words += [f"{name}={value!r}" for name, value in self._changed().items()]
        return f"swingup.AREAPO({', '.join(words)}).learn({frames})"

    def _changed(self) -> dict[str, Any]:
        """Hyperparameters that differ from the preset's, then intervals and episodes that are not the defaults."""
        usual = default_evaluations(self.name)
        defaults = vars(get_preset(self.preset).config) | usual
        mine = {name: (vars(self.config) | vars(self))[name] for name in defaults}
        return {name: value for name, value in mine.items() if value != defaults[name]}

    def as_dict(self) -> dict[str, Any]:
        """As JSON values."""
        values = dataclasses.asdict(self)
        if self.robot is None:
            del values["plant"]  # another task has no pendulum
        # Through JSON, so that tuples become lists and it equals what is read from a file.
        return json.loads(json.dumps(values))


def _is_named(plant: Plant) -> bool:
    """Whether the command line can name a plant: changed numbers may have kept a shipped plant's name."""
    name = plant.name.removesuffix(FRICTIONLESS_SUFFIX)
    if name not in SHIPPED_PLANTS:
        return is_plant_name(name)
    shipped = load_plant(name)
    return plant == (shipped if name == plant.name else shipped.frictionless())


def make_run_settings(
    env: Any, preset: str | None = None, changes: Mapping[str, Any] | None = None, **given: Any
) -> RunSettings:
    """The settings of a run, with the defaults of its preset and its task for what is None or left out."""
    robot = env if is_robot(env) else None
    chosen = choose_preset(preset, env)
    defaults = get_preset(chosen)
    # From names, so that misspelt ones are found.
    config = config_from_dict(vars(defaults.config) | dict(changes or {}), ("env", "folder", *SETTINGS))
    values: dict[str, Any] = {"seed": 0, "seeds": defaults.seeds, **default_evaluations(env)}
    values |= {name: value for name, value in given.items() if value is not None}
    values["plant"] = resolve(values.get("plant", LEADERBOARD)).facts
    return RunSettings(
        robot=robot, env=None if robot else describe_env(env), preset=chosen, config=config, **values
    )


def run_settings_from_dict(content: Any) -> RunSettings:
    """The inverse of ``as_dict``; settings that an older version did not have get their defaults."""
    try:
        given, config = content.get("plant"), config_from_dict(content["config"])
        plant = LEADERBOARD if given is None else make_plant(given, "its plant", str(given["name"]))
        return RunSettings(**{**content, "plant": plant, "config": config})
    except MALFORMED as error:
        raise SwingupError(f"the settings are malformed ({type(error).__name__}: {one_line(error, 80)})") from error


def write_run_settings(folder: Path, settings: RunSettings, frames: int) -> None:
    """Write the settings and the number of frames of a run to its config.json."""
    write_json(folder / SETTINGS_FILE, {"version": __version__, "frames": frames, **settings.as_dict()})


def read_run_settings(folder: Path) -> tuple[RunSettings, int]:
    """Read a run's settings and its number of frames from its config.json."""
    path = folder / SETTINGS_FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        # For human readers only; a file without it is not one of ours.
        del content["version"]
        frames = whole_number("frames", content.pop("frames"), 1)
        return run_settings_from_dict(content), frames
    except OSError as error:
        raise SwingupError(f"{folder} is not a run's folder: cannot read {path} ({error.strerror})") from error
    except (*MALFORMED, SwingupError) as error:
        reason = one_line(error, 200)
        raise SwingupError(f"{path} is malformed ({reason}): restore it or train again") from error


def default_evaluations(env: Any) -> dict[str, int]:
    """Frames between evaluations and between checkpoints, and episodes of an evaluation, of a robot or a task."""
    if is_continuing(env):
        # A stream of 2,000 steps for every 10,000.
        return {**CONTINUING_INTERVALS, "evaluation_episodes": 1}
    if is_acrobot(env):
        return ACROBOT_EVALUATIONS
    intervals = PENDULUM_INTERVALS if is_robot(env) else ENV_INTERVALS
    return {**intervals, "evaluation_episodes": RunSettings.evaluation_episodes}


def is_continuing(env: Any) -> bool:
    """Whether an environment is the id of a continuing task."""
    return isinstance(env, str) and env.startswith(CONTINUING)


def describe_env(env: Any) -> str:
    """A name for an environment: its id, or its type or function in angle brackets."""
    if isinstance(env, str):
        return env
    if isinstance(env, list | tuple) and env:
        env = env[0]
    if isinstance(env, AbstractAdaptedTask):
        env = env.named_after
    named = env if hasattr(env, "__qualname__") else type(env)
    return f"<{named.__module__}.{named.__qualname__}>"


def is_description(name: str) -> bool:
    """Whether a name only describes an environment, which cannot be made from it."""
    return name.startswith("<")
