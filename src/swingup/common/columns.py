"""Columns of a table in terms of a file's, as in q1=theta1+180:deg, and their units.

A word maps one column, NAME=EXPRESSION[:UNIT] (``expressions``). The unit applies to the whole expression; without
one it is SI's. A torque may be the number 0, and the time a period, as in time=0.02.
"""

import contextlib
import math
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .errors import SwingupError, naming, quoted
from .expressions import NUMBER, Call, Expression, checked_number, parse_expression

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


SMALLEST_UNIT = 1e-15  # no unit of a pendulum comes near it
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

    expression: Expression
    unit: str = ""  # The unit as the user wrote it; SI without one

    def word(self, name: str) -> str:
        """The word that maps a column to this one."""
        return f"{SHORT.get(name, name)}={self.expression}{self.unit and ':' + self.unit.replace(' ', '')}"


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
        return size * checked_number(factor or "1", SMALLEST_UNIT)


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
    if text and text in titles:  # whatever signs the title has
        return MappedColumn(Expression(((1, text),)))
    expression, _, unit = text.rpartition(":") if ":" in text else (text, "", "")
    if expression.isdecimal() and 1 <= int(expression[:9]) <= len(titles):
        expression = f"#{expression}"
    with naming(f"{path}: {SHORT.get(name, name)} from {quoted(expression, 40)}"):
        parsed = parse_expression(expression, titles)
        is_period = name == "time" and parsed.constant > 0
        if not (parsed.terms or is_period or (name.startswith("tau") and parsed.constant == 0)):
            raise SwingupError(
                "it is a number: write NAME=TITLE, NAME=TITLE:UNIT, NAME=3 for the third column, or names in the "
                "columns' order"
            )
    unit_size(name, unit)  # refuses an unknown one
    return MappedColumn(parsed, unit)


_KINDS = {
    "time": r"time|zeit|stamp|^t$|^t[_ ]|^ts$|^sec|^n(ano)?sec",
    "dq": r"vel|omega|speed|dot|geschw|drehzahl|rpm|^d(q|th|phi)|^qd|^w_?\d?$|rate",
    "u": r"tau|torque|moment|effort|current|strom|^u|^[im]_?\d|^iq|cmd|amp|duty|pwm",
    "q": r"pos|ang|theta|phi|winkel|^q|^th|enc|gelenk|joint|^(shoulder|elbow|schulter|ell(en)?bogen)$",
}
"""Words in the titles that people give, tried in order."""
_WANTED = re.compile(r"des|ref|goal|soll|target|filt|motor_?side")
"""A title with one of these comes after others like it: it was not measured, or not at the joint."""
_GOAL = r"goal|target|setpoint|soll|des|ref"
_STAMP = (r"(^|[^no])secs?$", r"n(ano)?secs?$")
"""Ends of ROS's titles for the seconds and nanoseconds of a time."""
NO_LABELS: Mapping[str, str] = {}
_JOINTS = {"1": r"shoulder|schulter|upper|first", "2": r"elbow|ell|lower|second"}


def suggest_columns(
    titles: Sequence[str], names: Sequence[str], labels: Mapping[str, str] = NO_LABELS
) -> list[str]:
    """Words that map the columns of these names, as far as other people's titles tell them.

    ``labels`` are joints' names by title, where the rows say them, as those of ROS do.
    """
    likely: dict[str, MappedColumn] = {}
    # A camera has an angle's sine and cosine.
    cosines = {
        title: other for title in titles if (other := title.replace("sin", "cos")) != title and other in titles
    }
    kinds = {title: "q" if title in cosines else _kind_of(title) for title in titles}
    for kind in _KINDS:
        mine = [title for title in titles if kinds[title] == kind and title not in cosines.values()]
        mine.sort(key=lambda title: bool(_WANTED.search(title)))
        # ROS counts seconds and the nanoseconds beyond them apart.
        whole, rest = (next((t for t in mine if re.search(end, t.lower())), "") for end in _STAMP)
        if kind == "time" and whole and rest:
            likely["time"] = MappedColumn(Expression(((1, whole), (1e-9, rest))))
        told = {title: labels.get(title, title).lower() for title in mine}
        digits = {title: (re.findall(r"\d+", told[title]) or [""])[-1] for title in mine}
        shift = 1 if "0" in digits.values() else 0
        for place, title in enumerate(mine, start=1):
            joint = next((j for j, word in _JOINTS.items() if re.search(word, told[title])), "")
            joint = joint or (str(int(digits[title][:6]) + shift) if digits[title] else "")
            if kind == "u" and not joint and len(mine) == 1:  # the joint that it drives is its user's to say
                continue
            joint = joint or str(place)
            short = kind if kind == "time" else kind + joint
            name = SHORT_NAMES.get(short, short)
            atom: str | Call = title
            if title in cosines:
                atom = Call("atan2", tuple(Expression(((1, each),)) for each in (title, cosines[title])))
            likely.setdefault(name, MappedColumn(Expression(((1, atom),)), _unit_at_end(name, title)))
    # A matrix of states, and perhaps one of torques.
    matrices = {title[:-1]: title[-1:] for title in titles if title[-1:].isdecimal() and not kinds[title]}
    matrices = {stem: width for stem, width in matrices.items() if f"{stem}1" in titles}
    if [*matrices.values()].count("4") == 1:
        for stem, width in matrices.items():
            names_of = {"4": ("pos_meas1", "pos_meas2", "vel_meas1", "vel_meas2"), "2": ("tau_con1", "tau_con2")}
            for place, name in enumerate(names_of.get(width, ()), start=1):
                likely.setdefault(name, MappedColumn(Expression(((1, f"{stem}{place}"),))))
    rates = {"vel_meas1", "vel_meas2"}
    if not rates <= likely.keys():  # the rate of one joint alone is not read
        likely = {name: column for name, column in likely.items() if name not in rates}
    return [likely[name].word(name) for name in names if name in likely]


def completed(words: Sequence[str], given: Sequence[str]) -> str:
    """Words of --columns as a user types them: those given before, but for the names that are mapped anew."""
    anew = {"_", *(word.partition("=")[0] for word in words)}
    before = [word if "=" in word else f"{word}={place}" for place, word in enumerate(given, start=1)]
    return shlex.join([*(word for word in before if word.partition("=")[0] not in anew), *words])


def lone_torque(titles: Sequence[str]) -> str | None:
    """The title of a torque, where there is one alone."""
    found = [title for title in titles if _kind_of(title) == "u"]
    return found[0] if len(found) == 1 else None


def find_goals(titles: Sequence[str]) -> tuple[str, str] | None:
    """Titles of both servos' goals, in the order of their digits; None without two."""
    found = sorted(title for title in titles if re.search(_GOAL, title.lower()) and _kind_of(title) in ("", "q"))
    return (found[0], found[1]) if len(found) == 2 else None


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
