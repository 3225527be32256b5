"""All commands: their arguments and help stand with the functions that run them."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

from tyro.conf import OmitArgPrefixes, arg

from ..areapo.config import Config
from ..benchmark.board_rules import BOARD_RULES, BoardRules
from ..learner.presets import DEFAULT_PRESET, ENV_PRESET, PRESETS, get_preset
from ..tasks.domain import load_domain
from . import exporting, pictures, planning, refining, sweeping, training
from .arguments import RobotOrNone
from .boards import BoardCommands, check_command, score_command
from .judging import JudgingCommands
from .parsing import parse

Preset = Annotated[str | None, arg(help=f"named settings: {', '.join(PRESETS)}; the options below change them.")]


DESCRIPTION = """Swing up and balance the acrobot and the pendubot with AR-EAPO.

Judge controllers: evaluate, robustness, uptime, sim2real, leaderboard, score, check.

Make them: train, sweep, refine, trajectory.

Show and share them: plot, report, export."""


@dataclass(frozen=True)
class Boards:
    """What the judging commands judge by, as data: a test or a notebook can have smaller boards."""

    rules: Mapping[str, BoardRules] = field(default_factory=lambda: BOARD_RULES)
    """By the name that --rules takes."""
    entrants: Sequence[str] | None = None
    """Built-in controllers on the leaderboards; None for those of the rules."""


def run_command(arguments: Sequence[str], boards: Boards | None = None) -> int:
    """Parse the arguments and run the command."""
    boards = boards or Boards()
    judging, leaderboards = JudgingCommands(boards.rules), BoardCommands(boards.rules, boards.entrants)
    commands: dict[str, Callable[..., int]] = {
        "evaluate": judging.evaluate,
        "robustness": judging.robustness,
        "uptime": judging.uptime,
        "sim2real": judging.sim2real,
        "leaderboard": leaderboards.leaderboard,
        "score": score_command,
        "check": check_command,
        "train": _train_command(get_preset(_preset_named_in(arguments)).config),
        "sweep": sweeping.sweep,
        "refine": refining.refine_command,
        "trajectory": planning.trajectory,
        "plot": pictures.plot,
        "report": pictures.report,
        "export": exporting.export,
    }
    return parse(commands, arguments, DESCRIPTION)()


def _train_command(base: Config) -> Callable[..., int]:
    """The command ``train``, with the hyperparameters of a preset for defaults."""

    def train(
        robot: RobotOrNone = None,
        /,
        env: str | None = None,
        preset: Preset = None,
        frames: int | None = None,
        seed: int | None = None,
        seeds: int | None = None,
        out: str | None = None,
        resume: str | None = None,
        evaluate_every: int | None = None,
        checkpoint_every: int | None = None,
        evaluation_episodes: int | None = None,
        domain: Annotated[str | None, arg(metavar="DOMAIN")] = None,
        config: OmitArgPrefixes[Config] = base,
    ) -> int:
        """Train a policy, show where it stands, and end with its score.

        The folder holds config.json, metrics.jsonl, tensorboard/, checkpoints/, best.npz and last.npz.

        Args:
            robot: the robot; none with --env or --resume.
            env: Gymnasium id of another task, such as Swimmer-v5 or your.module:Task-v0.
            preset: named settings.
            frames: frames to train each seed for; default: the preset's.
            seed: the first seed; default 0.
            seeds: how many seeds to train side by side; default 1.
            out: folder of the run, new or empty; default runs/ROBOT-PRESET-SEED, or the id's name for the robot's.
            resume: folder of a run to continue from its last checkpoint, bit for bit.
            evaluate_every: frames between evaluations, metrics and progress; default 65536.
            checkpoint_every: frames between checkpoints; default 1048576, or 262144 with --env.
            evaluation_episodes: episodes of an evaluation with --env; default 5.
            domain: what the preset sim2real draws plants and loops from: identified (the default), randomised or a
                YAML file.
            config: the algorithm.
        """
        options = {
            "robot": robot, "env": env, "preset": preset, "seed": seed, "seeds": seeds,
            "evaluate_every": evaluate_every, "checkpoint_every": checkpoint_every,
            "evaluation_episodes": evaluation_episodes,
            "domain": None if domain is None else load_domain(domain),
        }  # fmt: skip
        return training.train(frames, options, out, resume, config)

    return train


def _preset_named_in(arguments: Sequence[str]) -> str:
    """The preset decides the hyperparameters' defaults, so that it is needed before they are parsed."""
    for argument, following in itertools.zip_longest(arguments, arguments[1:], fillvalue=""):
        name, _, value = argument.partition("=")
        if name == "--preset":
            return value or following
    named = any(argument.partition("=")[0] == "--env" for argument in arguments)
    return ENV_PRESET if named else DEFAULT_PRESET
