"""What varies in a sweep or a search: alternatives of a setting, or the range of a number."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..areapo.config import Config, check_hyperparameter, check_value
from ..areapo.words import format_value, parse_value
from ..common.checks import is_number
from ..common.errors import SwingupError
from ..common.text import quoted
from ..learner.presets import preset_name

LOG = "log"


@dataclass(frozen=True)
class Range:
    """Numbers from ``low`` to ``high``, both included."""

    low: float
    high: float
    log: bool = False
    """Whether equal ratios are equally likely, not equal differences."""

    def __str__(self) -> str:
        return f"{self.low}:{self.high}{f':{LOG}' if self.log else ''}"


Space = Mapping[str, Range | Sequence[Any]]
"""Ranges or alternatives by the name of a hyperparameter, or alternatives of ``preset``."""


def parse_space(assignments: Sequence[str]) -> dict[str, Range | list[Any]]:
    """Ranges and alternatives from words like ``learning_rate=1e-4:1e-2:log`` or ``policy_layers=64x64,128x128``.

    Raises:
        SwingupError: a word is no assignment, a name is unknown, a value is of another type, or a range is empty
            or beside other values.
    """
    space: dict[str, Range | list[Any]] = {}
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        name = name.replace("-", "_")
        if not equals:
            raise SwingupError(
                f"--set {quoted(assignment)}: write NAME=VALUE,VALUE with a hyperparameter's name or preset"
            )
        try:
            values = parse_values(name, text)
        except SwingupError as error:
            raise SwingupError(f"--set {quoted(assignment)}: {error}") from error
        known = space.setdefault(name, values)
        if known is not values:
            if isinstance(known, Range) or isinstance(values, Range):
                raise SwingupError(f"--set {quoted(assignment)}: give {name} one range, or alternatives")
            known.extend(values)
    return space


def parse_values(name: str, text: str) -> Range | list[Any]:
    """The range or the alternatives of a setting from text.

    Raises:
        SwingupError: the name is unknown, a value is of another type, or the range is empty.
    """
    _check_name(name)
    if ":" not in text:
        return [part if name == "preset" else parse_value(name, part) for part in text.split(",")]
    low, high, *scale = text.split(":")
    if name == "preset" or "," in text or scale not in ([], [LOG]):
        raise SwingupError(f"{quoted(text)} is no range: write LOW:HIGH or LOW:HIGH:{LOG}, or alternatives")
    return check_range(name, Range(parse_value(name, low), parse_value(name, high), bool(scale)))


def check_space(space: Mapping[str, Any]) -> dict[str, Range | list[Any]]:
    """A space from Python: ranges, alternatives or their text by name, each checked by itself.

    Raises:
        SwingupError: nothing varies, a name is unknown, or a value cannot work.
    """
    if not isinstance(space, Mapping):
        raise SwingupError(f"space = {quoted(space)}: give a dictionary of ranges and alternatives by name")
    if not space:
        raise SwingupError("nothing varies: give a range, such as learning_rate=1e-4:1e-2:log, or alternatives")
    checked: dict[str, Range | list[Any]] = {}
    for name, given in space.items():
        _check_name(name)
        values = parse_values(name, given) if isinstance(given, str) else given
        if isinstance(values, Range):
            checked[name] = check_range(name, values)
            continue
        if not isinstance(values, list | tuple) or not values:
            raise SwingupError(f"{name} = {quoted(values)}: give a Range, or a list of alternatives")
        for value in values:
            if name == "preset":
                preset_name(value)
            else:
                check_value(name, value)
        checked[name] = list(values)
    return checked


def check_range(name: str, range_: Range) -> Range:
    """A range of a number that has one.

    Raises:
        SwingupError: the setting is no number, an end cannot be its value, or the range is empty.
    """
    kind = type({field.name: field.default for field in dataclasses.fields(Config)}.get(name))
    if kind not in (int, float):
        raise SwingupError(f"{name} = {quoted(str(range_))}: only numbers have ranges; list the alternatives")
    for end in (range_.low, range_.high):
        check_value(name, end)
    if not is_number(range_.low) or not is_number(range_.high) or not range_.low < range_.high:
        raise SwingupError(f"{name} = {quoted(str(range_))}: write the smaller end first")
    if range_.log and not range_.low > 0:
        raise SwingupError(f"{name} = {quoted(str(range_))}: a logarithmic range begins above 0")
    return range_


def as_words(space: Space) -> dict[str, str]:
    """A space as the text that ``parse_values`` reads."""
    return {
        name: str(values) if isinstance(values, Range) else ",".join(map(format_value, values))
        for name, values in space.items()
    }


def _check_name(name: Any) -> None:
    if name != "preset":
        check_hyperparameter(name, ["preset"])
