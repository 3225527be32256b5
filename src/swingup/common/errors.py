"""The one exception that users are meant to read."""

import contextlib
from collections.abc import Iterator

from .text import one_line

LONGEST_MESSAGE = 2000
"""Characters of a message."""


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
def needing(package: str, extra: str, what: str) -> Iterator[None]:
    """Name the extra that installs a package without which something does not work."""
    try:
        yield
    except ImportError as error:
        raise SwingupError(f"{what} needs {package}, which is missing: pip install 'swingup[{extra}]'") from error
