"""All commands: their arguments and help stand with the functions that run them."""

from collections.abc import Callable, Sequence

from . import (
    comparing,
    demonstrating,
    exciting,
    exporting,
    identifying,
    pictures,
    planning,
    refining,
    rehearsing,
    sweeping,
    training,
)
from .judging import JudgingCommands, check_command, score_command
from .parsing import parse

DESCRIPTION = """Swing up and balance the acrobot and the pendubot with AR-EAPO.

Start here: demo trains a policy in minutes and shows it.

Judge controllers: evaluate, leaderboard, score, check.

Make them: train, sweep, refine, trajectory, excite, identify.

Show and share them: compare, plot, report, export, rehearse."""


def run_command(arguments: Sequence[str], judging: JudgingCommands | None = None) -> int:
    """Parse the arguments and run the command."""
    judging = judging or JudgingCommands()
    commands: dict[str, Callable[..., int]] = {
        "demo": demonstrating.demo,
        "evaluate": judging.evaluate,
        "leaderboard": judging.leaderboard,
        "score": score_command,
        "check": check_command,
        "train": training.train_command,
        "sweep": sweeping.sweep,
        "refine": refining.refine_command,
        "trajectory": planning.trajectory,
        "excite": exciting.excite_command,
        "identify": identifying.identify_command,
        "compare": comparing.compare_command,
        "plot": pictures.plot,
        "report": pictures.report,
        "export": exporting.export,
        "rehearse": rehearsing.rehearse_command,
    }
    return parse(commands, arguments, DESCRIPTION)()
