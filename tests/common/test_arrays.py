"""Files of arrays: exact, those of safetensors, and whatever their bytes say, one line and little memory."""

import json
import tracemalloc

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

import refusals
from array_files import read_metadata
from swingup.common.arrays import LARGEST_HEADER, METADATA, TYPES, load_arrays, save_arrays
from swingup.common.errors import SwingupError

KIND, VERSION = "swingup thing", 3
HEAD = {"format": KIND, "format_version": VERSION}
TEXTS = {METADATA: json.dumps(HEAD)}
ENTRY = {"dtype": "F32", "shape": [4], "data_offsets": [0, 16]}


def write(path, header, body=b"", length=None):
    """A file with a header of one's own: bytes, or entries beside the metadata."""
    if not isinstance(header, bytes):
        header = json.dumps({"__metadata__": TEXTS} | header).encode()
    path.write_bytes((len(header) if length is None else length).to_bytes(8, "little") + header + body)
    return path


def read(path, **options):
    return load_arrays(path, KIND, VERSION, **options)


def refusal(path):
    told = refusals.refusal(read, path)
    assert str(path) in told
    return told


@pytest.fixture
def path(tmp_path):
    return tmp_path / "thing.safetensors"


ARRAYS = {
    "a": np.arange(6, dtype=">f8").reshape(2, 3),
    "b": np.asfortranarray(np.arange(6, dtype=np.float32).reshape(2, 3)),
    "c": np.array(True),
    "d": np.zeros((0, 4), np.int64),
    "e.f": np.arange(12, dtype=np.uint16)[::2],
    "g": np.array([np.nan, -0.0, 5e-324]),
    **{f"type {code}": np.ones(3, code) for code in TYPES.values()},
}


NATIVE = {
    name: np.ascontiguousarray(array, array.dtype.newbyteorder("=")).reshape(array.shape)
    for name, array in ARRAYS.items()
}


def assert_exact(found):
    """All arrays, in the machine's order of bytes."""
    assert found.keys() == NATIVE.keys()
    for name, array in NATIVE.items():
        assert (found[name].dtype, found[name].shape) == (array.dtype, array.shape)
        assert found[name].tobytes() == array.tobytes()


def test_safetensors_reads_what_is_written_where_it_can_be_mapped(path):
    # Metadata of another file are passed on without its kind.
    save_arrays(path, KIND, VERSION, {"frames": 12, "bad": [np.inf], "format": "swingup other"}, ARRAYS)
    assert_exact(load_file(path))
    assert read_metadata(path) == {**HEAD, "frames": 12, "bad": [None]}
    content = path.read_bytes()
    start = 8 + int.from_bytes(content[:8], "little")
    header = json.loads(content[8:start])
    assert start % 8 == 0
    for name, array in ARRAYS.items():
        assert header[name]["data_offsets"][0] % array.dtype.itemsize == 0


def test_what_safetensors_writes_is_read(path):
    save_file(NATIVE, path, TEXTS | {"theirs": "a text"})
    found, read_back = read(path)
    assert found == HEAD
    assert_exact(read_back)
    assert all(array.flags.writeable for array in read_back.values())


@pytest.mark.parametrize("array", [np.array(["text"]), np.array([{}], object), np.array([1j]), np.ones(2, "f4,f4")])
def test_types_that_the_format_lacks_are_not_written(path, array):
    with pytest.raises(SwingupError, match=r"a is of type .*; use numbers or booleans"):
        save_arrays(path, KIND, VERSION, {}, {"a": array})
    assert not path.exists()


def test_only_known_names_are_read(path):
    save_arrays(path, KIND, VERSION, {}, {"a": np.ones(3), "../up": np.ones(1)})
    assert list(read(path, known=lambda name: name == "a")[1]) == ["a"]
    assert read(path, known=lambda name: False) == (HEAD, {})


