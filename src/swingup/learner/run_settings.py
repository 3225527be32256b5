"""The settings that define a training run, in the config.json of its folder."""

import dataclasses
import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..areapo.config import HYPERPARAMETERS, LARGEST_COUNT, Config, check_effects, config_from_dict
from ..common import __version__
from ..common.arrays import write_json
from ..common.checks import one_of, whole_number
from ..common.errors import MALFORMED, SwingupError, command_line, one_line
from ..common.files import file_name
from ..plant.plant import PlantLike, get_robot
from ..policy.pendulum import PLANT, read_plant
from ..policy.policy import TASK
from .backend import AbstractBackend
from .presets import PRESETS, get_preset
from .problem import AbstractProblem, filling, make_problem, problem_from_record

SETTINGS_FILE = "config.json"

MINIMUM = {"seed": 0, "seeds": 1, "evaluate_every": 1, "checkpoint_every": 1, "evaluation_episodes": 0}
"""Minimum values of the fields that are whole numbers."""
SETTINGS = ("preset", *MINIMUM, "plant", "resets")
"""Fields that a user gives beside the hyperparameters, to suggest for a misspelt one."""


@dataclass(frozen=True)
class RunSettings:
    """The settings that define a run, without its length; written to config.json."""

    problem: AbstractProblem
    """What is trained on."""
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
    evaluation_episodes: int = 1
    """Episodes of an evaluation; 0: training episodes give the score, where the host steps the environments."""

    def __post_init__(self) -> None:
        one_of("preset", self.preset, PRESETS)
        for name, minimum in MINIMUM.items():
            object.__setattr__(self, name, whole_number(name, getattr(self, name), minimum))
        self.problem.check_episodes(self.evaluation_episodes)
        # Arrays are indexed in 32 bits; a machine's memory ends earlier, which JAX says.
        sizes = {"num_envs x num_steps x seeds": self.config.rollout_size * self.seeds}
        for name in ("policy_layers", "value_layers"):
            sizes |= {f"{name} = {x} x {y}": x * y for x, y in itertools.pairwise(getattr(self.config, name))}
        for name, size in sizes.items():
            whole_number(name, size, 0, LARGEST_COUNT)
        # JAX's keys take seeds of 32 bits; the last seed is seed + seeds - 1.
        whole_number("seed", self.seed, 0, 2**32 - self.seeds)

    @property
    def folder_name(self) -> str:
        """The name of the folder in which a command keeps such a run."""
        return f"{file_name(self.problem.name)}-{self.preset}-{self.seed}"

    def make_backend(self) -> AbstractBackend:
        """The back end of these settings."""
        seeds = range(self.seed, self.seed + self.seeds)
        return self.problem.backend(self.preset, self.config, seeds, self.evaluation_episodes)

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

    def command(self, frames: int) -> str:
        """The command that makes such a run from scratch; in Python where environment or plant has no name."""
        problem = self.problem
        seeds = None if self.seeds == get_preset(self.preset).seeds else self.seeds
        if problem.command is None:
            words = [problem.arguments, f"preset={self.preset!r}", f"seed={self.seed}"]
            words += [] if seeds is None else [f"seeds={seeds}"]
            words += [f"{name}={value!r}" for name, value in self._changed().items()]
            comment = f"  # env: {problem.name}" if problem.name.startswith("<") else ""
            return f"swingup.AREAPO({', '.join(words)}).learn({frames}){comment}"
        options = {**problem.command, "preset": self.preset, "frames": frames, "seed": self.seed}
        robot = [options.pop("robot")] if "robot" in options else []
        options |= {"seeds": seeds, **self._changed()}
        return command_line("train", *robot, **options)

    def _changed(self) -> dict[str, Any]:
        """Hyperparameters that differ from the preset's, then intervals and episodes that are not the defaults."""
        usual = vars(self.problem.intervals)
        return self.changes | {name: value for name in usual if (value := getattr(self, name)) != usual[name]}

    @property
    def changes(self) -> dict[str, Any]:
        """The hyperparameters that differ from those that the preset has with the others."""
        mine, preset = vars(self.config), vars(get_preset(self.preset).config)
        # Not a Config: the preset's others may not go with these.
        usual = _values_for(self.problem, self.preset, {name: mine[name] for name in UNITS})
        usual |= {name: preset[name] for name in UNITS}
        return {name: value for name, value in mine.items() if value != usual[name]}

    def as_dict(self) -> dict[str, Any]:
        """The entries of config.json, as JSON values."""
        own = {name: value for name, value in vars(self).items() if name != "problem"}
        # Through JSON, so that tuples become lists and it equals what is read from a file.
        return json.loads(json.dumps(self.problem.record | own, default=dataclasses.asdict))


