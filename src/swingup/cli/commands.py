"""All commands: their arguments and help stand with the functions that run them."""

import itertools
from collections.abc import Callable
from typing import Annotated

import tyro
from tyro.conf import OmitArgPrefixes, arg

from ..areapo.config import Config
from ..learner.presets import DEFAULT_PRESET, ENV_PRESET, PRESETS, get_preset
from ..tasks.domain import load_domain
from . import exporting, judging, pictures, planning, refining, sweeping, training
from .arguments import RobotOrNone

Preset = Annotated[str | None, arg(help=f"named settings: {', '.join(PRESETS)}; the options below change them.")]


def run_command(arguments: list[str]) -> int:
    """Parse the arguments and run the command."""
    commands: dict[str, Callable[..., int]] = {
        "train": _train_command(get_preset(_preset_named_in(arguments)).config),
        "sweep": sweeping.sweep,
        "refine": refining.refine,
        "evaluate": judging.evaluate,
        "score": judging.score,
        "robustness": judging.robustness,
        "uptime": judging.uptime,
        "sim2real": judging.sim2real,
        "leaderboard": judging.leaderboard,
        "check": judging.check,
        "plot": pictures.plot,
        "report": pictures.report,
        "trajectory": planning.trajectory,
        "export": exporting.export,
    }
    return tyro.extras.subcommand_cli_from_dict(
        commands,
        prog="swingup",
        description="Swing up and balance the acrobot and the pendubot with AR-EAPO.",
        args=arguments,
    )


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


def _preset_named_in(arguments: list[str]) -> str:
    """The preset decides the hyperparameters' defaults, so that it is needed before they are parsed."""
    for argument, following in itertools.zip_longest(arguments, arguments[1:], fillvalue=""):
        name, _, value = argument.partition("=")
        if name == "--preset":
            return value or following
    named = any(argument.partition("=")[0] == "--env" for argument in arguments)
    return ENV_PRESET if named else DEFAULT_PRESET
