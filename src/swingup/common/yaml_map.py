"""Flat YAML maps, ``name: value``: the form of parameter files and of domains.

YAML can do more than such a file needs, and most of that can be abused: aliases repeat a value a billion times,
tags build objects, nesting exhausts the stack. The text is first scanned as a stream of events, which costs time
and memory in proportion to its length. Everything but plain values is refused before any value is built.
"""

from pathlib import Path
from typing import Any

import yaml

from .errors import LONGEST_QUOTE, SwingupError, one_line, quoted
from .files import read_bytes

LARGEST_YAML = 100_000
"""Bytes of a file; those of the package have less than 3,000."""

DEEPEST = 10
"""Levels of brackets; a range needs one, and keys that are ignored may hold a little more."""

FLAT_MAP = "write one 'name: value' a line"


def read_map(path: str | Path, kind: str) -> dict[str, Any]:
    """Read a flat YAML map; ``kind`` of file is named in errors."""
    named = f"{kind} file {path}"
    try:
        text = read_bytes(path, LARGEST_YAML).decode("utf-8")
        _refuse_more_than_plain(text, named)
        data = yaml.safe_load(text)
    except UnicodeDecodeError as error:
        raise SwingupError(f"{named} is not UTF-8 text: {FLAT_MAP}") from error
    except yaml.YAMLError as error:
        raise SwingupError(f"{named} is not YAML ({one_line(error)}): {FLAT_MAP}") from error
    except (ValueError, ArithmeticError) as error:  # 2001-99-99, 0x_ or 5,000 digits
        raise SwingupError(f"{named} has a value that is neither a number nor text: {FLAT_MAP}") from error
    if not isinstance(data, dict):
        raise SwingupError(f"{named} is not a map: {FLAT_MAP}")
    for name in data:
        if not isinstance(name, str):
            raise SwingupError(f"{named} gives a value to {quoted(name)}, which is not a name: {FLAT_MAP}")
    return data


def _refuse_more_than_plain(text: str, named: str) -> None:
    """Refuse all that YAML has beyond plain values, nesting, and a name of the outermost map that comes twice."""
    depth, names, is_map, is_name = 0, dict[str, int](), False, True
    for event in yaml.parse(text, yaml.SafeLoader):
        anchor, tag = getattr(event, "anchor", None), getattr(event, "tag", None)
        if anchor is not None:
            raise SwingupError(f"{named} has an alias or an anchor, {quoted(anchor)}: write the value itself")
        if tag is not None:
            raise SwingupError(f"{named} has a tag, {quoted(tag)}: write plain values")
        if depth == 0 and isinstance(event, yaml.NodeEvent):
            is_map = isinstance(event, yaml.MappingStartEvent)
        elif depth == 1 and is_map and isinstance(event, yaml.NodeEvent):
            # In a map names and values take turns.
            if is_name and isinstance(event, yaml.ScalarEvent):
                names[event.value] = names.get(event.value, 0) + 1
            is_name = not is_name
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise SwingupError(f"{named} has brackets deeper than {DEEPEST} levels: {FLAT_MAP}")
    for name, count in names.items():
        if count > 1:
            raise SwingupError(
                f"{named} gives {one_line(name, LONGEST_QUOTE)} {count} times: keep one of its values"
            )
