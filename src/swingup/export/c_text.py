"""C from Python: data as macros and constants, the runtime as one text, and both in single precision."""

import posixpath
import re
from collections.abc import Mapping
from importlib import resources
from pathlib import PurePosixPath
from typing import Literal

import numpy as np

POLICY = resources.files("swingup") / "policy"  # Where the runtime's files are

Precision = Literal["double", "single"]
Value = int | float | str | np.ndarray
Data = dict[str, Value]  # Numbers, texts and arrays by their names, without the prefix

FUNCTIONS = "atan|cos|exp|expm1|fabs|floor|fmax|fmod|log|log1p|rint|sin|sqrt|tanh"
"""What the runtime uses of <math.h>."""
WORDS = re.compile(
    rf"/\*.*?\*/|\"[^\"\n]*\"|typedef double \w+;|\b(?P<type>double)\b|\b(?P<function>{FUNCTIONS})(?=\()"
    r"|(?<![\w.])(?P<number>\d+\.\d*(?:e[-+]?\d+)?|\d+e[-+]?\d+)(?![\w.])",
    re.DOTALL,
)
"""What single precision changes in C: types, functions and numbers, outside of comments, texts and typedefs."""


IN_FLASH = ("weight_", "bias_", "input_", "piece_coefficients", "test_")
"""Beginnings of the names of arrays that lie in the flash."""


def header(about: str, parts: Mapping[str, Data], top: str, precision: Precision, name: str) -> str:
    """A header: a comment, data by their parts, and the runtime behind the file ``top``.

    All names begin with ``name``, since two headers in one program must not share one.
    """
    total = sum(constant_bytes(part, precision) for part in parts.values())
    code = f"#define SWINGUP_CONSTANT_BYTES {total}\n{c_data(parts)}\n{runtime(top)}"
    text = f"{about}#ifndef SWINGUP_POLICY_H\n#define SWINGUP_POLICY_H\n\n{in_precision(code, precision)}\n#endif\n"
    return text.replace("swingup_", f"{name}_").replace("SWINGUP_", f"{name.upper()}_")


def c_data(parts: Mapping[str, Data]) -> str:
    """Data in C, which the runtime expects before it."""
    lines = [runtime("flash.h")]
    for part, data in parts.items():
        lines += [
            f"\n/* ---- data of {part} ---- */\n",
            *(_definition(name, value) for name, value in data.items()),
        ]
    return "\n".join(lines) + "\n"


def constant_bytes(data: Data, precision: Precision) -> int:
    """Bytes of the arrays in data."""
    arrays = [value for value in data.values() if isinstance(value, np.ndarray)]
    double = 8 if precision == "double" else 4
    return sum(each.size * (double if each.dtype == np.float64 else 4) for each in arrays)


def runtime(top: str) -> str:
    """The runtime as one text: a file with each other one where it is first included."""
    included: set[str] = set()

    def whole(path: PurePosixPath) -> str:
        name = posixpath.normpath(path)
        # As an include guard would: the user's header has each part once.
        if name in included:
            return ""
        included.add(name)
        text = POLICY.joinpath(name).read_text(encoding="utf-8")
        return re.sub(r'#include "(.*)"\n', lambda found: whole(path.parent / found[1]), text)

    return whole(PurePosixPath(top))


def in_precision(code: str, precision: Precision) -> str:
    """C that is written in double precision, in the precision named."""

    def single(found: re.Match[str]) -> str:
        if found["type"]:
            return "float"
        return f"{found[0]}f" if found["function"] or found["number"] else found[0]

    single_precision = precision == "single"
    text = WORDS.sub(single, code) if single_precision else code
    return f"#define SWINGUP_SINGLE {int(single_precision)}\n{text}"


def _definition(name: str, value: Value) -> str:
    """A number or a text as a macro, an array as a constant."""
    if not isinstance(value, np.ndarray):
        return f"#define SWINGUP_{name} {value if isinstance(value, int | str) else repr(float(value))}"
    if value.dtype.kind == "i":
        return f"static const int swingup_{name}[{value.size}] = {{{', '.join(map(str, value.tolist()))}}};"
    place = " SWINGUP_FLASH" if name.startswith(IN_FLASH) else ""
    if value.dtype == np.float32:
        # Weights: the only numbers in single precision in every header, input by input in one row.
        rows = ",\n".join(_decimals(row, "f") for row in value)
        return f"static const float swingup_{name}[{value.size}]{place} = {{\n{rows}\n}};"
    sizes = "".join(f"[{size}]" for size in value.shape)
    return f"static const double swingup_{name}{sizes}{place} = {_braces(value.astype(np.float64))};"


def _braces(values: np.ndarray) -> str:
    inner = ",\n    ".join(_braces(row) for row in values) if values.ndim > 1 else _decimals(values)
    return f"{{{inner}}}"


def _decimals(values: np.ndarray, suffix: str = "") -> str:
    """Decimals that C reads back as the same numbers."""
    return ", ".join(f"{np.format_float_scientific(value)}{suffix}" for value in values)
