"""Columns of a table in terms of a file's, as in q1=theta1+180:deg, and their units.

A word maps one column, NAME=EXPRESSION[:UNIT]. The expression adds and subtracts titles of the file (or #3, its
third column), as they are or times a number, and numbers or pi. The unit applies to the whole expression; without
one it is SI's.
"""

import contextlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from .errors import SwingupError, naming, quoted

DEGREE, TURN = math.pi / 180, 2 * math.pi
UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "pos": {"rad": 1.0, "deg": DEGREE, "turns": TURN, "mrad": 1e-3},
    "vel": {"rad/s": 1.0, "deg/s": DEGREE, "rpm": TURN / 60, "turns/s": TURN, "mrad/s": 1e-3},
    "tau": {
        "N m": 1.0, "mNm": 1e-3, "uNm": 1e-6, "Ncm": 1e-2, "ozin": 0.00706155, "kgcm": 0.0980665,
        "lbin": 0.112985, "lbft": 1.355818, "A": 1.0, "mA": 1e-3, "%": 1e-2,
    },
}  # fmt: skip
"""Units of columns whose names start so, and their sizes in SI units; the first is SI's."""
NEEDS_CONSTANT = ("a", "ma", "%")
"""Currents, which a torque constant (N m/A) multiplies, as A*0.7, and shares of a torque (N m), as %*6."""
SPELLINGS = {
    "sec": "s", "second": "s", "seconds": "s", "msec": "ms", "µs": "us", "μs": "us", "usec": "us", "nsec": "ns",
    "radian": "rad", "radians": "rad", "degree": "deg", "degrees": "deg", "grad": "deg", "°": "deg",
    "turn": "turns", "rev": "turns", "revs": "turns", "revolutions": "turns", "umdrehungen": "turns",
    "rad/sec": "rad/s", "rads-1": "rad/s", "degs-1": "deg/s", "deg/sec": "deg/s", "°/s": "deg/s",
    "degrees/s": "deg/s", "grad/s": "deg/s",
    "1/min": "rpm", "min-1": "rpm", "u/min": "rpm", "rev/min": "rpm", "rev/s": "turns/s", "turn/s": "turns/s",
    "rps": "turns/s", "nmm": "mnm", "µnm": "unm", "μnm": "unm",
    "kgfcm": "kgcm", "ozfin": "ozin", "lbfin": "lbin", "inlb": "lbin", "lbfft": "lbft", "ftlb": "lbft",
    "percent": "%", "pct": "%",
}  # fmt: skip
"""Other spellings, without spaces, points, hyphens and capitals."""


NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"  # in an expression, as 1e-9
LARGEST_FACTOR, SMALLEST_UNIT = 1e21, 1e-15
"""Times since 1970 in nanoseconds have 19 digits, and no unit of a pendulum comes near either."""
SHORT_NAMES = {
    f"{short}{joint}": f"{long}{joint}"
    for short, long in (("q", "pos_meas"), ("dq", "vel_meas"), ("u", "tau_con"))
    for joint in (1, 2)
} | {"t": "time"}
"""Short names of RealAIGym's columns."""
SHORT = {long: short for short, long in SHORT_NAMES.items() if short != "t"}


@dataclass(frozen=True)
class MappedColumn:
    """One column in terms of a file's."""

    terms: tuple[tuple[float, str], ...]  # Factors, mostly signs, and titles; "#3" is the third column
    constant: float = 0.0  # What is added, in the unit
    unit: str = ""  # The unit as the user wrote it; SI without one

    def word(self, name: str) -> str:
        """The word that maps a column to this one."""
        text = "".join(
            "+-"[factor < 0] + title + f"*{abs(factor):.10g}" * (abs(factor) != 1) for factor, title in self.terms
        ).removeprefix("+")
        if self.constant:
            size = abs(self.constant)
            pi = next((word for word in ("pi", "pi/2") if abs(size - _value(word)) < 1e-9), "")
            text += "+-"[self.constant < 0] + (pi or f"{size:.10g}")
        return f"{SHORT.get(name, name)}={text or '0'}{self.unit and ':' + self.unit.replace(' ', '')}"

    def signed(self, sign: int) -> "MappedColumn":
        """This column, or its negative."""
        terms = tuple((sign * factor, title) for factor, title in self.terms)
        return replace(self, terms=terms, constant=sign * self.constant)


