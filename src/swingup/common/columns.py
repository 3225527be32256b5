"""Columns of a table in terms of a file's: signs, sums, a constant and a unit, as in q1=theta1+180:deg.

A word maps one column, NAME=EXPRESSION[:UNIT]. The expression adds and subtracts titles of the file (or #3, its
third column), as they are or times a number, and numbers or pi; all is in the unit, and in SI units without one.
"""

import contextlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from .errors import SwingupError, quoted

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

NUMBER = r"\d+(?:\.\d*)?(?:[eE]-?\d+)?"
"""In an expression, as 1e-9."""
SHORT_NAMES = {
    f"{short}{joint}": f"{long}{joint}"
    for short, long in (("q", "pos_meas"), ("dq", "vel_meas"), ("u", "tau_con"))
    for joint in (1, 2)
} | {"t": "time"}
"""Short names of RealAIGym's columns."""
SHORT = {long: short for short, long in SHORT_NAMES.items() if short != "t"}


@dataclass(frozen=True)
class Column:
    """One column in terms of a file's."""

    terms: tuple[tuple[float, str], ...]
    """Factors, mostly signs, and titles; "#3" is the third column."""
    constant: float = 0.0
    """What is added, in the unit."""
    unit: str = ""
    """As it was written; SI without one."""

    def word(self, name: str) -> str:
        """The word that maps a column to this one."""
        text = "".join(
            "+-"[factor < 0] + title + f"*{abs(factor):.10g}" * (abs(factor) != 1) for factor, title in self.terms
        ).removeprefix("+")
        if self.constant:
            text += _constant(self.constant)
        return f"{SHORT.get(name, name)}={text or '0'}{self.unit and ':' + self.unit.replace(' ', '')}"

    def signed(self, sign: int) -> "Column":
        """This column, or its negative."""
        return replace(
            self, terms=tuple((sign * each, title) for each, title in self.terms), constant=sign * self.constant
        )


def unit_size(name: str, unit: str) -> float:
    """The size of a unit of the column of this name, in SI units: deg, counts/4096, or A*0.7 with a factor."""
    accepted = next((units for start, units in UNITS.items() if name.startswith(start)), {})
    base, factor = re.fullmatch(r"(.*?)(?:\*([\d.]+(?:[eE][-+]?\d+)?))?", unit.strip(), re.DOTALL).groups()  # type: ignore[union-attr]
    plain = re.sub(r"[\s·.*^]|-(?=[^\W\d])", "", base).lower()
    plain = SPELLINGS.get(plain, plain)
    sizes = {re.sub(r"\s", "", each).lower(): size for each, size in accepted.items()}
    counts = re.fullmatch(r"(?:counts?|ticks?|inc)/(\d{1,9})(/s)?", plain)
    if counts and int(counts[1]) and name.startswith("vel" if counts[2] else "pos"):
        size = TURN / int(counts[1])
    elif plain in sizes and (factor or plain not in NEEDS_CONSTANT):
        size = sizes[plain]
    elif not plain:
        size = 1.0
    else:
        known = [each + "*CONSTANT" * (each.lower() in NEEDS_CONSTANT) for each in accepted]
        known += ["counts/4096"] if name.startswith("pos") else []
        raise SwingupError(f"{SHORT.get(name, name)} in {quoted(unit, 20)}: the units are {', '.join(known)}")
    return size * float(factor or 1.0)


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


