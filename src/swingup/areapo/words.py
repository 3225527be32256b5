"""Hyperparameters as text, for the command line, sweeps and the names of folders."""

from typing import Any

from ..common.errors import SwingupError
from ..common.text import quoted
from .config import NO_SCHEDULE, Config, check_hyperparameter, kind_of, words_of


def parse_value(name: str, text: str) -> Any:
    """A hyperparameter from text: 3e-4, true or false, 64x64 or 64 64 or 64,64, 0.5 1 1 0.1, or a word.

    Raises:
        SwingupError: the name is unknown, or the text is not a value of the hyperparameter's type.
    """
    default = getattr(Config(), check_hyperparameter(name))
    try:
        if isinstance(default, bool):
            flags = {"true": True, "false": False} | {word: word for word in words_of(name)}
            return flags[text.lower()]
        if isinstance(default, tuple):
            number = float if default == NO_SCHEDULE else int
            return tuple(number(part) for part in text.replace("x", " ").replace(",", " ").split())
        return type(default)(text)
    except (KeyError, ValueError) as error:
        raise SwingupError(f"{name} = {quoted(text)}: use {kind_of(name)}") from error


def format_value(value: Any) -> str:
    """A value as ``parse_value`` reads it."""
    # Joined by x: a sweep separates its alternatives by commas.
    return "x".join(map(str, value)) if isinstance(value, tuple) else str(value)
