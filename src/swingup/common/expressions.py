"""Expressions in the columns of a file, as in atan2(s, c) or 8*(goal1-pos1)-0.3*vel1.

An expression is a sum of atoms, each times a number, and of a number. An atom is a column, by its title or its
place (#3, or x#3 of a matrix x), or a function of expressions. Python's own parser reads the text, and of its
syntax nothing else is accepted. Titles are replaced by names first, since they may hold any letters.
"""

import ast
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from .errors import SwingupError, quoted

WORD = r"[^\W\d][\w.]*"  # most titles
NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"  # as 1e-9
LARGEST_FACTOR = 1e21  # times since 1970 in nanoseconds have 19 digits, and no number of a pendulum comes near
LONGEST = 300  # characters of an expression, which bound how deep it is
FUNCTIONS: dict[str, tuple[Callable[..., np.ndarray], int]] = {
    "atan2": (np.arctan2, 2), "sin": (np.sin, 1), "cos": (np.cos, 1), "abs": (np.abs, 1), "clip": (np.clip, 3),
}  # fmt: skip
"""Functions and the number of their arguments; clip(x, low, high) is a servo that saturates."""


@dataclass(frozen=True)
class Call:
    """A function of expressions."""

    name: str
    arguments: "tuple[Expression, ...]"

    def __str__(self) -> str:
        return f"{self.name}({','.join(map(str, self.arguments))})"


@dataclass(frozen=True)
class Expression:
    """A sum of columns and functions of columns, each times a number, and of a constant."""

    terms: tuple[tuple[float, str | Call], ...] = ()  # Factors, mostly signs, and titles ("#3" is a place) or calls
    constant: float = 0.0

    @property
    def titles(self) -> tuple[str, ...]:
        """Titles of all columns in it."""
        found = [
            [each] if isinstance(each, str) else [title for part in each.arguments for title in part.titles]
            for _, each in self.terms
        ]
        return tuple(dict.fromkeys(title for part in found for title in part))

    @property
    def is_plain(self) -> bool:
        """Whether it adds and subtracts columns as they are, so that they share a unit."""
        return all(isinstance(each, str) and abs(factor) == 1 for factor, each in self.terms)

    def times(self, factor: float) -> "Expression":
        """The expression times a number."""
        return Expression(tuple((factor * each, atom) for each, atom in self.terms), factor * self.constant)

    def plus(self, other: "Expression") -> "Expression":
        """The sum of two expressions."""
        return Expression((*self.terms, *other.terms), self.constant + other.constant)

    def evaluate(self, read: Callable[[str], np.ndarray], rows: int) -> np.ndarray:
        """Its values in so many rows, with the columns that ``read`` gives for their titles."""
        # Without a first zero, to which -0.0 would be added.
        parts = [np.full(rows, self.constant)] if self.constant or not self.terms else []
        for factor, atom in self.terms:
            if isinstance(atom, str):
                values = read(atom)
            else:
                values = FUNCTIONS[atom.name][0](*(each.evaluate(read, rows) for each in atom.arguments))
            parts.append(factor * values)
        return np.asarray(sum(parts[1:], parts[0]))

    def __str__(self) -> str:
        text = "".join(
            "+-"[factor < 0] + str(atom) + f"*{abs(factor):.10g}" * (abs(factor) != 1)
            for factor, atom in self.terms
        ).removeprefix("+")
        if self.constant:
            size = abs(self.constant)
            pi = {1.0: "pi", 2.0: "pi/2"}.get(round(math.pi / size, 9), "")
            text += "+-"[self.constant < 0] + (pi or f"{size:.10g}")
        return (text if self.terms else text.removeprefix("+")) or "0"


def parse_expression(text: str, titles: Sequence[str]) -> Expression:
    """The expression of a text over columns with these titles.

    Raises:
        SwingupError: a part is not an expression's; the message quotes it.
    """
    if len(text) > LONGEST:
        raise SwingupError(f"it has {len(text)} characters: use at most {LONGEST}")
    names: list[str] = []

    def replaced(found: re.Match[str]) -> str:
        """A token, with a name in the place of a column."""
        title, place, word = found["title"], found["place"], found["word"]
        if found["rest"]:
            raise SwingupError(f"{quoted(found['rest'], 20)} is not part of an expression, which has + - * / ( )")
        if found["number"]:
            checked_number(found["number"])
        if place:
            title = _title_at(found["matrix"] or "", place, titles)
        elif word in titles and not (found["call"] and word in FUNCTIONS):
            title = word
        elif word and found["call"] and word not in FUNCTIONS:
            raise SwingupError(f"there is no function {quoted(word)}, but {', '.join(FUNCTIONS)}")
        elif word and not found["call"] and word != "pi":
            raise SwingupError(_unknown(word, titles))
        if title is None:
            return found[0]
        names.append(title)
        return f" _{len(names) - 1} {found['call'] or ''}"

    odd = sorted({each for each in titles if each and not re.fullmatch(WORD, each)}, key=len, reverse=True)
    title = "|".join(re.escape(each) + r"(?!\w)" * each[-1].isalnum() for each in odd) or "(?!)"
    token = (
        rf"(?P<title>{title})|(?P<matrix>{WORD})?#(?P<place>\d+)|(?P<word>{WORD})(?P<call>\s*\()?"
        rf"|(?P<number>{NUMBER})|[-+*/(),\s]|(?P<rest>.+)"
    )
    plain = re.sub(token, replaced, text).strip()
    try:
        return _Reader(plain, names).read(ast.parse(plain, mode="eval").body)
    except SyntaxError as error:
        # At the end of the text the offset is 0.
        before = _restored(plain[: error.offset - 1] if error.offset else plain, names)
        place = f"behind {quoted(before)}" if before else "at its start"
        raise SwingupError(f"it cannot be read {place}: write it like 8*(goal1-pos1)") from error
    except (RecursionError, MemoryError) as error:
        raise SwingupError("it is too deep: use fewer parentheses") from error