def make_run_settings(
    env: Any,
    preset: str | None = None,
    changes: Mapping[str, Any] | None = None,
    plant: PlantLike | None = None,
    resets: str | None = None,
    **given: Any,
) -> RunSettings:
    """The settings of a run, with the defaults of its preset and its problem for what is None or left out."""
    problem = make_problem(env, plant, resets)
    chosen = problem.choose_preset(preset)
    config = config_for(problem, chosen, changes or {})
    check_effects(changes or (), config)
    if given.get("evaluation_episodes") and problem.own_number is not None:
        raise SwingupError(
            f"evaluation_episodes = {given['evaluation_episodes']} has no effect with environments that were "
            "passed in, whose training gives the score: leave it out, or pass the function that makes one"
        )
    values = {"seed": 0, "seeds": get_preset(chosen).seeds, **vars(problem.intervals)}
    values |= {name: value for name, value in given.items() if value is not None}
    return RunSettings(problem, chosen, config=config, **values)


OF_DEVIATIONS = {"log_std_init", "excess_coefficient"}  # Hyperparameters without effect on discrete actions
UNITS = ("terminations", "schedule")  # Hyperparameters on which the meaning of another one depends


def config_for(problem: AbstractProblem, preset: str, changes: Mapping[str, Any]) -> Config:
    """The hyperparameters of a preset for a problem, with changes by name; misspelt names are refused."""
    return config_from_dict(_values_for(problem, preset, changes), ("env", "folder", *SETTINGS))


def _values_for(problem: AbstractProblem, preset: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    usual, sizes = get_preset(preset).config, {}
    if changes.get("terminations", usual.terminations) != usual.terminations:
        sizes["reset_cost"] = Config.reset_cost  # the preset's has another unit
    if changes.get("schedule", usual.schedule) != usual.schedule:
        sizes["schedule_frames"] = get_preset(preset).frames  # the preset's is for another schedule
    sizes |= problem.sizes(usual)
    return vars(usual) | sizes | dict(changes)


def settings_of_policy(metadata: Mapping[str, Any], env: Any = None) -> RunSettings:
    """The settings with which a policy file's run began, of one seed, on its task or on an environment like it."""
    robot = metadata.get("robot")
    named = str(metadata.get(TASK, "<unnamed>") if robot is None else robot)
    if env is None and named.startswith("<"):
        raise SwingupError(f"its environment was passed in ({one_line(named, 80)}): pass it again as env")
    plant = None if robot is None else read_plant(metadata.get(PLANT), get_robot(named))
    problem = make_problem(named, plant, metadata.get("resets")).on(env)
    preset, changes = metadata.get("preset"), metadata.get("hyperparameters")
    # An older file may have hyperparameters that are gone.
    changes = {name: changes[name] for name in HYPERPARAMETERS if isinstance(changes, Mapping) and name in changes}
    chosen = problem.choose_preset(preset if str(preset) in PRESETS else None)
    sizes = problem.sizes(get_preset(chosen).config)
    number = sizes.get("num_envs")
    if number is not None and number != changes.get("num_envs"):
        old = config_from_dict(vars(get_preset(chosen).config) | changes)  # refuses what is damaged
        changes |= {"num_envs": number, "num_steps": filling(old.rollout_size, number, old.batch_size)}
    config = config_for(problem, chosen, changes)
    seed = whole_number("seed", metadata.get("seed", 0), 0)
    return RunSettings(problem, chosen, seed, 1, **vars(problem.intervals), config=config)


def run_settings_from_dict(content: Any) -> RunSettings:
    """The settings of a ``RunSettings.as_dict``; those that an older version did not have get their defaults."""
    try:
        own = {name: value for name, value in content.items() if name not in ("robot", "env", "plant", "resets")}
        return RunSettings(problem_from_record(content), **{**own, "config": config_from_dict(content["config"])})
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
