"""Files: written whole or not at all; and flat YAML maps, which hold plain values, whatever else YAML can do."""

import os
import stat
from pathlib import Path

from refusals import refusal
from swingup.common.files import make_folder, write_atomically
from swingup.common.yaml_map import LARGEST_YAML, read_map

ONCE_HUNG_OR_CRASHED = [*(Path(__file__).parents[1] / "data").glob("*.yml")]


def test_a_link_keeps_pointing_and_a_mode_stays(tmp_path):
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_bytes(b"old")
    target.chmod(0o600)
    link.symlink_to(target)
    write_atomically(link, b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"
    assert stat.S_IMODE(target.stat().st_mode) == 0o600


def test_a_folder_behind_a_link_is_made(tmp_path):
    (tmp_path / "link").symlink_to("folder")
    make_folder(tmp_path / "link" / "new")
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
    assert {"aliases", "deep", "date", "tag"} <= {path.stem for path in ONCE_HUNG_OR_CRASHED}
    monkeypatch.chdir(tmp_path)
    for path in (*ONCE_HUNG_OR_CRASHED, "none.yml", "", ".", "a\x00b", "x" * 5000, "/dev/zero"):
        refusal(read_map, path, "domain")