def unit_size(name: str, unit: str) -> float:
    """The size of a unit of the column of this name, in SI units: deg, counts/4096, or A*0.7 with a factor."""
    accepted = next((units for start, units in UNITS.items() if name.startswith(start)), {})
    base, factor = re.fullmatch(rf"(.*?)(?:\*({NUMBER}))?", unit.strip(), re.DOTALL).groups()  # type: ignore[union-attr]
    # Of N*m and N-m the letters tell the unit. A star that stays, as in A*0.7.1, makes it unknown.
    plain = re.sub(r"[\s·.^]|[-*](?=[^\W\d])", "", base).lower()
    plain = SPELLINGS.get(plain, plain)
    sizes = {re.sub(r"\s", "", each).lower(): size for each, size in accepted.items()} | {"": 1.0}
    counts = re.fullmatch(r"(?:counts?|ticks?|inc)/(\d{1,9})(/s)?", plain)
    if counts and int(counts[1]) and name.startswith("vel" if counts[2] else "pos"):
        size = TURN / int(counts[1])
    elif plain in sizes and (factor or plain not in NEEDS_CONSTANT):
        size = sizes[plain]
    else:
        known = [each + "*CONSTANT" * (each.lower() in NEEDS_CONSTANT) for each in accepted]
        known += ["counts/4096"] if name.startswith("pos") else []
        raise SwingupError(f"{SHORT.get(name, name)} in {quoted(unit, 20)}: the units are {', '.join(known)}")
    with naming(f"{SHORT.get(name, name)} in {quoted(unit, 20)}"):
        return size * _value(factor or "1", SMALLEST_UNIT)


def is_unit(text: str) -> bool:
    """Whether a text is a unit of some column."""
    for start in UNITS:
        with contextlib.suppress(SwingupError):
            return unit_size(start, f"{text}*1") > 0.0
    return False


def unit_of(quantity: str, size: float, within: float = 1e-9) -> str:
    """The unit of this size (rad and so on: the key of ``UNITS``): a name, counts, or SI's unit with a factor."""
    units = UNITS[quantity]
    nearest = min(units, key=lambda each: abs(math.log(units[each] / size)))
    if abs(math.log(units[nearest] / size)) <= within and nearest.lower() not in NEEDS_CONSTANT:
        return nearest
    counts = TURN / size
    if quantity == "pos" and abs(counts - round(counts)) < 1e-6 * counts:
        return f"counts/{round(counts)}"
    return f"{next(iter(units))}*{size:.6g}"


def parse_columns(path: object, words: Sequence[str], titles: Sequence[str]) -> dict[str, MappedColumn]:
    """Columns by name, from words NAME=EXPRESSION[:UNIT], or from names in the columns' order, with _ for none."""
    found = {}
    for number, word in enumerate(words, start=1):
        name, equals, text = word.partition("=")
        name = SHORT_NAMES.get(name, name)
        column = _parse_column(path, name, text if equals else str(number), titles)
        if name != "_":
            found[name] = column
    return found


def _parse_column(path: object, name: str, text: str, titles: Sequence[str]) -> MappedColumn:
    """A column from the expression and unit of a word."""
    if text in titles:  # whatever signs the title has
        return MappedColumn(((1, text),))
    expression, _, unit = text.rpartition(":") if ":" in text else (text, "", "")
    if expression.isdecimal() and _is_place(expression, titles):
        expression = f"#{expression}"
    with naming(f"{SHORT.get(name, name)} from {quoted(expression, 40)}"):
        parsed = _parse_sum(expression, titles)
    # A torque may be zero throughout; nothing else is constant.
    if parsed is None or not (parsed.terms or (name.startswith("tau") and expression == "0")):
        raise SwingupError(
            f"{path} has no column {quoted(text[:40])}: its {len(titles)} columns are "
            f"{', '.join(filter(None, titles)) or 'without names'}; write NAME=TITLE, NAME=TITLE:UNIT, NAME=3 for "
            "the third, or names in the columns' order"
        )
    unit_size(name, unit)  # refuses an unknown one
    return replace(parsed, unit=unit)


