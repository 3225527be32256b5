"""All commands: their arguments and help stand with the functions that run them."""

from collections.abc import Callable

import tyro

from . import exporting, judging, pictures, planning, refining, sweeping, training


def run_command(arguments: list[str]) -> int:
    """Parse the arguments and run the command."""
    commands: dict[str, Callable[..., int]] = {
        "train": training.train,
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
