"""From words to a command that is ready to run; words that are no command end in one line of error."""

import contextlib
import functools
import inspect
import io
import re
import shlex
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, get_type_hints

import tyro
from tyro.conf import DisallowNone, arg

from ..common.checks import suggestion
from ..common.errors import SwingupError
from ..common.other_names import OTHER_NAMES
from ..common.text import one_line, quoted

PROGRAM = "swingup"
REPEATABLE = {"--set"}
"""Options that may be given more than once."""

Command = Callable[..., int]
Ready = Callable[[], int]


def parse(commands: Mapping[str, Command], arguments: Sequence[str], description: str) -> Ready:
    """Choose a command by the first word and bind its arguments.

    Args:
        commands: functions by name; their signatures and docstrings make options and help.
        arguments: the words after the program's name.
        description: the head of the program's help.

    Raises:
        SwingupError: the words make no command.
        SystemExit: help was printed.
    """
    told = io.StringIO()
    try:
        with contextlib.redirect_stderr(told):
            ready = _run_tyro(commands, arguments, description)
    except SystemExit as stopped:
        if not stopped.code:
            raise
        raise SwingupError(_explain(commands, arguments, told.getvalue())) from None
    repeated = [
        name for name, number in Counter(_options(arguments)).items() if number > 1 and name not in REPEATABLE
    ]
    if repeated:
        name = repeated[0]
        raise SwingupError(f"{name} is given twice: write its values after one {name}, with spaces or commas")
    return ready


def program_typed() -> str:
    """The program as it can be typed: its name, its path where no active environment has it, or the module."""
    started = Path(sys.argv[0])
    if started.name != PROGRAM:
        return f"{shlex.quote(sys.executable)} -m {PROGRAM}"
    found = shutil.which(PROGRAM)
    return PROGRAM if found and Path(found).samefile(started) else shlex.quote(str(started))


def _run_tyro(commands: Mapping[str, Command], arguments: Sequence[str], description: str) -> Ready:
    """Parse only: functions are bound, not called, so that their own errors are not mistaken for tyro's."""

    def bind(function: Command) -> Callable[..., Ready]:
        @functools.wraps(function)
        def bound(*values: object, **options: object) -> Ready:
            return functools.partial(function, *values, **options)

        # None is not a value that anybody types: the help says in words what an option does when it is left out.
        hints, signature = get_type_hints(function, include_extras=True), inspect.signature(function)
        for name, parameter in signature.parameters.items():
            if parameter.default is None:
                hints[name] = Annotated[hints[name], arg(help_behavior_hint="")]
        parameters = [each.replace(annotation=hints[name]) for name, each in signature.parameters.items()]
        del bound.__wrapped__  # tyro would read the annotations there
        bound.__annotations__ = hints
        vars(bound)["__signature__"] = signature.replace(parameters=parameters)
        if next(iter(arguments), "") not in commands:  # the list of commands, with one sentence for each
            bound.__doc__ = (function.__doc__ or "").partition("\n\n")[0]
        return bound

    bound = {name: bind(function) for name, function in commands.items()}
    ready: Ready = tyro.extras.subcommand_cli_from_dict(
        bound, prog=PROGRAM, description=description, args=list(arguments), config=(DisallowNone,)
    )
    return ready


def _options(arguments: Sequence[str]) -> list[str]:
    """Names of the options among the words, as the help spells them."""
    return [word.partition("=")[0].replace("_", "-") for word in arguments if word.startswith("--")]


def _as_option(name: str) -> str:
    return "--" + name.replace("_", "-")


def _explain(commands: Mapping[str, Command], arguments: Sequence[str], told: str) -> str:
    """One line on words that tyro refused, from the words themselves and from what tyro printed."""
    command = next(iter(arguments), "")
    if command not in commands:
        wanted = f"use one of {', '.join(commands)}{suggestion(command, commands)}"
        return f"unknown command {quoted(command)}: {wanted}" if command else f"a command is missing: {wanted}"
    help_line = f"see {PROGRAM} {command} --help"
    known = _known_options(commands, command)
    unknown = [name for name in _options(arguments) if name not in known]
    if unknown:
        ours = _as_option(OTHER_NAMES.get(unknown[0].removeprefix("--").replace("-", "_"), ""))
        # An option of another command would not help.
        near = f": here it is {ours}" if ours in known else suggestion(unknown[0], known) or f"; {help_line}"
        return f"{PROGRAM} {command} has no option {one_line(unknown[0], 60)}{near}"
    rows = _rows(told)
    # tyro indents the names of missing arguments by four.
    missing = [row.strip() for row in rows if re.match(r" {4}\S", row)]
    if rows and rows[0].startswith("Missing from") and missing:
        return f"{PROGRAM} {command} needs {' and '.join(missing)}: {help_line}"
    return f"{_plain(' '.join(row.strip() for row in rows))}: {help_line}"


def _known_options(commands: Mapping[str, Command], command: str) -> list[str]:
    """Options that the help of a command lists."""
    with contextlib.redirect_stdout(io.StringIO()) as told, contextlib.suppress(SystemExit):
        _run_tyro(commands, [command, "--help"], "")
    return sorted(set(re.findall(r"--[a-z][a-z0-9-]*", told.getvalue())))


def _rows(told: str) -> list[str]:
    """The first part of tyro's box, without its frame."""
    rows: list[str] = []
    for line in re.sub(r"\x1b\[[0-9;]*m", "", told).splitlines()[1:]:
        row = line[2:].rstrip("│ ")  # the frame is blank where the terminal's encoding has no lines
        rule = set(row.strip()) <= {"─", "-"}
        if rule and rows:
            break
        rows += [] if rule else [row]
    return rows


def _plain(message: str) -> str:
    """Put tyro's messages into our own words."""
    for pattern, words in (
        (r"Error parsing (\S+): invalid literal for int\(\) with base 10: (.*)", r"\1 = \2 is no whole number"),
        (r"Error parsing (\S+): could not convert string to float: (.*)", r"\1 = \2 is no number"),
        (r"Unrecognized options: (.*)", r"unexpected \1"),
        (r"invalid choice (.*) for argument '(.*)'. Expected one of \((.*)\)\.", r"\2 = \1: use one of \3"),
        (r"Missing value for argument '(.*)'\. .*", r"\1 needs a value"),
    ):
        message = re.sub(pattern, words, message)
    return one_line(message.rstrip(". "), 300) or "these arguments make no command"
