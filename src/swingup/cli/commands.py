"""The commands' arguments and help; what they do lies in the modules that they call."""

import itertools
from collections.abc import Callable
from typing import Annotated

import tyro
from tyro.conf import OmitArgPrefixes, Positional, arg

from ..areapo.config import Config
from ..learner.presets import DEFAULT_PRESET, get_preset
from . import judging, training

RobotName = Annotated[str, arg(metavar="ROBOT", help="acrobot or pendubot.")]


def run_command(arguments: list[str]) -> int:
    """Parse the arguments and run the command."""
    base = get_preset(_preset_named_in(arguments)).config

    def train(
        robot: Positional[RobotName],
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
            preset: named settings: default, paper, apo, eapo or ppo; the hyperparameters below change them.
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

    def evaluate(
        robot: Positional[RobotName],
        /,
        controller: str = "ar-eapo",
        rules: str = "v2",
        json: bool = False,
        save: str | None = None,
    ) -> int:
        """Simulate one swing-up by the benchmark's rules and score it.

        Args:
            robot: the robot.
            controller: ar-eapo (the shipped policy) or a policy file.
            rules: v2 (simulation) or hardware.
            json: print one JSON object.
            save: also write the trajectory to this CSV file.
        """
        return judging.evaluate(robot, controller, rules, json, save)

    def score(
        trajectory: Positional[Annotated[str, arg(metavar="TRAJECTORY")]],
        /,
        robot: str,
        rules: str = "v2",
        json: bool = False,
    ) -> int:
        """Score a trajectory file in RealAIGym's CSV format, from this program, another or a real robot.

        Args:
            trajectory: the CSV file.
            robot: acrobot or pendubot.
            rules: v2 (simulation) or hardware.
            json: print one JSON object.
        """
        return judging.score(trajectory, robot, rules, json)

    def leaderboard(
        robot: Positional[Annotated[str, arg(metavar="[ROBOT]")]] = "all", /, json: bool = False
    ) -> int:
        """Score the shipped policies and print the paper's performance table beside the published rows.

        Args:
            robot: acrobot, pendubot or all.
            json: print one JSON list of rows.
        """
        return judging.leaderboard(robot, json)

    commands: dict[str, Callable[..., int]] = {
        "train": train,
        "evaluate": evaluate,
        "score": score,
        "leaderboard": leaderboard,
    }
    return tyro.extras.subcommand_cli_from_dict(
        commands,
        prog="swingup",
        description="Swing up and balance the acrobot and the pendubot with AR-EAPO.",
        args=arguments,
    )


def _preset_named_in(arguments: list[str]) -> str:
    """The preset decides the hyperparameters' defaults, so that it is needed before they are parsed."""
    for argument, following in itertools.zip_longest(arguments, arguments[1:], fillvalue=""):
        name, _, value = argument.partition("=")
        if name == "--preset":
            return value or following
    return DEFAULT_PRESET
