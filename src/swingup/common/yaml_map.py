"""Flat YAML maps, ``name: value``: the form of parameter files and of domains.

YAML can do more than such a file needs, and most of that can be abused: aliases repeat a value a billion times,
tags build objects, nesting exhausts the stack. All of it is refused while the text is parsed, before any value is
built.
"""

from collections import Counter
from pathlib import Path
from typing import Any

import yaml

from .errors import LONGEST_QUOTE, SwingupError, naming, one_line, quoted
from .files import read_bytes

LARGEST_YAML = 100_000  # Bytes of a file; those of the package have less than 3,000

MAXIMUM_DEPTH = 10  # Levels of brackets; a range needs one, and keys that are ignored may hold a little more

FLAT_MAP = "write one 'name: value' a line"


class _PlainLoader(yaml.SafeLoader):
    """YAML of plain values: without aliases, tags, deep nesting, and names that come twice."""

    depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        # An event comes before its node, so that nothing is repeated or nested yet.
        event = self.peek_event()
        for what, found in (("an alias or an anchor", "anchor"), ("a tag", "tag")):
            if (name := getattr(event, found, None)) is not None:
                raise SwingupError(f"it has {what}, {quoted(name)}: write the value itself")
        if isinstance(event, yaml.CollectionStartEvent) and self.depth == MAXIMUM_DEPTH:
            raise SwingupError(f"it has brackets deeper than {MAXIMUM_DEPTH} levels: {FLAT_MAP}")
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        # PyYAML would keep the last value of a name.
        for name, count in Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)).items():
            if count > 1:
                name = one_line(name, LONGEST_QUOTE)
                raise SwingupError(f"it gives {name} {count} times: keep one of its values")
        return super().construct_mapping(node, deep)


def read_map(path: str | Path, kind: str) -> dict[str, Any]:
    """Read a flat YAML map; ``kind`` of file is named in errors."""
    with naming(f"{kind} file {one_line(path)}"):
        try:
            data = yaml.load(read_bytes(path, LARGEST_YAML).decode("utf-8"), _PlainLoader)
        except UnicodeDecodeError as error:
            raise SwingupError(f"it is not UTF-8 text: {FLAT_MAP}") from error
        except yaml.YAMLError as error:
            raise SwingupError(f"it is not YAML ({one_line(error)}): {FLAT_MAP}") from error
        except (ValueError, ArithmeticError) as error:  # 2001-99-99, 0x_ or 5,000 digits
            raise SwingupError(f"it has a value that is neither a number nor text: {FLAT_MAP}") from error
        if not isinstance(data, dict):
            raise SwingupError(f"it is not a map: {FLAT_MAP}")
        for name in data:
            if not isinstance(name, str):
                raise SwingupError(f"it gives a value to {quoted(name)}, which is not a name: {FLAT_MAP}")
    return data
