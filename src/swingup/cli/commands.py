"""All commands and their command line, which tyro reads: help, completion, and errors with the nearest option."""

import functools
import inspect
import os
import re
import shutil
import sys
from collections.abc import Callable, Sequence, Set
from typing import Annotated, get_type_hints

import tyro
from tyro.conf import DisallowNone, OmitArgPrefixes, arg

from ..common.checks import one_of, swingup_name
from ..common.errors import SwingupError
from .demonstrating import demo_command
from .exporting import export_command, plot_command, rehearse_command
from .judging import evaluate_command, leaderboard_command, score_command
from .making import make_controller_command
from .output import PROGRAM
from .pendulums import compare_command, diagnose_command, excite_command, identify_command, plant_command
from .playing import watch_command
from .refining import refine_command
from .sweeping import sweep_command
from .training import train_command

NARROWEST = 40  # Columns of a help text, whatever the terminal has
SETTINGS = (DisallowNone, OmitArgPrefixes)

Command = Callable[..., int | None]
"""Returns an exit status; none is success."""
Ready = Callable[[], int | None]

DESCRIPTION = """Swing up and balance the acrobot and the pendubot with AR-EAPO.

Start here: demo trains a policy in minutes and shows it.

Judge controllers: evaluate, leaderboard, score.

Your pendulum: make-controller, from its logs to its controller; plant, excite, identify, diagnose.

Make policies: train, sweep, refine.

Show and share them: compare, plot, watch, export, rehearse."""

COMMANDS: dict[str, Command] = {
    "demo": demo_command,
    "evaluate": evaluate_command,
    "leaderboard": leaderboard_command,
    "score": score_command,
    "make-controller": make_controller_command,
    "train": train_command,
    "sweep": sweep_command,
    "refine": refine_command,
    "plant": plant_command,
    "excite": excite_command,
    "identify": identify_command,
    "diagnose": diagnose_command,
    "compare": compare_command,
    "plot": plot_command,
    "watch": watch_command,
    "export": export_command,
    "rehearse": rehearse_command,
}


def run_command(arguments: Sequence[str]) -> int:
    """Parse the arguments and run the command; its exit status."""
    # Tyro's time and memory for a narrow help have no bound.
    if shutil.get_terminal_size().columns < NARROWEST:
        os.environ["COLUMNS"] = str(NARROWEST)
    return parse(arguments)() or 0


def parse(words: Sequence[str]) -> Ready:
    """Bind the arguments of the command that the first word names; exit where tyro printed help or an error."""
    name, *rest = words or [""]
    if name.startswith("-"):
        return _parse_alone(words)
    command = COMMANDS[one_of("command", name, COMMANDS)]
    lists = {f"--{each}" for each, hint in get_type_hints(command).items() if hint == tuple[str, ...]}
    try:
        return tyro.cli(_bound(command), prog=f"{PROGRAM} {name}", args=gathered(rest, lists), config=SETTINGS)
    except SystemExit as stopped:
        for word in rest if stopped.code else []:
            # Tyro suggests what is spelt alike. Other packages have other words for the same thing.
            if hint := swingup_name(word.removeprefix("--").replace("-", "_")):
                print(f"{PROGRAM}: {word}{hint}", file=sys.stderr)
        raise


def gathered(words: Sequence[str], lists: Set[str]) -> list[str]:
    """The words with all values of a list option behind its first mention; tyro takes the last mention alone."""
    groups: dict[str | int, list[str]] = {"": []}
    into = groups[""]
    for place, word in enumerate(words):
        option, equals, value = word.partition("=")
        if option in lists:
            into = groups.setdefault(option, [option])
            into += [value] if equals else []
        elif word.startswith("--"):
            into = groups[place] = [word]
        else:
            into.append(word)
    for option in lists & groups.keys() if "--help" not in words else ():
        if not "".join(groups[option][1:]).strip(" ,"):  # from a shell's variable that is not set
            raise SwingupError(f"{option} has no value: give a value, or leave the option out")
    return [word for group in groups.values() for word in group]


def _parse_alone(words: Sequence[str]) -> Ready:
    """Options before any command: the list of commands with one sentence for each, or completion for a shell."""
    bound = {name: _bound(function) for name, function in COMMANDS.items()}
    for function in bound.values():
        function.__doc__ = (function.__doc__ or "").partition("\n\n")[0]
    return tyro.extras.subcommand_cli_from_dict(
        bound, prog=PROGRAM, description=DESCRIPTION, args=list(words), config=SETTINGS
    )


def _bound(function: Command) -> Callable[..., Ready]:
    """Binds arguments only, so that tyro sees the words' errors and not the command's."""

    @functools.wraps(function)
    def bind(*values: object, **options: object) -> Ready:
        return functools.partial(function, *values, **options)

    # The help wraps lines itself: an argument's text is one line. Tyro would read the function's own docstring.
    bind.__doc__ = re.sub(r"\n {12}\s*", " ", function.__doc__ or "")
    signature = inspect.signature(vars(bind).pop("__wrapped__"))
    types = get_type_hints(function, include_extras=True)
    for name, parameter in signature.parameters.items():
        if parameter.default in (None, ()):  # the text says what then happens, in place of "(default: None)"
            types[name] = Annotated[types[name], arg(help_behavior_hint="")]
    vars(bind)["__signature__"], bind.__annotations__ = signature, types
    return bind
