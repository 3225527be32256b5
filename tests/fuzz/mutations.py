"""Ways to spoil a file: other values in it, other bytes, and headers that lie about what it holds."""

import json
import struct

import numpy as np

from swingup.common.arrays import TYPES

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

NAMES = {code: name for name, code in TYPES.items()}
COUNTS = [-1, 0, 1, 3, 16, 2**31, 2**53, 2**63, 10**30, 1.5, True, None, "1", [1], "9" * 5000]
"""In the place of a number of a shape, or of a place in the file."""

FAULTS = [
    "text", "array", "array", "missing", "extra", "twice", "entry", "entry", "entry", "length", "header", "bytes",
    "bytes", "bytes", "other", "none",
]  # fmt: skip
"""What may be wrong with a file of arrays; some more often than others."""


def mutate(random, value):
    """The JSON value with one thing in it changed, somewhere."""
    if not isinstance(value, dict | list) or not value or random.random() > 0.8:
        return random.choice(EXTREMES)
    changed, kind = value.copy(), random.random()
    place = random.choice(list(value) if isinstance(value, dict) else range(len(value)))
    if kind < 0.15:
        del changed[place]
    elif kind < 0.25 and isinstance(value, dict):
        changed[str(random.choice(EXTREMES))[:200]] = random.choice(EXTREMES)
    elif kind < 0.25:
        changed *= random.choice([2, 3, 50])
    else:
        changed[place] = random.choice(EXTREMES) if kind < 0.6 else mutate(random, value[place])
    return changed


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


def other_array(random, array):
    """An array of another type, shape or content."""
    kind = random.choice(["type", "shape", "value", "order"])
    with np.errstate(all="ignore"):
        if kind == "type":
            return array.astype(random.choice(["U5", "S5", "i4", "u1", "f2", "f8", "c16", "?", ">f4", ">f8", "g"]))
        if kind == "shape":
            shapes = [(), (0,), (1,), (0, 4), (4, 0), (1, 1, 1), (3,), (1,) * 32, (100_000,), (1, 9999)]
            return np.zeros(random.choice(shapes), array.dtype)
        if kind == "value" and array.size:
            wide = array.astype("f8")
            values = [np.nan, np.inf, -np.inf, 1e38, 1e300, -1e300, 1e-320]
            wide.flat[random.randrange(array.size)] = random.choice(values)
            return wide
    return np.asfortranarray(array)


def spoilt_arrays(random, text, arrays):
    """A safetensors file of a JSON text and arrays in which one thing or another is wrong."""
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
    texts = {"swingup": text}
    if kind == "other":
        texts = random.choice([{}, None, [text], text, {"swingup": [text]}, {"pt": text}])
    header, body = {"__metadata__": texts}, b""
    for each, array in arrays.items():
        entry = {"dtype": NAMES.get(array.dtype.str, array.dtype.str), "shape": list(array.shape)}
        header[each] = entry | {"data_offsets": [len(body), len(body) + array.nbytes]}
        body += array.tobytes()
    if kind == "entry":
        header = spoilt_entry(random, header, name)
    line = json.dumps(header)
    if kind == "twice":
        line = f'{line[:-1]}, "{name}": {json.dumps(header[name])}}}'
    if kind == "header":
        line = random.choice([*LINES, line[:-1], line + "x", " " + line, line.replace("0", "0" * 5000, 1)])
    head = line.encode("utf-8", "surrogatepass")
    lengths = [0, 1, len(head) - 1, len(head) + 1, 10**5, 2**32, 2**63, 2**64 - 1]
    length = random.choice(lengths) if kind == "length" else len(head)
    data = struct.pack("<Q", length) + head + body
    return damage(random, data) if kind == "bytes" else data


def spoilt_entry(random, header, name):
    """The header with another type, shape or place of an array."""
    entry, key = dict(header[name]), random.choice(["dtype", "shape", "shape", "data_offsets", "data_offsets"])
    if random.random() < 0.3:
        entry[key] = random.choice(EXTREMES)
    elif key == "dtype":
        entry[key] = random.choice([*NAMES.values(), "BF16", "F8_E4M3", "C64", "f4", "O"])
    else:
        values = list(entry[key]) or [0]
        values[random.randrange(len(values))] = random.choice(COUNTS)
        entry[key] = values
    return header | {name: entry}
