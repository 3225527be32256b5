"""Ways to spoil a file: other values in it, other bytes, and archives that lie about what they hold."""

import io
import struct
import zipfile

import numpy as np

EXTREMES = [
    None, True, False, 0, -1, 1, 2, 3.5, 1e308, -1e308, 1e-320, float("nan"), float("inf"), -float("inf"), 10**400,
    2**63, -(2**63), "", "x", "1", "nan", "../../up", "<script>alert(1)</script>", "a\nb", "\x1b[31m", "\u202e",
    "\x00", "é" * 50, "\udce9", "A" * 100_000, "1e5", "0x10", [], {}, [[]], {"a": 1}, [1, 2], [None],
    [["d", 1, 2]], [0] * 5000,
]  # fmt: skip
"""Values in the place of others."""

LINES = [
    "", "{", "null", "[]", "1", '"x"', "NaN", "[" * 100_000, '{"a":' * 2000 + "1" + "}" * 2000, "9" * 5000,
    '{"frames": 1, "seed": ' + "9" * 5000 + "}", "\ufeff{}", '{"frames": 1e999, "seed": 0}',
    '{"frames": NaN, "seed": 0}',
]  # fmt: skip
"""Texts in the place of a JSON object."""

SHAPES = [
    "10**3", "1000000000000", "99999999999999999999999", "-1", "-5, -5", "0", "1.5", "True", "None", "'a'", "1L",
    "2**62, 4", "9223372036854775807", "4294967296, 4294967296", "0, 1000000000000000000", "1" * 40, "1_0", "1 2",
]  # fmt: skip
HEADERS = [
    *(f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({shape},), }}" for shape in SHAPES),
    *(
        f"{{'descr': '{kind}', 'fortran_order': False, 'shape': (4,), }}"
        for kind in ("|O", "<U1000000000", "|V0", "<f3", "<f16", ">c8", "<M8[s]", "?")
    ),
    "{'descr': [('a', '<f4', (1000000, 1000000))], 'fortran_order': False, 'shape': (10,)}",
    "{'descr': __import__('os').getcwd(), 'fortran_order': False, 'shape': ()}",
    "{'descr': '<f4'", "{", "(", "'", '"""', "[]", "(" * 3000 + ")" * 3000, "-" * 5000 + "1", "\xff\xfe", "  bad\n",
]  # fmt: skip
"""Headers of arrays that lie, or that Python would choke on."""


FAULTS = [
    "text", "array", "array", "missing", "extra", "twice", "header", "header", "bytes", "bytes", "bytes",
    "directory", "bomb", "compression", "encrypted", "none",
]  # fmt: skip
"""What may be wrong with an archive; some more often than others."""


def mutate(random, value):
    """The JSON value with one thing in it changed, somewhere."""
    if isinstance(value, dict) and value and random.random() < 0.8:
        changed, name, kind = dict(value), random.choice(list(value)), random.random()
        if kind < 0.15:
            del changed[name]
        elif kind < 0.25:
            changed[str(random.choice(EXTREMES))[:200]] = random.choice(EXTREMES)
        elif kind < 0.6:
            changed[name] = random.choice(EXTREMES)
        else:
            changed[name] = mutate(random, value[name])
        return changed
    if isinstance(value, list) and value and random.random() < 0.8:
        changed, index, kind = list(value), random.randrange(len(value)), random.random()
        if kind < 0.2:
            del changed[index]
        elif kind < 0.3:
            changed *= random.choice([2, 3, 50])
        elif kind < 0.5:
            changed[index] = random.choice(EXTREMES)
        else:
            changed[index] = mutate(random, value[index])
        return changed
    return random.choice(EXTREMES)


def several(random, change, value):
    """A change made once, or up to three times."""
    for _ in range(random.choice([1, 1, 2, 3])):
        value = change(random, value)
    return value


def damage(random, data):
    """Bytes of which some are cut off, or flipped, or others."""
    kind = random.random()
    if not data or kind < 0.3:
        return data[: random.randrange(len(data) + 1)]
    changed = bytearray(data)
    for _ in range(random.choice([1, 1, 2, 4, 16])):
        place = random.randrange(len(changed))
        changed[place] = changed[place] ^ (1 << random.randrange(8)) if kind < 0.8 else random.randrange(256)
    return bytes(changed)


