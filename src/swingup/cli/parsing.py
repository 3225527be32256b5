"""From words to a command that is ready to run: tyro reads them, and bad values end in one line of error."""

import dataclasses
import functools
import inspect
import re
import shlex
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, get_type_hints, is_typeddict

import tyro
from tyro.conf import DisallowNone, OmitArgPrefixes
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from ..common.checks import suggestion
from ..common.errors import SwingupError
from ..common.other_names import OTHER_NAMES
from ..common.text import one_line, quoted

PROGRAM = "swingup"
REPEATABLE = "--set"
"""The option that may be given more than once."""
NUMBERS: dict[Any, str] = {int: "use a whole number", float: "use a number"}
SETTINGS = (DisallowNone, OmitArgPrefixes)

Command = Callable[..., int]
Ready = Callable[[], int]


def parse(commands: Mapping[str, Command], words: Sequence[str], description: str) -> Ready:
    """Choose a command by the first word and bind its arguments.

    Args:
        commands: functions by name; their signatures and docstrings make options and help.
        words: what was typed after the program's name.
        description: the head of the program's help.

    Raises:
        SwingupError: the words make no command.
        SystemExit: tyro printed help, or what is missing.
    """
    name, *rest = words or [""]
    if name.startswith("-"):
        return _parse_alone(commands, words, description)
    if name not in commands:
        wanted = f"use one of {', '.join(commands)}{suggestion(name, commands)}"
        raise SwingupError(
            f"unknown command {quoted(name)}: {wanted}" if name else f"a command is missing: {wanted}"
        )
    program = f"{PROGRAM} {name}"
    _check_options(program, _options(commands[name]), rest)
    ready, left = tyro.cli(
        _bound(commands[name]),
        prog=program,
        args=rest,
        return_unknown_args=True,
        config=SETTINGS,
        registry=REGISTRY,
    )
    if left:
        raise SwingupError(f"{program} has no place for {quoted(left[0])}: see {program} --help")
    return ready


def program_typed() -> str:
    """The program as it can be typed: its name, its path where no active environment has it, or the module."""
    started = Path(sys.argv[0])
    if started.name != PROGRAM:
        return f"{shlex.quote(sys.executable)} -m {PROGRAM}"
    found = shutil.which(PROGRAM)
    return PROGRAM if found and Path(found).samefile(started) else shlex.quote(str(started))


def command_line(*words: str, **options: Any) -> str:
    """A command that can be typed, without the options that are None or empty."""
    typed = [PROGRAM, *words]
    for name, value in options.items():
        option = name.replace("_", "-")
        if isinstance(value, bool):
            typed.append(f"--{option}" if value else f"--no-{option}")
        elif isinstance(value, tuple):
            typed += [f"--{option}", *value] if value else []
        elif value is not None:
            typed.append(f"--{option}={value}")
    return shlex.join(typed)


def value_of(make: Callable[..., Any], metavar: str, words: Any = 1) -> PrimitiveConstructorSpec[Any]:
    """How tyro makes a value from so many words; a SwingupError of ``make`` is the command's.

    Args:
        make: from the words to the value.
        metavar: what the help shows.
        words: their number; ``"*"`` for any.
    """
    return PrimitiveConstructorSpec(
        nargs=words,
        metavar=metavar,
        instance_from_str=lambda typed: make(*typed),
        is_instance=lambda value: True,
        str_from_instance=lambda value: [
            getattr(each, "name", str(each)) for each in (value if isinstance(value, tuple) else (value,))
        ],
    )


def _parse_alone(commands: Mapping[str, Command], words: Sequence[str], description: str) -> Ready:
    """Options before any command: the list of commands with one sentence for each, or completion for a shell."""
    bound = {name: _bound(function) for name, function in commands.items()}
    for function in bound.values():
        function.__doc__ = (function.__doc__ or "").partition("\n\n")[0]
    ready: Ready = tyro.extras.subcommand_cli_from_dict(
        bound, prog=PROGRAM, description=description, args=list(words), config=SETTINGS
    )
    return ready


def _bound(function: Command) -> Callable[..., Ready]:
    """Binds arguments only, so that tyro sees the words' errors and not the command's."""

    @functools.wraps(function)
    def bind(*values: object, **options: object) -> Ready:
        return functools.partial(function, *values, **options)

    # The help wraps lines itself: an argument's text is one line. Tyro would read the function's own docstring.
    bind.__doc__ = re.sub(r"\n {12}\s*", " ", function.__doc__ or "")
    vars(bind)["__signature__"] = inspect.signature(vars(bind).pop("__wrapped__"))
    return bind


REGISTRY = ConstructorRegistry()


@REGISTRY.primitive_rule
def _number_rule(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    kind = info.type
    return value_of(functools.partial(_number, kind), kind.__name__.upper()) if kind in NUMBERS else None


def _number(kind: type, word: str) -> Any:
    try:
        return kind(word)
    except ValueError:
        raise SwingupError(f"{quoted(word)}: {NUMBERS[kind]}") from None


def _options(function: Command) -> list[str]:
    """The options of a command: its parameters, and the fields of those that are classes of options."""
    hints: dict[str, Any] = {}
    annotations = get_type_hints(function, include_extras=True)
    for name, hint in get_type_hints(function).items():
        # An annotated class, such as a robot, is one value.
        grouped = hint is annotations[name] and (dataclasses.is_dataclass(hint) or is_typeddict(hint))
        hints |= get_type_hints(hint) if grouped else {name: hint}
    names = [name.replace("_", "-") for name in hints]
    return [f"--{name}" for name in names] + [
        f"--no-{name}" for name in names if hints[name.replace("-", "_")] is bool
    ]


def _check_options(program: str, known: Sequence[str], words: Sequence[str]) -> None:
    """Refuse options that a command does not have, or that are given twice, before tyro takes their values.

    Raises:
        SwingupError: there is one; the line has ours for the name of another package, or suggests the nearest.
    """
    typed = [word.partition("=")[0].replace("_", "-") for word in words if word.startswith("--")]
    for option in typed:
        if option not in (*known, "--help"):
            ours = "--" + OTHER_NAMES.get(option[2:].replace("-", "_"), "").replace("_", "-")
            near = (
                f": here it is {ours}" if ours in known else suggestion(option, known) or f"; see {program} --help"
            )
            raise SwingupError(f"{program} has no option {one_line(option, 60)}{near}")
    counts = Counter(option.replace("--no-", "--") for option in typed if option != REPEATABLE)
    for option, count in counts.items():
        if count > 1:
            raise SwingupError(f"{option} is given twice: give it once, with all its values")