def _parse_sum(expression: str, titles: Sequence[str]) -> MappedColumn | None:
    """The terms and the constant of an expression; None if it is not a sum of titles and numbers."""
    known = "|".join(re.escape(title) for title in sorted(set(titles) - {""}, key=len, reverse=True))
    summand = re.compile(rf"\s*([-+]?)\s*(?:({known or '(?!)'}|#\d+)(?:\*({NUMBER}))?|(pi(?:/[1-9]\d*)?|{NUMBER}))")
    terms, constant, place = list[tuple[float, str]](), 0.0, 0
    while place < len(expression):
        found = summand.match(expression, place)
        if found is None or (place and not found[1]):
            return None
        sign, title, factor, number = found.groups()
        if title and title not in titles and not _is_place(title[1:], titles):
            return None
        value = (-1 if sign == "-" else 1) * _value(number or factor or "1")
        if title:
            terms.append((value, title))
        else:
            constant += value
        place = found.end()
    return MappedColumn(tuple(terms), constant)


def _is_place(text: str, titles: Sequence[str]) -> bool:
    return 1 <= int(text[:9]) <= len(titles)


def _value(text: str, minimum: float = 0.0) -> float:
    """A number of an expression: digits, or a part of pi."""
    pi, _, part = text.partition("/")
    value = math.pi / float(part or 1) if pi == "pi" else float(text)
    if not minimum <= value <= LARGEST_FACTOR:
        raise SwingupError(f"use a number from {minimum:g} to {LARGEST_FACTOR:g} in place of {text[:40]}")
    return value


_KINDS = {
    "time": r"time|zeit|stamp|^t$|^t[_ ]|^ts$|^sec|^n(ano)?sec",
    "dq": r"vel|omega|speed|dot|geschw|drehzahl|rpm|^d(q|th|phi)|^qd|^w_?\d?$|rate",
    "u": r"tau|torque|moment|effort|current|strom|^u|^[im]_?\d|^iq|cmd|amp",
    "q": r"pos|ang|theta|phi|winkel|^q|^th|enc|gelenk|joint",
}
"""Words in the titles that people give, tried in order."""
_WANTED = re.compile(r"des|ref|goal|soll|target|filt")
"""A title with one of these comes after others like it: it was not measured."""
_STAMP = (r"(^|[^no])secs?$", r"n(ano)?secs?$")
"""Ends of ROS's titles for the seconds and nanoseconds of a time."""
_JOINTS = {"1": r"shoulder|schulter|upper|first", "2": r"elbow|ell|lower|second"}


def suggest_columns(titles: Sequence[str], names: Sequence[str]) -> list[str]:
    """Words that map the columns of these names, as far as other people's titles tell them."""
    likely: dict[str, MappedColumn] = {}
    kinds = {title: _kind_of(title) for title in titles}
    for kind in _KINDS:
        mine = [title for title in titles if kinds[title] == kind]
        mine.sort(key=lambda title: bool(_WANTED.search(title)))
        # ROS counts seconds and the nanoseconds beyond them apart.
        whole, rest = (next((t for t in mine if re.search(end, t.lower())), "") for end in _STAMP)
        if kind == "time" and whole and rest:
            likely["time"] = MappedColumn(((1, whole), (1e-9, rest)))
        digits = {title: (re.findall(r"\d+", title) or [""])[-1] for title in mine}
        shift = 1 if "0" in digits.values() else 0
        for place, title in enumerate(mine, start=1):
            joint = next((j for j, word in _JOINTS.items() if re.search(word, title.lower())), "")
            joint = joint or (str(int(digits[title][:6]) + shift) if digits[title] else str(place))
            short = kind if kind == "time" else kind + joint
            name = SHORT_NAMES.get(short, short)
            likely.setdefault(name, MappedColumn(((1, title),), 0.0, _unit_at_end(name, title)))
    return [likely[name].word(name) for name in names if name in likely]


def _kind_of(title: str) -> str:
    """The kind of quantity that a title names; of meas.q1 the last name tells it where the whole does not."""
    words = title.lower(), title.lower().rpartition(".")[2]
    return next((kind for text in words for kind, word in _KINDS.items() if re.search(word, text)), "")


def _unit_at_end(name: str, title: str) -> str:
    """A unit at a title's end, as in theta1_deg."""
    words = re.split(r"[_ ]", title)
    for unit in (words[-1], "/".join(words[-2:]), words[-1].lower().removesuffix("s") + "/s"):
        with contextlib.suppress(SwingupError):
            return "" if len(words) == 1 or unit_size(name, unit) == 1.0 else unit
    return ""
