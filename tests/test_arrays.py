"""Archives of arrays: exact, and whatever their bytes say, one line and little memory."""

import io
import json
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest

from swingup.arrays import LARGEST_METADATA, load_archive, save_archive
from swingup.errors import SwingupError

KIND, VERSION = "swingup thing", 3
HEAD = {"format": KIND, "format_version": VERSION}
FLOATS = "{'descr': '<f4', 'fortran_order': False, 'shape': (%s), }"


def npy(array):
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.asarray(array), allow_pickle=True)
    return stream.getvalue()


def raw_npy(header, body=b"", version=1):
    header = header.encode("latin-1") + b"\n"
    return (
        b"\x93NUMPY"
        + bytes((version, 0))
        + struct.pack("<H" if version == 1 else "<I", len(header))
        + header
        + body
    )


def metadata(text=None):
    text = json.dumps(HEAD) if text is None else text
    return ("metadata.npy", npy(np.frombuffer(text.encode(), np.uint8)))


def write(path, *members, compression=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in members:
            archive.writestr(zipfile.ZipInfo(name), content, compression)
    return path


def read(path, **options):
    return load_archive(path, KIND, VERSION, **options)


def refusal(path, **options):
    with pytest.raises(SwingupError) as error:
        read(path, **options)
    assert str(error.value).isprintable()
    assert str(path) in str(error.value)
    return str(error.value)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "thing.npz"


def test_round_trip_is_exact(path):
    arrays = {
        "a": np.arange(6, dtype=">f8").reshape(2, 3),
        "b": np.asfortranarray(np.arange(6, dtype=np.float32).reshape(2, 3)),
        "c": np.array(True),
        "d": np.zeros((0, 4), np.int64),
        "e.f": np.array([1 + 2j]),
        "g": np.array([np.nan, -0.0, 5e-324]),
    }
    save_archive(path, KIND, VERSION, {"frames": 12, "bad": [np.inf]}, arrays)
    found, read_back = read(path)
    assert found == {**HEAD, "frames": 12, "bad": [None]}
    assert list(read_back) == list(arrays)
    for name, array in arrays.items():
        assert (read_back[name].dtype, read_back[name].shape) == (array.dtype, array.shape)
        assert read_back[name].tobytes() == array.tobytes()
        assert read_back[name].flags.writeable
        np.testing.assert_array_equal(np.load(path)[name], array)  # NumPy reads what is written


def test_what_numpy_writes_without_compression_is_read(path):
    np.savez(path, metadata=np.frombuffer(json.dumps(HEAD).encode(), np.uint8), a=np.eye(3))
    np.testing.assert_array_equal(read(path)[1]["a"], np.eye(3))


def test_only_known_names_are_read(path):
    write(path, metadata(), ("a.npy", npy(np.ones(3))), ("junk", b"no array"), ("../up.npy", b""))
    assert list(read(path, known=lambda name: name == "a")[1]) == ["a"]
    assert read(path, known=lambda name: False) == (HEAD, {})
    assert "is not a swingup thing file, or it is truncated" in refusal(path)


def peak_of(call):
    tracemalloc.start()
    try:
        result = call()
        return result, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def zeros(megabytes):
    """A member of zeros, which deflate shrinks a thousand times."""
    return raw_npy(FLOATS % f"{megabytes * 250_000},", bytes(megabytes * 1_000_000))


def test_a_bomb_is_not_inflated(path):
    write(path, metadata(), *((f"a{k}.npy", zeros(30)) for k in range(10)))
    assert path.stat().st_size < 400_000
    message, peak = peak_of(lambda: refusal(path))
    assert "holds 300 MB of arrays, where a swingup thing file may have 256 MB" in message
    assert peak < 1_000_000
    _, peak = peak_of(lambda: read(path, known=lambda name: name == "a1"))
    assert peak < 100_000_000


def test_a_member_gives_no_more_than_the_directory_says(path):
    write(path, metadata(), ("a.npy", zeros(50)))
    content = bytearray(path.read_bytes())
    place = content.index(b"PK\x01\x02", content.index(b"PK\x01\x02") + 1)
    content[place + 24 : place + 28] = struct.pack("<I", 1000)  # its size, where 50 MB follow
    path.write_bytes(content)
    message, peak = peak_of(lambda: refusal(path))
    assert "or it is truncated" in message
    assert peak < 1_000_000


def test_metadata_is_bounded_as_well(path):
    write(path, metadata(" " * LARGEST_METADATA + json.dumps(HEAD)))
    assert "holds 4 MB" in refusal(path)


@pytest.mark.parametrize(
    "member",
    [
        raw_npy(FLOATS % "10000000000000000000000000,"),
        raw_npy(FLOATS % "9223372036854775807, 9223372036854775807"),
        raw_npy(FLOATS % "0, 1000000000000000000000"),
        raw_npy(FLOATS % ("1" * 5000)),
        raw_npy(FLOATS % ("1," * 5000)),
        raw_npy(FLOATS % "-1,"),
        raw_npy(FLOATS % "1 2,", bytes(8)),
        raw_npy(FLOATS % "4,", bytes(12)),
        raw_npy(FLOATS % "4,", bytes(20)),
        raw_npy(FLOATS % "True,", bytes(4)),
        raw_npy("(" * 3000 + ")" * 3000),
        raw_npy("-" * 5000 + "1"),
        raw_npy("{'descr': __import__('os').system('true'), 'fortran_order': False, 'shape': (), }"),
        raw_npy("{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (1,), }", bytes(4)),
        raw_npy("{'descr': '<f3', 'fortran_order': False, 'shape': (1,), }", bytes(3)),
        raw_npy("{'descr': '<U9', 'fortran_order': False, 'shape': (1,), }", bytes(36)),
        raw_npy("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }", bytes(8)),
        raw_npy(FLOATS % "1L,", bytes(4)),
        raw_npy(FLOATS % "1,", bytes(4), version=3),
        raw_npy("\xff"),
        b"",
        b"\x93NUMPY",
        b"\x93NUMPY\x01\x00\xff\xff",
        npy(np.array([{"an": "object"}], object)),
        npy(np.array(["text"])),
    ],
    ids=lambda member: repr(member[10:40]),
)
def test_headers_that_lie_or_cannot_be_read(path, member):
    write(path, metadata(), ("a.npy", member))
    message, peak = peak_of(lambda: refusal(path))
    assert "is not a swingup thing file, or it is truncated: copy or make it anew" in message
    assert peak < 5_000_000


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "null",
        "[]",
        "1",
        '"x"',
        "[" * 100_000,
        '{"a":' * 20_000,
        "{}",
        '{"format": "swingup thing"}',
        "9" * 5000,
    ],
    ids=lambda text: text[:9],
)
def test_metadata_that_is_none(path, text):
    write(path, metadata(text))
    assert "is not a swingup thing file: it lacks swingup's metadata" in refusal(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "a\nb" * 1000}, r"thing.npz is a 'a\\nba"),
        ({"format": [["d"]]}, "is a [['d']] file: a swingup thing file is needed here"),
        ({"format_version": 4}, "has format version 4, this program reads 3: update swingup"),
        ({"format_version": "9" * 9999}, "has format version '999"),
    ],
)
def test_another_kind_or_version(path, changes, message):
    write(path, metadata(json.dumps(HEAD | changes)))
    assert message.replace("\\\\", "\\") in refusal(path)
    assert len(refusal(path)) < 400


