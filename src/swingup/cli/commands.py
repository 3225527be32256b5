"""All commands: their arguments and help stand with the functions that run them."""

from collections.abc import Sequence

from .demonstrating import demo_command
from .exporting import export_command, rehearse_command
from .judging import evaluate_command, leaderboard_command, score_command
from .parsing import Command, parse
from .pendulums import compare_command, excite_command, identify_command, plant_command
from .plotting import plot_command
from .refining import refine_command
from .sweeping import sweep_command
from .training import train_command

DESCRIPTION = """Swing up and balance the acrobot and the pendubot with AR-EAPO.

Start here: demo trains a policy in minutes and shows it.

Judge controllers: evaluate, leaderboard, score.

Make them: train, sweep, refine. Their pendulums: plant, excite, identify.

Show and share them: compare, plot, export, rehearse."""

COMMANDS: dict[str, Command] = {
    "demo": demo_command,
    "evaluate": evaluate_command,
    "leaderboard": leaderboard_command,
    "score": score_command,
    "train": train_command,
    "sweep": sweep_command,
    "refine": refine_command,
    "plant": plant_command,
    "excite": excite_command,
    "identify": identify_command,
    "compare": compare_command,
    "plot": plot_command,
    "export": export_command,
    "rehearse": rehearse_command,
}


def run_command(arguments: Sequence[str]) -> int:
    """Parse the arguments and run the command; its exit status."""
    return parse(COMMANDS, arguments, DESCRIPTION)() or 0
