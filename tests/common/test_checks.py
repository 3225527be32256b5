"""Numbers, names and foreign values in messages, always one short line; files, whole or not at all; YAML maps."""

import math
import os
import stat
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from refusals import refusal
from swingup.common.checks import finite_number, is_number, positive_number, whole_number
from swingup.common.errors import LONGEST_QUOTE, SwingupError, one_line, quoted
from swingup.common.files import make_folder, write_atomically
from swingup.common.yaml_map import LARGEST_YAML, read_map

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


def test_ranges_hold_their_ends_and_whole_numbers_are_pythons():
    assert finite_number("k", 2, 0.1, 2) == 2.0
    assert positive_number("k", 0.3, 0.3) == 0.3
    assert (whole_number("k", 0, 0), whole_number("k", 5, 0, 5)) == (0, 5)
    for check, *given in (
        (finite_number, 2.1, 0.1, 2, "s"), (finite_number, LyingInt(7), 0, 1), (positive_number, 0, 3, "N m"),
        (whole_number, -1, 0), (whole_number, 6, 0, 5), (whole_number, 2.5, 0),
    ):  # fmt: skip
        assert refusal(check, "k", *given).startswith("k = ")
    for value in (3, 3.0, np.int64(3), np.float64(3), Fraction(6, 2)):
        assert type(whole_number("k", value, 0)) is int
        assert whole_number("k", value, 0) == 3
    assert whole_number("k", 2**70 + 1, 0) == 2**70 + 1  # whole beyond floating point's 53 bits


def test_one_line():
    for thing, text in (
        ("plain  text\n\tin lines\r\n", "plain text in lines"),
        ("m² und 3 µs — ok", "m² und 3 µs — ok"),
        ("\x1b[31mred\x07", r"\x1b[31mred\x07"),
        ("\u202egnp.exe", r"\u202egnp.exe"),
        (os.fsdecode(b"caf\xe9.csv"), r"caf\udce9.csv"),
        ("\U000e0001", r"\U000e0001"),
        ("a\u2028b\x85c", "a b c"),
        (Bad(SystemExit(3)), "<Bad whose text raises SystemExit>"),
        ("a" * 301, "a" * 297 + "..."),
    ):
        assert one_line(thing) == text
    assert len(one_line("\x00" * 300)) == 300  # escapes count too


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


def test_links_keep_pointing_to_files_and_folders_and_a_mode_stays(tmp_path):
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_bytes(b"old")
    target.chmod(0o600)
    link.symlink_to(target)
    write_atomically(link, b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"
    assert stat.S_IMODE(target.stat().st_mode) == 0o600
    (tmp_path / "way").symlink_to("folder")
    make_folder(tmp_path / "way" / "new")
    assert (tmp_path / "folder" / "new").is_dir()


def test_a_name_may_be_as_long_as_the_system_allows(tmp_path):
    for name in ("x" * 255, "\N{GREEK SMALL LETTER PI}" * 127):
        write_atomically(tmp_path / name, b"new")
        assert (tmp_path / name).read_bytes() == b"new"
    assert "File name too long" in refusal(write_atomically, tmp_path / ("x" * 256), b"")
    assert "not the name of a file" in refusal(write_atomically, tmp_path / "a\0b", b"")


def test_a_device_is_written_to_and_not_replaced():
    write_atomically("/dev/null", b"gone")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_what_cannot_be_written_leaves_the_old_file_alone(tmp_path, monkeypatch):
    def full(file):
        raise OSError(28, "No space left on device")

    assert "cannot write" in refusal(write_atomically, tmp_path / "missing" / "file", b"")
    (tmp_path / "file").write_bytes(b"old")
    monkeypatch.setattr(os, "fsync", full)
    assert "No space left on device" in refusal(write_atomically, tmp_path / "file", b"new")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("file", b"old")]

    def interrupted(file):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(tmp_path / "file", b"new")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("file", b"old")]


def test_plain_values(tmp_path):
    text = "# a comment\nm1: 0.5 # kg\nl1: [0.1, 0.2]\nname: 'x'\nflag: true\nsmall: 4e-5\nrest: {a: 1, b: [2]}\n"
    (tmp_path / "m.yml").write_text(text)
    expected = {"m1": 0.5, "l1": [0.1, 0.2], "name": "x", "flag": True, "small": "4e-5", "rest": {"a": 1, "b": [2]}}
    assert read_map(tmp_path / "m.yml", "parameter") == expected


REFUSED = {
    "alias or an anchor": ["a: &x 1\nb: *x", "a: *x", "&a\nm1: 1\n<<: *a"],
    "has a tag": ["a: !!timestamp x", "a: !!python/object/apply:os.system ['true']", "!!set {a, b}", "a: !mine 5"],
    "neither a number nor text": ["a: 2001-99-99", "a: 0x_", "a: " + "9" * 5000],
    "deeper than 10 levels": ["a: " + "[" * 1500 + "]" * 1500, "{a: " * 1500 + "1" + "}" * 1500, "[" * 5000],
    "is not a map": ["- a\n- b\n- a", "5", "--- \n..."],
    "is not YAML": ["a: 1\n---\nb: 2", "? [a, b]\n: 1", "a: \x00"],
    "which is not a name": ["1: 2"],
    "2 times": ["a: 1\n'a': 2", '"x\\ny": 1\n"x\\ny": 2'],
    "is not UTF-8 text": [b"\xff\xfe\x00"],
    "more than 0.1 MB": [b"a: 1\n" + b"#" * LARGEST_YAML],
}


def test_all_else_is_refused_in_one_line(tmp_path, monkeypatch):
    for reason, texts in REFUSED.items():
        for text in texts:
            (tmp_path / "m.yml").write_bytes(text if isinstance(text, bytes) else text.encode())
            told = refusal(read_map, tmp_path / "m.yml", "parameter")
            assert reason in told
            assert len(told) < 700
    once_hung_or_crashed = [*(Path(__file__).parents[1] / "data").glob("*.yml")]
    assert len(once_hung_or_crashed) == 7
    monkeypatch.chdir(tmp_path)
    for path in (*once_hung_or_crashed, "none.yml", "", ".", "a\x00b", "x" * 5000, "/dev/zero"):
        refusal(read_map, path, "domain")