def peak_of(call):
    tracemalloc.start()
    try:
        result = call()
        return result, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_no_more_than_the_bound_is_read(path):
    size = 30_000_000
    entries = {
        f"a{k}": {"dtype": "F32", "shape": [size // 4], "data_offsets": [size * k, size * (k + 1)]}
        for k in range(10)
    }
    write(path, entries)
    with path.open("ab") as file:
        file.truncate(path.stat().st_size + 10 * size)  # zeros that the disk does not hold
    message, peak = peak_of(lambda: refusal(path))
    assert "holds 300 MB of arrays, where a swingup thing file may have 256 MB" in message
    assert peak < 1_000_000
    _, peak = peak_of(lambda: read(path, known=lambda name: name == "a1"))
    assert peak < 100_000_000


HEADERS = [
    b"", b"{", b"[]", b"[" * 100_000, b"9" * 5000, b"\xff\xfe{}", b"{}{}",
    json.dumps({"__metadata__": TEXTS, "a": ENTRY}).replace("}}", '}, "a": ' + json.dumps(ENTRY) + "}").encode(),
    *({"a": entry} for entry in (None, {}, {"dtype": "F32"})),
    *({"a": {"dtype": "F32", "shape": shape, "data_offsets": [0, 0]}} for shape in ([0, 2**70], [0] * 65)),
    {"a": ENTRY, "__metadata__": TEXTS | {"x": " " * LARGEST_HEADER}},
]  # fmt: skip
"""Headers of something else, of an array "a" that is given twice, of entries that are none, and one too long."""
CHANGES = [
    {"dtype": "F31"}, {"dtype": ["F32"]}, {"dtype": "F64"}, {"shape": 4}, {"shape": [5]}, {"shape": [-2, -2]},
    {"shape": [4.0]}, {"shape": [True, 4]}, {"shape": [10**400]}, {"shape": [1] * 5000}, {"shape": [2**62, 4]},
    {"data_offsets": [0]}, {"data_offsets": [16, 0]}, {"data_offsets": [-16, 0]}, {"data_offsets": [0.0, 16.0]},
    {"data_offsets": [0, 10**400]}, {"data_offsets": {"0": 16}}, {"x": 1},
]  # fmt: skip
"""Of the entry of a float32 array of four numbers."""


def assert_foreign(path):
    """The file is refused in little memory."""
    message, peak = peak_of(lambda: refusal(path))
    assert "is not a swingup thing file" in message
    assert peak < 5_000_000


def test_headers_and_entries_that_lie_or_cannot_be_read(path):
    for header in HEADERS:
        assert_foreign(write(path, header, bytes(16)))
    for change in CHANGES:
        assert_foreign(write(path, {"a": ENTRY | change}, bytes(16)))
    for length in (0, 1, 20, 10**6, 10**8, 2**63, 2**64 - 1):
        assert_foreign(write(path, {"a": ENTRY}, bytes(16), length))


def test_arrays_follow_each_other_without_gaps_to_the_files_end(path):
    assert list(read(write(path, {"a": ENTRY}, bytes(16)))[1]) == ["a"]
    path.write_bytes(path.read_bytes() + b"x")
    assert_foreign(path)
    for start in (0, 8, 12, 20, 32):
        header = {"a": ENTRY, "b": ENTRY | {"data_offsets": [start, start + 16]}}
        assert_foreign(write(path, header, bytes(start + 16)))


def test_metadata_that_is_none(path):
    for text in ("", "null", "[" * 100_000, "{}", '{"format": "swingup thing"}', "9" * 5000, 3, ["{}"]):
        for entry in ({METADATA: text}, None, "text"):
            write(path, {"__metadata__": entry})
            assert "is not a swingup thing file: it lacks swingup's metadata" in refusal(path)


def test_another_kind_or_version(path):
    for changes, message in (
        ({"format": "a\nb" * 1000}, r"thing.safetensors is a 'a\nba"),
        ({"format_version": 4}, "has format version 4, this program reads 3: update swingup"),
        ({"format_version": "9" * 9999}, "has format version '999"),
    ):
        write(path, {"__metadata__": {METADATA: json.dumps(HEAD | changes)}})
        assert message in refusal(path)
        assert len(refusal(path)) < 400
