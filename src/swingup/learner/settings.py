"""What defines a training run, as it stands in the config.json of its folder."""

import dataclasses
import json
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..areapo.config import Config, config_from_dict
from ..errors import SwingupError
from ..files import write_atomically
from ..physics.parameters import get_robot
from ..tasks.domain import Domain
from ..tasks.pendulum import PendulumTask
from ..tasks.presets import HARDWARE_TASKS, get_task
from ..version import __version__
from .presets import get_preset

FILE = "config.json"

PENDULUM_INTERVALS = {"evaluate_every": 65_536, "checkpoint_every": 1_048_576}
ENV_INTERVALS = {"evaluate_every": 65_536, "checkpoint_every": 262_144}
"""Frames between evaluations and between checkpoints unless others are asked for."""


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
    """Frames of a seed between evaluations and reports."""
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
        if self.domain is not None and (preset.task not in HARDWARE_TASKS or self.robot is None):
            raise SwingupError(f"a domain goes with the presets for hardware, not with {self.preset}")
        if self.evaluation_episodes < 0:
            raise SwingupError(f"evaluation_episodes = {self.evaluation_episodes} must be at least 0")
        for name in ("seeds", "evaluate_every", "checkpoint_every"):
            if getattr(self, name) < 1:
                raise SwingupError(f"{name} = {getattr(self, name)} must be at least 1")
        if not 0 <= self.seed <= 2**32 - self.seeds:
            raise SwingupError(f"seed = {self.seed} must lie between 0 and 2^32 - {self.seeds}")

    @property
    def chunk(self) -> int:
        """Iterations between reports."""
        return max(1, self.evaluate_every // self.config.rollout_size)

    @property
    def name(self) -> str:
        """What is trained on: the robot or the environment."""
        return str(self.robot or self.env)

    def task(self) -> PendulumTask:
        """The pendulum's task that these settings train on."""
        if self.robot is None:
            raise SwingupError(f"{self.env} is no task of the pendulum")
        robot, name = get_robot(self.robot), get_preset(self.preset).task
        return get_task(name, robot) if self.domain is None else HARDWARE_TASKS[name](robot, self.domain)

    def command(self, frames: int) -> str:
        """The command that makes such a run from scratch."""
        task = self.robot if self.env is None else f"--env {self.env}"
        words = [f"swingup train {task} --preset {self.preset} --frames {frames} --seed {self.seed}"]
        words += [] if self.domain is None else [f"--domain {shlex.quote(self.domain.name)}"]
        words += [] if self.seeds == 1 else [f"--seeds {self.seeds}"]
        usual = vars(get_preset(self.preset).config)
        for name, value in vars(self.config).items():
            if value != usual[name]:
                words.append(_option(name, value))
        return " ".join(words)

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


def _option(name: str, value: Any) -> str:
    flag = name.replace("_", "-")
    if isinstance(value, bool):
        return f"--{flag}" if value else f"--no-{flag}"
    return f"--{flag} {' '.join(map(str, value)) if isinstance(value, tuple) else value}"
