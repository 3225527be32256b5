"""Flat YAML maps: plain values only, whatever else YAML can do."""

from pathlib import Path

import pytest

from swingup.common.errors import SwingupError
from swingup.common.yaml_map import LARGEST_YAML, read_map

DATA = Path(__file__).parent / "data"
FIXTURES = sorted(DATA.glob("*.yml"))


def write(tmp_path, text):
    path = tmp_path / "m.yml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_plain_values(tmp_path):
    text = "# a comment\nm1: 0.5 # kg\nl1: [0.1, 0.2]\nname: 'x'\nflag: true\nsmall: 4e-5\nrest: {a: 1, b: [2]}\n"
    expected = {"m1": 0.5, "l1": [0.1, 0.2], "name": "x", "flag": True, "small": "4e-5", "rest": {"a": 1, "b": [2]}}
    assert read_map(write(tmp_path, text), "parameter") == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &x 1\nb: *x", r"alias or an anchor, 'x': write the value itself"),
        ("a: *x", "alias or an anchor"),
        ("&a\nm1: 1\n<<: *a", "alias or an anchor"),
        ("a: !!timestamp x", "has a tag, 'tag:yaml.org,2002:timestamp': write plain values"),
        ("a: !!int x", "has a tag"),
        ("a: !!python/object/apply:os.system ['true']", "has a tag"),
        ("!!set {a, b}", "has a tag"),
        ("a: !mine 5", "has a tag, '!mine'"),
        ("a: 2001-99-99", "neither a number nor text"),
        ("a: 0x_", "neither a number nor text"),
        ("a: " + "9" * 5000, "neither a number nor text"),
        ("a: " + "[" * 1500 + "]" * 1500, "deeper than 10 levels"),
        ("a: " + "{a: " * 1500 + "1" + "}" * 1500, "deeper than 10 levels"),
        ("[" * 5000, "deeper than 10 levels"),
        ("- a\n- b\n- a", "is not a map"),
        ("5", "is not a map"),
        ("--- \n...", "is not a map"),
        ("a: 1\n---\nb: 2", "is not YAML"),
        ("1: 2", "gives a value to 1, which is no name"),
        ("? [a, b]\n: 1", "is not YAML"),
        ("a: 1\n'a': 2", "gives a 2 times"),
        ('"x\\ny": 1\n"x\\ny": 2', "gives x y 2 times"),
        (b"\xff\xfe\x00", "is not UTF-8 text"),
        ("a: \x00", "is not YAML"),
        (b"a: 1\n" + b"#" * LARGEST_YAML, "more than 0.1 MB"),
    ],
    ids=lambda value: repr(value)[:20],
)
def test_all_else_is_refused_in_one_line(tmp_path, text, message):
    with pytest.raises(SwingupError, match=message) as error:
        read_map(write(tmp_path, text), "parameter")
    assert len(str(error.value)) < 700
    assert str(error.value).isprintable()


@pytest.mark.parametrize("path", FIXTURES, ids=lambda path: path.stem)
def test_files_that_hung_or_crashed_once(path):
    with pytest.raises(SwingupError):
        read_map(path, "domain")


def test_there_are_such_files():
    assert {path.stem for path in FIXTURES} >= {"aliases", "deep", "date", "tag"}


@pytest.mark.parametrize("path", ["none.yml", "", ".", "a\x00b", "x" * 5000])
def test_paths_that_name_no_file(tmp_path, monkeypatch, path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SwingupError, match="cannot read parameter file"):
        read_map(path, "parameter")


def test_an_endless_file():
    with pytest.raises(SwingupError, match=r"more than 0\.1 MB"):
        read_map("/dev/zero", "parameter")