def checked_number(text: str, minimum: float = 0.0) -> float:
    """A number of an expression."""
    value = float(text)
    if not minimum <= value <= LARGEST_FACTOR:
        raise SwingupError(f"use a number from {minimum:g} to {LARGEST_FACTOR:g} in place of {text[:40]}")
    return value


def _title_at(matrix: str, place: str, titles: Sequence[str]) -> str:
    """The title of a place, as #3, or of a matrix's column, as x#3, which is x3 among the titles."""
    if matrix and f"{matrix}{place}" in titles:
        return f"{matrix}{place}"
    number = int(place) if len(place) < 10 else 0
    if matrix or not 1 <= number <= len(titles):
        raise SwingupError(_unknown(f"{matrix}#{place}", titles))
    return f"#{number}"


def _unknown(word: str, titles: Sequence[str]) -> str:
    shown = quoted(", ".join(filter(None, titles)) or "without names", 200)
    return f"there is no column {quoted(word)}: its {len(titles)} columns are {shown[1:-1]}"


def _restored(text: str, names: Sequence[str]) -> str:
    return re.sub(r" _(\d+) ?", lambda found: names[int(found[1])], f" {text}").strip()


@dataclass(frozen=True)
class _Reader:
    """What the nodes of Python's syntax mean."""

    text: str
    names: Sequence[str]

    def read(self, node: ast.expr) -> Expression:  # noqa: RET503
        """The sum that a node stands for."""
        match node:
            case ast.Constant(value=int() | float() as value):
                return Expression((), float(value))
            case ast.Name("pi"):
                return Expression((), math.pi)
            case ast.Name(name):
                return Expression(((1.0, self.names[int(name[1:])]),))
            case ast.UnaryOp(ast.USub() | ast.UAdd() as sign, part):
                return self.read(part).times(-1.0 if isinstance(sign, ast.USub) else 1.0)
            case ast.BinOp(left, ast.Add() | ast.Sub() as sign, right):
                return self.read(left).plus(self.read(right).times(-1.0 if isinstance(sign, ast.Sub) else 1.0))
            case ast.BinOp(left, ast.Mult(), right):
                factors = self.read(left), self.read(right)
                for number, other in (factors, factors[::-1]):
                    if not number.terms:
                        return self._scaled(node, other, number.constant)
                self._refuse(node, "multiplies two columns: one of both is a number")
            case ast.BinOp(left, ast.Div(), right):
                divisor = self.read(right)
                if divisor.terms:
                    self._refuse(node, "divides by something else than a number")
                if not abs(divisor.constant) >= 1.0 / LARGEST_FACTOR:
                    self._refuse(node, "divides by 0, or nearly")
                return self._scaled(node, self.read(left), 1.0 / divisor.constant)
            case ast.Call(ast.Name(name), arguments, []) if name in FUNCTIONS:
                if len(arguments) != FUNCTIONS[name][1]:
                    self._refuse(node, f"needs {FUNCTIONS[name][1]} arguments")
                call = Call(name, tuple(map(self.read, arguments)))
                return Expression(((1.0, call),))
        self._refuse(node, "is not a sum of columns times numbers")

    def _scaled(self, node: ast.expr, part: Expression, factor: float) -> Expression:
        found = part.times(factor)
        if not max(abs(found.constant), *(abs(each) for each, _ in found.terms), 0.0) <= LARGEST_FACTOR:
            self._refuse(node, f"has a factor above {LARGEST_FACTOR:g}")
        return found

    def _refuse(self, node: ast.expr, reason: str) -> NoReturn:
        part = _restored(ast.get_source_segment(self.text, node) or self.text, self.names)
        raise SwingupError(f"{quoted(part)} {reason}")
