"""All commands, and their command line: tyro reads the words; bad values end in one line of error."""

import functools
import inspect
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, get_args, get_type_hints, is_typeddict

import tyro
from tyro.conf import DisallowNone, OmitArgPrefixes, arg

from ..common.checks import OTHER_NAMES, one_of, suggestion
from ..common.errors import SwingupError, one_line, quoted
from .demonstrating import demo_command
from .exporting import export_command, plot_command, rehearse_command
from .judging import evaluate_command, leaderboard_command, score_command
from .output import PROGRAM
from .pendulums import compare_command, excite_command, identify_command, plant_command
from .refining import refine_command
from .sweeping import sweep_command
from .training import train_command

REPEATABLE = "--set"
"""The option that may be given more than once."""
NUMBERS: dict[Any, str] = {int: "use a whole number", float: "use a number"}
HELP = {"-h", "--help"}
SETTINGS = (DisallowNone, OmitArgPrefixes)

Command = Callable[..., int | None]
"""Returns an exit status; none is success."""
Ready = Callable[[], int | None]

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


def parse(commands: Mapping[str, Command], words: Sequence[str], description: str) -> Ready:
    """Bind the arguments of the command that the first word names; exit where tyro printed help."""
    name, *rest = words or [""]
    if name.startswith("-"):
        return _parse_alone(commands, words, description)
    if not name:
        raise SwingupError(f"a command is missing: use one of {', '.join(commands)}")
    program, command = f"{PROGRAM} {name}", commands[one_of("command", name, commands)]
    _check_options(program, command, rest)
    help_wanted = not HELP.isdisjoint(rest)
    try:
        ready, left = tyro.cli(
            _bound(command),
            prog=program,
            args=rest,
            return_unknown_args=True,
            console_outputs=help_wanted,  # tyro's errors are boxes of many lines
            config=SETTINGS,
        )
    except SystemExit:
        if help_wanted:
            raise
        raise SwingupError(f"{program} needs {_missing(command, rest)}: see {program} --help") from None
    if left:
        raise SwingupError(f"{program} has no place for {quoted(left[0])}: see {program} --help")
    return ready


def _parse_alone(commands: Mapping[str, Command], words: Sequence[str], description: str) -> Ready:
    """Options before any command: the list of commands with one sentence for each, or completion for a shell."""
    bound = {name: _bound(function) for name, function in commands.items()}
    for function in bound.values():
        function.__doc__ = (function.__doc__ or "").partition("\n\n")[0]
    try:
        return tyro.extras.subcommand_cli_from_dict(
            bound,
            prog=PROGRAM,
            description=description,
            args=list(words),
            config=SETTINGS,
            console_outputs=words[0] in HELP,
        )
    except SystemExit as stopped:
        if not stopped.code:
            raise
        wrong = f"{PROGRAM} has no option {one_line(words[0], 60)} before a command"
        raise SwingupError(f"{wrong}: see {PROGRAM} --help") from None


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


def _options(function: Command) -> dict[str, Any]:
    """The types of a command's options: its parameters, and the fields of those that are classes of options."""
    types, hints = get_type_hints(function), dict[str, Any]()
    for name, parameter in inspect.signature(function).parameters.items():
        if parameter.kind is not parameter.POSITIONAL_ONLY:
            hints |= get_type_hints(types[name]) if is_typeddict(types[name]) else {name: types[name]}
    options = {name.replace("_", "-"): hint for name, hint in hints.items()}
    return {f"--{name}": hint for name, hint in options.items()} | {
        f"--no-{name}": bool for name, hint in options.items() if hint is bool
    }


def _missing(function: Command, words: Sequence[str]) -> str:
    """What words that tyro refuses lack; its errors are not data, and all but these are found before."""
    required = [each for each in inspect.signature(function).parameters.values() if each.default is each.empty]
    names = [each.name.upper() for each in required if each.kind is each.POSITIONAL_ONLY]
    options = [f"--{each.name}" for each in required if each.kind is not each.POSITIONAL_ONLY]
    absent = [option for option in options if option not in (word.partition("=")[0] for word in words)]
    return " and ".join(absent if words and absent else names + absent)


def _check_options(program: str, command: Command, words: Sequence[str]) -> None:
    """Refuse options that tyro would refuse in a box of many lines, or take twice."""
    known, typed = _options(command), []
    for word, following in zip(words, [*words, "--"][1:], strict=True):
        if not word.startswith("--"):
            continue
        option, equals, value = word.partition("=")
        option = option.replace("_", "-")
        hint = known.get(option, bool)
        if option not in (*known, "--help"):
            ours = "--" + OTHER_NAMES.get(option[2:].replace("-", "_"), "").replace("_", "-")
            near = suggestion(option, known) or f"; see {program} --help"
            if ours in known:
                near = f": here it is {ours}"
            elif option[2:] in inspect.signature(command).parameters:  # a word that needs no option
                near = ": write its value alone"
            raise SwingupError(f"{program} has no option {one_line(option, 60)}{near}")
        if equals and hint is bool:
            raise SwingupError(f"{option} takes no value: write {option} alone")
        value = value if equals else following
        # An empty value, as of a variable that is not set, would choose the default, or nothing at all.
        lacks = not value.strip(", ") or (not equals and value.startswith("--"))
        if hint is not bool and lacks:
            raise SwingupError(f"{option} lacks its value: see {program} --help")
        _check_number(option, hint, value)
        typed.append(option.replace("--no-", "--"))
    for option, count in Counter(typed).items():
        if count > 1 and option != REPEATABLE:
            raise SwingupError(f"{option} is given twice: give it once, with all its values")


def _check_number(option: str, hint: Any, word: str) -> None:
    for kind in NUMBERS.keys() & {hint, *get_args(hint)}:
        try:
            kind(word)
        except ValueError:
            raise SwingupError(f"{option} {quoted(word)}: {NUMBERS[kind]}") from None
