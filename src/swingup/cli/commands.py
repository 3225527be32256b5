"""All commands: their arguments and help stand with the functions that run them."""

import itertools
from collections.abc import Callable

import tyro
from tyro.conf import OmitArgPrefixes

from ..areapo.config import Config
from ..learner.presets import DEFAULT_PRESET, get_preset
from . import exporting, judging, pictures, planning, refining, training
from .arguments import RobotName


def run_command(arguments: list[str]) -> int:
    """Parse the arguments and run the command."""
    commands: dict[str, Callable[..., int]] = {
        "train": _train_command(get_preset(_preset_named_in(arguments)).config),
        "refine": refining.refine,
        "evaluate": judging.evaluate,
        "score": judging.score,
        "robustness": judging.robustness,
        "uptime": judging.uptime,
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
        robot: RobotName,
        /,
        preset: str | None = None,
        frames: int | None = None,
        seed: int | None = None,
        seeds: int | None = None,
        out: str | None = None,
        resume: str | None = None,
        evaluate_every: int | None = None,
        checkpoint_every: int | None = None,
        config: OmitArgPrefixes[Config] = base,
    ) -> int:
        """Train a policy, show where it stands, and end with its score.

        The folder holds config.json, metrics.jsonl, tensorboard/, checkpoints/, best.npz and last.npz.

        Args:
            robot: the robot.
            preset: named settings: default, paper, global, apo, eapo or ppo; the hyperparameters below change them.
            frames: frames to train each seed for; default: the preset's.
            seed: the first seed; default 0.
            seeds: how many seeds to train side by side; default 1.
            out: folder of the run, new or empty; default runs/ROBOT-PRESET-SEED.
            resume: folder of a run to continue from its last checkpoint, bit for bit.
            evaluate_every: frames between evaluations, metrics and progress; default 65536.
            checkpoint_every: frames between checkpoints; default 1048576.
            config: the algorithm.
        """
        options = {"preset": preset, "seed": seed, "seeds": seeds}
        intervals = {"evaluate_every": evaluate_every, "checkpoint_every": checkpoint_every}
        return training.train(robot, frames, options | intervals, out, resume, config)

    return train


def _preset_named_in(arguments: list[str]) -> str:
    """The preset decides the hyperparameters' defaults, so that it is needed before they are parsed."""
    for argument, following in itertools.zip_longest(arguments, arguments[1:], fillvalue=""):
        name, _, value = argument.partition("=")
        if name == "--preset":
            return value or following
    return DEFAULT_PRESET
