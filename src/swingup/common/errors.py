"""The one exception that users are meant to read, and what its messages quote: values, errors, commands, times.

A foreign value becomes one line, printable and short, whatever its ``repr`` does. Foreign code, such as a
controller or an environment, may end the process (``sys.exit``) or raise what is not an ``Exception``. Only an
interrupt from the keyboard passes; everything else is a fault of that code, and must not end a benchmark of a
thousand runs.
"""

import contextlib
import json
import re
import reprlib
import shlex
from collections.abc import Iterator
from importlib import metadata
from typing import Any
from urllib.parse import unquote, urlsplit

LONGEST_MESSAGE = 2000  # characters of a message
LONGEST_QUOTE = 60  # characters that a message quotes of a value
MALFORMED = (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError)
"""Errors that a file's content of a wrong type, depth or encoding raises, wherever it is first used."""

_SHORT = reprlib.Repr()
_SHORT.maxlevel = 3
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = LONGEST_QUOTE


class SwingupError(Exception):
    """Bad input: the message is one line that names the value and the remedy.

    Whatever takes what a user gives may raise it; docstrings say when, at the names that users call.
    It is not a ``ValueError``, so that nothing between the check and the command line rephrases it. Line ends,
    control characters and letters that no terminal can print arrive escaped: names of files and keys are foreign
    text.
    """

    def __init__(self, message: str) -> None:
        self.args = (one_line(message, LONGEST_MESSAGE),)


@contextlib.contextmanager
def naming(subject: str, remedy: str = "") -> Iterator[None]:
    """Put what an error is about before it, and perhaps a remedy behind it."""
    try:
        yield
    except SwingupError as error:
        raise SwingupError(f"{subject}: {error}{remedy}") from error


@contextlib.contextmanager
def needing(package: str, extra: str, what: str, parts: str = "") -> Iterator[None]:
    """Name the extra that installs a package without which something does not work.

    A damaged package is to be uninstalled first, with its ``parts``.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise SwingupError(f"{what} needs {package}, which is missing: {installing(extra)}") from error
    except ImportError as error:
        raise SwingupError(
            f"{what} needs {package}, which is damaged ({one_line(error, 120)}): "
            f"pip uninstall {package}{parts}, then {installing(extra)}"
        ) from error


def installing(extra: str) -> str:
    """The command that installs an extra from where this package came from: a clone, an archive or an index."""
    try:
        origin = json.loads(metadata.distribution("swingup").read_text("direct_url.json") or "{}")
    # A folder for a robot is not a distribution.
    except (metadata.PackageNotFoundError, ValueError):
        origin = {}
    url = str(origin.get("url", ""))
    if origin.get("dir_info", {}).get("editable"):
        return f"pip install -e {shlex.quote(unquote(urlsplit(url).path) + f'[{extra}]')}"
    tool = f"{origin['vcs_info']['vcs']}+" if "vcs_info" in origin else ""
    return f"pip install {shlex.quote(f'swingup[{extra}]' + (f' @ {tool}{url}' if url else ''))}"


@contextlib.contextmanager
def errors_named_after(what: str, remedy: str = "correct it there") -> Iterator[None]:
    """Run foreign code, named by ``what`` as in "its reset()"."""
    try:
        yield
    # A SwingupError already names its fault.
    except (KeyboardInterrupt, SwingupError):
        raise
    except BaseException as error:
        raise SwingupError(f"{what} raised {described(error)}: {remedy}") from error


def described(error: BaseException) -> str:
    """A foreign error's kind and text. Compiled callbacks raise whole tracebacks; of these only the end is kept."""
    text = one_line(error)
    if "Traceback (most recent call last)" in text:
        text = one_line(re.split(r'\n  File "', str(error))[-1].partition("\n")[2])
    return f"{type(error).__name__} ({text})"


def attribute(source: Any, name: str, default: Any = None) -> Any:
    """An attribute of a foreign object, which a property or ``__getattr__`` may compute."""
    with errors_named_after(f"its attribute {name}"):
        return getattr(source, name, default)


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
