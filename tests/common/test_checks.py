"""Checks of numbers and names, and foreign values in messages: always one short printable line."""

import math
import os
from fractions import Fraction

import numpy as np
import pytest

from refusals import refusal
from swingup.common.checks import finite_number, is_number, one_of, positive_number, suggestion, whole_number
from swingup.common.errors import SwingupError
from swingup.common.text import LONGEST_QUOTE, one_line, quoted

NO_NUMBERS = [None, True, np.True_, "1", b"1", [1], {}, math.nan, math.inf, -math.inf, 1j, 10**400, object()]


class Bad:
    def __init__(self, error):
        self.error = error

    def __str__(self):
        raise self.error

    __repr__ = __str__


class LyingInt(int):
    """Its text is not to be relied on."""

    def __repr__(self):
        raise RuntimeError("no")


def test_what_is_a_number():
    for value in NO_NUMBERS:
        assert not is_number(value)
        for check in (finite_number, positive_number, lambda name, value: whole_number(name, value, 0)):
            text = refusal(check, "width", value)
            assert text.startswith("width = ")
            assert len(text) < 200
    for value in (0, 1, 2.5, np.float32(0.5), np.int8(3), Fraction(1, 2), -1e9):
        assert is_number(value)
        number = finite_number("width", value)
        assert (type(number), number) == (float, value)


def test_ranges_hold_their_ends():
    assert finite_number("k", 2, 0.1, 2) == 2.0
    assert positive_number("k", 0.3, 0.3) == 0.3
    assert (whole_number("k", 0, 0), whole_number("k", 5, 0, 5)) == (0, 5)
    for refuse in (
        lambda: finite_number("k", 2.1, 0.1, 2, "s"),
        lambda: positive_number("k", 0, 3, "N m"),
        lambda: whole_number("k", -1, 0),
        lambda: whole_number("k", 6, 0, 5),
        lambda: whole_number("k", 2.5, 0),
        lambda: finite_number("k", LyingInt(7), 0, 1),
    ):
        assert refusal(refuse).startswith("k = ")


def test_whole_numbers_are_pythons():
    for value in (3, 3.0, np.int64(3), np.float64(3), Fraction(6, 2)):
        assert type(whole_number("k", value, 0)) is int
        assert whole_number("k", value, 0) == 3
    assert whole_number("k", 2**70 + 1, 0) == 2**70 + 1  # whole beyond floating point's 53 bits


def test_one_of():
    assert one_of("colour", "red", ["red", "green"]) == "red"
    known = "unknown colour 'gren': use one of red, green; did you mean green?"
    assert refusal(one_of, "colour", "gren", iter(["red", "green"])) == known
    for value in ("zzz", None, 3, ["red"], {"red": 1}):
        assert refusal(one_of, "colour", value, ["red", "green"], " or a code").endswith(" or a code")
    assert suggestion("x", ["learning_rate"]) == suggestion(3, ["3"]) == ""


@pytest.mark.parametrize(
    ("thing", "text"),
    [
        ("plain  text\n\tin lines\r\n", "plain text in lines"),
        ("m² und 3 µs — ok", "m² und 3 µs — ok"),
        ("\x1b[31mred\x07", r"\x1b[31mred\x07"),
        ("\u202egnp.exe", r"\u202egnp.exe"),
        (os.fsdecode(b"caf\xe9.csv"), r"caf\udce9.csv"),
        ("\U000e0001", r"\U000e0001"),
        ("a\u2028b\x85c", "a b c"),
        (Bad(SystemExit(3)), "<Bad whose text raises SystemExit>"),
        ("a" * 301, "a" * 297 + "..."),
    ],
)
def test_one_line(thing, text):
    assert one_line(thing) == text
    assert len(one_line("\x00" * 300)) == 300  # escapes count too


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("a\nb", r"'a\nb'"),
        (0.1, "0.1"),
        (list(range(100)), "[0, 1, 2, 3, 4, 5, ...]"),
        ({"a": [1]}, "{'a': [1]}"),
        (Bad(SystemExit("no")), "<Bad whose repr raises SystemExit>"),
    ],
)
def test_quoted(value, text):
    assert quoted(value) == text


def test_quoted_is_short_and_costs_nothing():
    nested = ["lol"] * 9
    for _ in range(8):
        nested = [nested] * 9  # 400 million entries in full: to build its text first would take all memory
    for value in (nested, "x" * 10**7, 10**4000, 10**5000, np.zeros((100, 100)), {str(k): k for k in range(10**5)}):
        text = quoted(value)
        assert len(text) <= LONGEST_QUOTE
        assert text.isprintable()


def test_messages_are_one_line_whatever_they_quote():
    error = SwingupError("no such file: a\nb\x1b[2J\udce9.csv")
    assert str(error) == r"no such file: a b\x1b[2J\udce9.csv"
    assert len(str(SwingupError("x" * 10**6))) == 2000