def test_two_members_of_one_name(path):
    with pytest.warns(UserWarning, match="Duplicate name"):
        write(path, metadata(), ("a.npy", npy(np.ones(3))), ("a.npy", npy(np.zeros(3))))
    assert "or it is truncated" in refusal(path)
    write(path, metadata(), ("a.npy", npy(np.ones(3))), ("a", npy(np.zeros(3))))
    assert "or it is truncated" in refusal(path)


@pytest.mark.parametrize("compression", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_compressions_that_numpy_does_not_use(path, compression):
    write(path, metadata(), compression=compression)
    assert "or it is truncated" in refusal(path)


def test_encrypted_members(path):
    write(path, metadata())
    content = bytearray(path.read_bytes())
    content[content.index(b"PK\x03\x04") + 6] |= 1
    content[content.index(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(content)
    assert "or it is truncated" in refusal(path)


def test_a_flipped_bit_is_refused_or_harmless(path):
    # Some bits of an archive mean nothing: dates, attributes. All others are found, in content by its checksum.
    save_archive(path, KIND, VERSION, {}, {"a": np.arange(5.0)})
    good = path.read_bytes()
    refused = 0
    for bit in range(0, 8 * len(good), 13):  # 13 and 8 have no factor in common: all bits of a byte get their turn
        content = bytearray(good)
        content[bit // 8] ^= 1 << bit % 8
        path.write_bytes(content)
        try:
            found, arrays = read(path)
        except SwingupError:
            refused += 1
            continue
        assert found == HEAD
        for array in arrays.values():
            np.testing.assert_array_equal(array, np.arange(5.0))
    assert refused > 0.5 * len(range(0, 8 * len(good), 13))


@pytest.mark.parametrize("size", [0, 1, 4, 100, -1, -22])
def test_truncated(path, size):
    save_archive(path, KIND, VERSION, {}, {"a": np.arange(5.0)})
    path.write_bytes(path.read_bytes()[:size])
    assert "is not a swingup thing file, or it is truncated" in refusal(path)


def test_what_is_no_file(tmp_path):
    assert refusal(tmp_path / "none.npz").startswith("no such file: ")
    assert refusal(tmp_path).startswith("cannot read ")
    with pytest.raises(SwingupError, match="is not a swingup thing file"):
        read("a\x00b")