def npy(array):
    """An array as the member of an archive."""
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.asarray(array), allow_pickle=True)
    return stream.getvalue()


def lying_npy(random):
    """A member whose header is one of :data:`HEADERS`."""
    header = random.choice(HEADERS).encode("latin-1")
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    version = random.choice([1, 1, 2, 3, 9])
    length = struct.pack("<H" if version == 1 else "<I", len(header))
    return b"\x93NUMPY" + bytes((version, 0)) + length + header + bytes(random.choice([0, 16, 400]))


def archive(members, compression=zipfile.ZIP_DEFLATED):
    """The bytes of an archive."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as file:
        for name, content in members:
            file.writestr(zipfile.ZipInfo(name), content, compression)
    return stream.getvalue()


def other_array(random, array):
    """An array of another type, shape or content."""
    kind = random.choice(["type", "shape", "value", "order", "pickle"])
    with np.errstate(all="ignore"):
        if kind == "type":
            return array.astype(random.choice(["U5", "S5", "i4", "u1", "f2", "f8", "c16", "?", ">f4", ">f8"]))
        if kind == "shape":
            shape = random.choice(
                [(), (0,), (1,), (0, 4), (4, 0), (1, 1, 1), (3,), (1,) * 32, (100_000,), (1, 9999)]
            )
            return np.zeros(shape, array.dtype)
        if kind == "value" and array.size:
            wide = array.astype("f8")
            wide.flat[random.randrange(array.size)] = random.choice(
                [np.nan, np.inf, -np.inf, 1e38, 1e300, -1e300, 1e-320]
            )
            return wide
    return np.asfortranarray(array) if kind == "order" else np.array([{"an": "object"}], object)


def spoilt_archive(random, text, arrays):
    """An archive of a JSON text and arrays in which one thing or another is wrong."""
    kind = random.choice(FAULTS)
    arrays, name = dict(arrays), random.choice(list(arrays))
    if kind == "text":
        text = random.choice([text[:-1], "\ufeff" + text, text + "x", text.replace("1", "1" * 5000, 1), *LINES])
    if kind == "array":
        arrays[name] = other_array(random, arrays[name])
    if kind == "missing":
        del arrays[name]
    if kind == "extra":
        new = random.choice(["network.trunk.%d.weight", "observation.%d.mean", "observation.0.%d", "x%d"])
        arrays |= {new % random.randrange(4000): np.ones((2, 2), "f4") for _ in range(random.choice([1, 100]))}
    members = [("metadata.npy", npy(np.frombuffer(text.encode("utf-8", "surrogatepass"), np.uint8)))]
    members += [(f"{each}.npy", npy(array)) for each, array in arrays.items()]
    place = random.randrange(len(members))
    if kind == "header":
        members[place] = (members[place][0], lying_npy(random))
    if kind == "twice":
        members.append((members[place][0].removesuffix(random.choice([".npy", ""])), npy(np.zeros(3))))
    if kind == "bomb":
        members.append((random.choice(["z.npy", members[place][0]]), npy(np.zeros(random.choice([10**4, 10**6])))))
    methods = [zipfile.ZIP_STORED, zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2]
    data = archive(members, random.choice(methods) if kind == "compression" else zipfile.ZIP_DEFLATED)
    if kind == "bytes":
        data = damage(random, data)
    if kind == "directory":
        data = spoilt_directory(random, data)
    if kind == "encrypted":
        data = data.replace(b"PK\x03\x04\x14\x00\x00", b"PK\x03\x04\x14\x00\x01")
    return data


def spoilt_directory(random, data):
    """An archive with another number in its directory: a size, an offset, a method, a flag."""
    changed, sizes = bytearray(data), {b"PK\x01\x02": 46, b"PK\x03\x04": 30, b"PK\x05\x06": 22}
    places = [k for k in range(len(data) - 4) if data[k : k + 4] in sizes]
    for _ in range(random.choice([1, 2])):
        start = random.choice(places)
        place = start + random.randrange(4, sizes[data[start : start + 4]] - 3)
        struct.pack_into("<I", changed, place, random.choice([0, 1, 8, 99, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF]))
    return bytes(changed)