def parse_column(path: object, name: str, text: str, titles: Sequence[str]) -> Column:
    """A column from the expression and unit of a word."""
    if text in titles:
        return Column(((1, text),))
    expression, _, unit = text.rpartition(":") if ":" in text else (text, "", "")
    if text.isdecimal() or expression.isdecimal():  # a place
        expression = f"#{expression or text}" if 1 <= int((expression or text)[:9]) <= len(titles) else expression
    known = "|".join(re.escape(title) for title in sorted(set(titles) - {""}, key=len, reverse=True))
    token = re.compile(rf"\s*([-+]?)\s*(?:({known or '(?!)'}|#\d+)(?:\*({NUMBER}))?|(pi(?:/[1-9]\d*)?|{NUMBER}))")
    terms, constant, place = list[tuple[float, str]](), 0.0, 0
    while place < len(expression):
        found = token.match(expression, place)
        if found is None or (place and not found[1]):
            raise _missing(path, text, titles)
        sign = -1 if found[1] == "-" else 1
        if found[2]:
            if found[2] not in titles and not 1 <= int(found[2][1:10]) <= len(titles):
                raise _missing(path, text, titles)
            terms.append((sign * float(found[3] or 1), found[2]))
        else:
            pi, _, part = found[4].partition("/")
            value = math.pi / float(part or 1) if pi == "pi" else float(found[4])
            constant += sign * value
        place = found.end()
    # A torque may be zero throughout; nothing else is constant.
    if not terms and not (name.startswith("tau") and expression == "0"):
        raise _missing(path, text, titles)
    unit_size(name, unit)  # refuses an unknown one
    return Column(tuple(terms), constant, unit)


def parse_columns(path: object, words: Sequence[str], titles: Sequence[str]) -> dict[str, Column]:
    """Columns by name, from words NAME=EXPRESSION[:UNIT], or from names in the columns' order, with _ for none."""
    found = {}
    for number, word in enumerate(words, start=1):
        name, equals, text = word.partition("=")
        name = SHORT_NAMES.get(name, name)
        column = parse_column(path, name, text if equals else str(number), titles)
        if name != "_":
            found[name] = column
    return found


def _missing(path: object, text: str, titles: Sequence[str]) -> SwingupError:
    return SwingupError(
        f"{path} has no column {quoted(text[:40])}: its {len(titles)} columns are "
        f"{', '.join(filter(None, titles)) or 'without names'}; write NAME=TITLE, NAME=TITLE:UNIT, NAME=3 for the "
        "third, or names in the columns' order"
    )


def _constant(value: float) -> str:
    for part in (1, 2):
        if abs(abs(value) - math.pi / part) < 1e-9:
            return "+-"[value < 0] + ("pi" if part == 1 else f"pi/{part}")
    return f"{value:+.10g}"


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
    likely: dict[str, Column] = {}

    def kind_of(title: str) -> str:
        # Of meas.q1 the last name tells where the whole does not.
        words = title.lower(), title.lower().rpartition(".")[2]
        return next((k for text in words for k, word in _KINDS.items() if re.search(word, text)), "")

    kinds = {title: kind_of(title) for title in titles}
    for kind in _KINDS:
        mine = sorted(
            (title for title in titles if kinds[title] == kind), key=lambda title: bool(_WANTED.search(title))
        )
        # ROS counts seconds and the nanoseconds beyond them apart.
        whole, rest = (next((t for t in mine if re.search(end, t.lower())), "") for end in _STAMP)
        if kind == "time" and whole and rest:
            likely["time"] = Column(((1, whole), (1e-9, rest)))
        digits = {title: (re.findall(r"\d+", title) or [""])[-1] for title in mine}
        shift = 1 if "0" in digits.values() else 0
        for place, title in enumerate(mine, start=1):
            joint = next((j for j, word in _JOINTS.items() if re.search(word, title.lower())), "")
            joint = joint or (str(int(digits[title][:6]) + shift) if digits[title] else str(place))
            short = kind if kind == "time" else kind + joint
            name = SHORT_NAMES.get(short, short)
            likely.setdefault(name, Column(((1, title),), 0.0, _ending(name, title)))
    return [likely[name].word(name) for name in names if name in likely]


def _ending(name: str, title: str) -> str:
    """A unit at a title's end, as in theta1_deg."""
    words = re.split(r"[_ ]", title)
    if len(words) == 1:
        return ""
    for unit in (words[-1], "/".join(words[-2:]), words[-1].lower().removesuffix("s") + "/s"):
        try:
            return "" if unit_size(name, unit) == 1.0 else unit
        except SwingupError:
            continue
    return ""
