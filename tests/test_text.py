"""Foreign values in messages: always one short printable line."""

import os

import numpy as np
import pytest

from swingup.common.errors import SwingupError
from swingup.common.text import LONGEST_QUOTE, one_line, quoted


class Bad:
    def __init__(self, error):
        self.error = error

    def __str__(self):
        raise self.error

    __repr__ = __str__


class Long:
    def __repr__(self):
        return "ab\n" * 1_000_000


def nested(levels, width=9):
    """What nested aliases build: little memory, and a text of width ** levels entries."""
    value = ["lol"] * width
    for _ in range(levels):
        value = [value] * width
    return value


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
        (ValueError("two\nlines"), "two lines"),
        (Bad(RuntimeError("no")), "<Bad whose text raises RuntimeError>"),
        (Bad(SystemExit(3)), "<Bad whose text raises SystemExit>"),
        (b"bytes", "b'bytes'"),
    ],
)
def test_one_line(thing, text):
    assert one_line(thing) == text


def test_a_text_that_fails_is_named():
    assert quoted(Bad(KeyError("no"))).startswith("<Bad instance at 0x")


def test_one_line_is_cut():
    assert one_line("a" * 301) == "a" * 297 + "..."
    assert one_line("a" * 300) == "a" * 300
    assert len(one_line("\x00" * 300)) == 300  # escapes count too


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("a\nb", r"'a\nb'"),
        (0.1, "0.1"),
        (None, "None"),
        ([1, 2, 3], "[1, 2, 3]"),
        (list(range(100)), "[0, 1, 2, 3, 4, 5, ...]"),
        ({"a": [1]}, "{'a': [1]}"),
        (Bad(SystemExit("no")), "<Bad whose repr raises SystemExit>"),
    ],
)
def test_quoted(value, text):
    assert quoted(value) == text


@pytest.mark.parametrize(
    "value",
    [nested(8), "x" * 10**7, 10**4000, 10**5000, Long(), np.zeros((100, 100)), {str(k): k for k in range(10**5)}],
    ids=["nested", "text", "4000 digits", "5000 digits", "long", "array", "map"],
)
def test_quoted_is_short_and_costs_nothing(value):
    # nested(8) in full has 400 million entries: to build its text first would take all memory.
    text = quoted(value)
    assert len(text) <= LONGEST_QUOTE
    assert text.isprintable()


def test_messages_are_one_line_whatever_they_quote():
    error = SwingupError("no such file: a\nb\x1b[2J\udce9.csv")
    assert str(error) == r"no such file: a b\x1b[2J\udce9.csv"
    assert len(str(SwingupError("x" * 10**6))) == 2000
    str(error).encode()  # no surrogates are left
