"""Checks of numbers and names: what they let through, and how they say no."""

import math
from fractions import Fraction

import numpy as np
import pytest

from swingup.common.checks import finite_number, is_number, one_of, positive_number, suggestion, whole_number
from swingup.common.errors import SwingupError

NO_NUMBERS = [None, True, np.True_, "1", b"1", [1], {}, math.nan, math.inf, -math.inf, 1j, 10**400, object()]


class LyingInt(int):
    """Its text is not to be relied on."""

    def __repr__(self):
        raise RuntimeError("no")


@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda value: type(value).__name__)
def test_what_is_no_number(value):
    assert not is_number(value)
    for check in (finite_number, positive_number):
        with pytest.raises(SwingupError, match=r"^width = .*: use a .*number") as error:
            check("width", value)
        assert "\n" not in str(error.value)
        assert len(str(error.value)) < 200
    with pytest.raises(SwingupError, match="use a whole number"):
        whole_number("width", value, 0)


@pytest.mark.parametrize("value", [0, 1, 2.5, np.float32(0.5), np.int8(3), Fraction(1, 2), -1e9])
def test_what_is_a_number(value):
    assert is_number(value)
    number = finite_number("width", value)
    assert type(number) is float
    assert number == value


def test_ranges_hold_their_ends():
    assert finite_number("k", 2, 0.1, 2) == 2.0
    assert positive_number("k", 0.3, 0.3) == 0.3
    assert (whole_number("k", 0, 0), whole_number("k", 5, 0, 5)) == (0, 5)
    with pytest.raises(SwingupError, match=r"^k = 2\.1: use a number from 0\.1 to 2 s$"):
        finite_number("k", 2.1, 0.1, 2, "s")
    with pytest.raises(SwingupError, match=r"^k = 0: use a positive number up to 3 N m$"):
        positive_number("k", 0, 3, "N m")
    with pytest.raises(SwingupError, match=r"^k = -1: use a whole number of at least 0$"):
        whole_number("k", -1, 0)
    with pytest.raises(SwingupError, match=r"^k = 6: use a whole number from 0 to 5$"):
        whole_number("k", 6, 0, 5)


def test_whole_numbers_are_pythons():
    for value in (3, 3.0, np.int64(3), np.float64(3), Fraction(6, 2)):
        assert type(whole_number("k", value, 0)) is int
        assert whole_number("k", value, 0) == 3
    with pytest.raises(SwingupError, match=r"k = 2\.5: use a whole number"):
        whole_number("k", 2.5, 0)
    assert whole_number("k", 2**70, 0) == 2**70  # whole beyond floating point's 53 bits
    assert whole_number("k", 2**70 + 1, 0) == 2**70 + 1


def test_a_number_whose_text_fails():
    with pytest.raises(SwingupError, match=r"^k = <LyingInt instance at 0x[0-9a-f]+>: use a number from 0"):
        finite_number("k", LyingInt(7), 0, 1)


def test_one_of():
    assert one_of("colour", "red", ["red", "green"]) == "red"
    with pytest.raises(SwingupError, match=r"^unknown colour 'gren': use one of red, green; did you mean green\?$"):
        one_of("colour", "gren", iter(["red", "green"]))
    with pytest.raises(SwingupError, match=r"^unknown colour 'zzz': use one of red, green or a code$"):
        one_of("colour", "zzz", ["red", "green"], " or a code")
    for value in (None, 3, ["red"], {"red": 1}):
        with pytest.raises(SwingupError, match="unknown colour"):
            one_of("colour", value, ["red", "green"])


def test_suggestions():
    assert suggestion("learning_rat", ["learning_rate", "gamma"]) == "; did you mean learning_rate?"
    assert suggestion("x", ["learning_rate"]) == suggestion(3, ["3"]) == ""
