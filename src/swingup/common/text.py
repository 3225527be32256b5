"""Foreign values in messages: one line, printable and short, whatever their ``repr`` does."""

import reprlib
import shlex
from typing import Any

LONGEST_QUOTE = 60
"""Characters that a message quotes of a value."""

_SHORT = reprlib.Repr()
_SHORT.maxlevel = 3
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = LONGEST_QUOTE


def one_line(thing: object, length: int = 300) -> str:
    """The text of a foreign object or error: printable, in one line of bounded length."""
    try:
        text = thing if isinstance(thing, str) else str(thing)
    except (Exception, SystemExit) as error:  # a foreign __str__ may raise anything
        return f"<{type(thing).__name__} whose text raises {type(error).__name__}>"
    # Cut first: a text of gigabytes must not be copied.
    shown = printable(" ".join(text[: 4 * length].split()))
    return shown if len(shown) <= length else shown[: length - 3] + "..."


def printable(text: str) -> str:
    """The text with line ends, escape sequences and broken characters written out as Python's escapes."""
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


def quoted(value: object, length: int = LONGEST_QUOTE) -> str:
    """A value as an error message quotes it: its ``repr``, shortened before it is built.

    Containers are cut at six entries and three levels, so that nested aliases or long lists cost nothing.
    """
    try:
        text = _SHORT.repr(value)
    except (Exception, SystemExit) as error:  # a foreign __repr__ may raise anything
        return f"<{type(value).__name__} whose repr raises {type(error).__name__}>"
    return one_line(text, length)


def duration(seconds: float) -> str:
    """A time in the unit that suits it."""
    seconds = max(0.0, seconds)
    # From 99.5 on, rounding would show three digits.
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 99.5 * 60 else f"{seconds / 3600:.1f} h"


def command_line(*words: str, **options: Any) -> str:
    """A command of swingup that can be typed, without the options that are None or empty."""
    typed = ["swingup", *words]
    for name, value in options.items():
        option = name.replace("_", "-")
        if isinstance(value, bool):
            typed.append(f"--{option}" if value else f"--no-{option}")
        elif isinstance(value, tuple):
            typed += [f"--{option}", *map(str, value)] if value else []
        elif value is not None:
            typed.append(f"--{option}={value}")
    return shlex.join(typed)
