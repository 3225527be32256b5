"""All commands: their arguments and help stand with the functions that run them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from ..benchmark.board_rules import BOARD_RULES, BoardRules
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
from .boards import BoardCommands, check_command, score_command
from .judging_commands import JudgingCommands
from .parsing import parse

DESCRIPTION = """Swing up and balance the acrobot and the pendubot with AR-EAPO.

Start here: demo trains a policy in minutes and shows it.

Judge controllers: evaluate, robustness, uptime, sim2real, leaderboard, score, check.

Make them: train, sweep, refine, trajectory, excite, identify.

Show and share them: compare, plot, report, export, rehearse."""


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
        "demo": demonstrating.demo,
        "evaluate": judging.evaluate,
        "robustness": judging.robustness,
        "uptime": judging.uptime,
        "sim2real": judging.sim2real,
        "leaderboard": leaderboards.leaderboard,
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
