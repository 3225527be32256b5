"""What defines a training run, as it stands in the config.json of its folder."""

import dataclasses
import json
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..areapo.config import Config, config_from_dict
from ..errors import SwingupError
from ..files import write_atomically
from ..physics.parameters import get_robot
from ..tasks.domain import Domain
from ..tasks.pendulum import AbstractPendulumTask
from ..tasks.presets import SIM2REAL_TASKS, get_task
from ..version import __version__
from .presets import get_preset

FILE = "config.json"

PENDULUM_INTERVALS = {"evaluate_every": 65_536, "checkpoint_every": 1_048_576}
ENV_INTERVALS = {"evaluate_every": 65_536, "checkpoint_every": 262_144}
"""Frames between evaluations and between checkpoints unless others are asked for."""

LEAST = {"seed": 0, "seeds": 1, "evaluate_every": 1, "checkpoint_every": 1, "evaluation_episodes": 0}
"""Least value of each setting that is a whole number."""


@dataclass(frozen=True)
class Settings:
    """What defines a run, but for its length; written to config.json."""

    robot: str | None
    """The pendulum's robot; None for another task."""
    preset: str
    seed: int
    """The first seed."""
    seeds: int
    """How many seeds train side by side."""
    evaluate_every: int
    """Frames of a seed between evaluations and reports, of which checkpoints add theirs."""
    checkpoint_every: int
    """Frames of a seed between checkpoints."""
    config: Config
    """The algorithm's hyperparameters."""
    env: str | None = None
    """Gymnasium id of another task than the pendulum's, or what an object that was passed in is called."""
    evaluation_episodes: int = 5
    """Episodes of an evaluation on another task; 0 for none, where the host steps the environments."""
    domain: Domain | None = None
    """What plants for the real robot are drawn from; None for the preset's."""

    def __post_init__(self) -> None:
        """Refuse what cannot work."""
        if (self.robot is None) == (self.env is None):
            raise SwingupError(f"robot = {self.robot} and env = {self.env}: give one of the two")
        if self.robot is not None:
            get_robot(self.robot)
        preset = get_preset(self.preset)
        if self.domain is not None and (preset.task not in SIM2REAL_TASKS or self.robot is None):
            raise SwingupError(f"a domain goes with the preset sim2real, not with {self.preset}")
        for name, least in LEAST.items():
            object.__setattr__(self, name, whole(name, getattr(self, name), least))
        object.__setattr__(self, "config", config_from_dict(vars(self.config)))  # NumPy's numbers become Python's
        if not 0 <= self.seed <= 2**32 - self.seeds:
            raise SwingupError(f"seed = {self.seed} must lie between 0 and 2^32 - {self.seeds}")

    @property
    def chunk(self) -> int:
        """Iterations between reports; there is one at each checkpoint as well."""
        return max(1, self.evaluate_every // self.config.rollout_size)

    @property
    def checkpoint_interval(self) -> int:
        """Iterations between checkpoints."""
        return max(1, self.checkpoint_every // self.config.rollout_size)

    @property
    def name(self) -> str:
        """What is trained on: the robot or the environment."""
        return str(self.robot or self.env)

    def task(self) -> AbstractPendulumTask[Any]:
        """The pendulum's task that these settings train on."""
        if self.robot is None:
            raise SwingupError(f"{self.env} is no task of the pendulum")
        robot, name = get_robot(self.robot), get_preset(self.preset).task
        return get_task(name, robot) if self.domain is None else SIM2REAL_TASKS[name](robot, self.domain)

    def command(self, frames: int) -> str:
        """The command that makes such a run from scratch; in Python where the environment was passed in."""
        if is_label(self.name):
            words = ["env", f"preset={self.preset!r}", f"seed={self.seed}"]
            words += [f"{name}={value!r}" for name, value in self._unusual().items()]
            return f"swingup.AREAPO({', '.join(words)}).learn({frames})  # env: {self.name}"
        task = self.robot if self.env is None else f"--env {shlex.quote(self.env)}"
        words = [f"swingup train {task} --preset {self.preset} --frames {frames} --seed {self.seed}"]
        words += [] if self.domain is None else [f"--domain {shlex.quote(self.domain.name)}"]
        words += [] if self.seeds == 1 else [f"--seeds {self.seeds}"]
        return " ".join(words + [_option(name, value) for name, value in self._unusual().items()])

    def _unusual(self) -> dict[str, Any]:
        """Hyperparameters that are not the preset's, then intervals and episodes that are not the usual ones."""
        usual = vars(get_preset(self.preset).config) | default_intervals(self.robot)
        usual |= {"evaluation_episodes": Settings.evaluation_episodes}
        mine = {name: (vars(self.config) | vars(self))[name] for name in usual}
        return {name: value for name, value in mine.items() if value != usual[name]}

    def as_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return json.loads(json.dumps(dataclasses.asdict(self)))


def settings_from_dict(content: dict[str, Any]) -> Settings:
    """The inverse of ``as_dict``; what an older version did not know has its default."""
    domain = content.get("domain")
    if domain is not None:
        domain = Domain(
            tuple((str(n), float(low), float(high)) for n, low, high in domain["ranges"]), domain["name"]
        )
    return Settings(**{**content, "domain": domain, "config": config_from_dict(content["config"])})


def write_settings(folder: Path, settings: Settings, frames: int) -> None:
    """Write the settings and the number of frames of a run to its config.json.

    Raises:
        SwingupError: the file cannot be written.
    """
    content = {"version": __version__, "frames": frames, **settings.as_dict()}
    write_atomically(folder / FILE, (json.dumps(content, indent=2) + "\n").encode())


def read_settings(folder: Path) -> tuple[Settings, int]:
    """Read a run's settings and its number of frames from its config.json.

    Raises:
        SwingupError: the file is missing or malformed.
    """
    path = folder / FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        del content["version"]
        frames = int(content.pop("frames"))
        return settings_from_dict(content), frames
    except OSError as error:
        raise SwingupError(f"{folder} is not a run's folder: cannot read {path} ({error.strerror})") from error
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise SwingupError(f"{path} is malformed ({error}): restore it or train again") from error


def default_intervals(robot: str | None) -> dict[str, int]:
    """Frames between evaluations and between checkpoints, of the pendulum's robots and of other tasks."""
    return ENV_INTERVALS if robot is None else PENDULUM_INTERVALS


def whole(name: str, value: Any, least: int) -> int:
    """A whole number, as Python's.

    Raises:
        SwingupError: it is none, or too small.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating) or value % 1 != 0:
        raise SwingupError(f"{name} = {value!r} must be a whole number")
    if value < least:
        raise SwingupError(f"{name} = {value} must be at least {least}")
    return int(value)


def label(env: Any) -> str:
    """What to call an environment: its id, or its type or function in angle brackets."""
    if isinstance(env, str):
        return env
    named = env if hasattr(env, "__qualname__") else type(env)
    return f"<{named.__module__}.{named.__qualname__}>"


def is_label(name: str) -> bool:
    """Whether a name only describes an environment, which cannot be made from it."""
    return name.startswith("<")


def _option(name: str, value: Any) -> str:
    flag = name.replace("_", "-")
    if isinstance(value, bool):
        return f"--{flag}" if value else f"--no-{flag}"
    return f"--{flag} {' '.join(map(str, value)) if isinstance(value, tuple) else value}"
