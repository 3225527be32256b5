"""XML files as trees of elements. Document types, and with them all entities, are refused, and depth has a bound.

Expansion of entities is what makes XML dangerous: a few lines fill the memory, or read other files. Model files
need none.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from .checks import LARGEST_NUMBER
from .errors import SwingupError, one_line, quoted
from .files import read_bytes

LARGEST_XML = 2_000_000
"""Bytes of a file; meshes lie in files of their own."""

DEEPEST = 60
"""Levels of elements."""


@dataclass(frozen=True)
class Attributes:
    """Attributes of an element, and how errors name it."""

    values: Mapping[str, str]
    where: str

    def numbers(self, name: str, default: Sequence[float], least: int | None = None) -> np.ndarray:
        """Finite numbers that spaces separate; as many as the default has, or at least so many."""
        if name not in self.values:
            return np.array(default, dtype=float)
        words = self.values[name].split()
        if not (len(default) if least is None else least) <= len(words) <= len(default):
            count = "a number" if len(default) == 1 else f"{len(default)} numbers"
            raise SwingupError(f"{self.where} has {name} = {quoted(self.values[name])}: write {count}")
        return np.array([self._finite(name, word) for word in words] + list(default[len(words) :]))

    def number(self, name: str, default: float) -> float:
        """One number, which must be finite."""
        return float(self.numbers(name, (default,))[0])

    def text(self, name: str, default: str = "") -> str:
        """A text as it stands."""
        return self.values.get(name, default)

    def _finite(self, name: str, word: str) -> float:
        try:
            number = float(word)
        except ValueError:
            number = np.nan
        if not abs(number) < LARGEST_NUMBER:
            raise SwingupError(f"{self.where} has {name} = {quoted(word)}: write a finite number")
        return number


def attributes_of(element: Element, kind: str = "") -> Attributes:
    """The attributes that an element has itself; errors name it by its tag and its name."""
    name = element.get("name") or element.get("joint")
    return Attributes(element.attrib, f"<{one_line(kind or element.tag, 60)}{f' {quoted(name)}' if name else ''}>")


def read_tree(path: str | Path, kind: str) -> Element:
    """Read an XML file; the ``kind`` of file is named in errors."""
    named = f"{kind} file {one_line(path)}"
    data, builder, depth = read_bytes(path, LARGEST_XML), TreeBuilder(), 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise SwingupError(f"{named} has elements deeper than {DEEPEST} levels")
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*given: object) -> NoReturn:
        raise SwingupError(f"{named} has a document type (<!DOCTYPE>), which may hold entities: remove it")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, LookupError, ValueError) as error:  # a syntax, an encoding that Python lacks
        raise SwingupError(f"{named} is not XML ({one_line(error)})") from error
    return builder.close()
