"""A policy as a single C99 header: a comment, the policy's data, and the runtime.

The runtime is plain C: ``policy/contract.h`` and what it includes, one file beside each ``core.py``. Behind any
data each of them compiles by itself; what they do is decided there, not here.
"""

import posixpath
import re
from importlib import resources
from pathlib import PurePosixPath

import numpy as np

from ...common import __version__
from ...policy.network.layers import require_portable
from ...policy.pendulum import PendulumPolicy
from ..folder import NAME, check_export_name
from .data import runtime_data

POLICY = resources.files("swingup") / "policy"
"""Where the runtime's files are."""

USAGE = """\
/*
 * {about}, written by swingup {version}.
 *
 * C99, <math.h> and <stdint.h>; no allocation, no global state, no other library. Sizes and weights are fixed.
 *
 *     swingup_controller controller;
 *     swingup_reset(&controller);                     before every run
 *     swingup_control(&controller, t, x, u);          at every step, {rate}
 *
 * x = [q1, q2, dq1, dq2]: shoulder angle from hanging down, elbow angle relative to link 1 (rad), and their rates
 * (rad/s); t is the time (s); u = [u1, u2] are the torques of shoulder and elbow (N m), within the motors' limits,
 * the passive joint's {passive}.
 * swingup_policy(x) is the policy alone: the torque of the driven joint, without memory.
{notes} */
"""
IDENTIFIED_NOTE = """\
 * swingup_base_parameters(&controller) are nine numbers: what the identifier has found of the plant so far.
"""
GUARDED_NOTE = """\
 * The safety guard stops the controller for good at a limit or a broken measurement, until swingup_reset:
 * swingup_guard_reason(&controller) is then not 0, and swingup_guard_sentence(&controller) says why.
"""
UNGUARDED_NOTE = """\
 * A torque is NaN where the state is not finite: check what you send to a motor.
"""


def c_header(policy: PendulumPolicy, name: str = NAME) -> str:
    """The header's text, in which all names begin with ``name``: several go into one program."""
    check_export_name(name)
    require_portable(policy.network, "a C header")
    data = f"#ifndef SWINGUP_POLICY_H\n#define SWINGUP_POLICY_H\n\n{c_data(policy)}"
    text = f"{_usage(policy)}{data}\n{runtime()}\n#endif\n"
    # Two headers in one program must not share a name.
    return text.replace(f"{NAME}_", f"{name}_").replace(f"{NAME.upper()}_", f"{name.upper()}_")


def c_data(policy: PendulumPolicy) -> str:
    """The data of a policy in C, which the runtime expects before it."""
    # A name may be anything: no end of a comment may come from a file.
    plant = re.sub(r"[^\w. -]", "_", policy.plant.name, flags=re.ASCII)[:60] or "that of the policy"
    lines = [f"/* The plant is {plant}. */"]
    for part, data in runtime_data(policy).items():
        lines += [
            f"\n/* ---- data of {part} ---- */\n",
            *(_definition(name, value) for name, value in data.items()),
        ]
    return "\n".join(lines) + "\n"


def runtime() -> str:
    """The runtime as one text: ``contract.h`` with each other file where it is first included."""
    included: set[str] = set()

    def whole(path: PurePosixPath) -> str:
        name = posixpath.normpath(path)
        # As an include guard would: the user's header has each part once.
        if name in included:
            return ""
        included.add(name)
        text = POLICY.joinpath(name).read_text(encoding="utf-8")
        return re.sub(r'#include "(.*)"\n', lambda found: whole(path.parent / found[1]), text)

    return whole(PurePosixPath("contract.h"))


def _usage(policy: PendulumPolicy) -> str:
    parts = {"state estimator": policy.estimator, "identifier": policy.identifier, "safety guard": policy.guard}
    around = " and its ".join(name for name, part in parts.items() if part is not None)
    what = "A policy" if policy.regulator is None else "A policy with its regulator"
    return USAGE.format(
        about=f"{what}{f' behind its {around}' if around else ''} for the {policy.robot.name}",
        version=__version__,
        rate=f"every {policy.period:g} s" if policy.period else "at the loop's rate",
        passive="for its friction" if policy.torque_limits[1 - policy.robot.joint] else "0",
        notes=(IDENTIFIED_NOTE if policy.identifier else "") + (GUARDED_NOTE if policy.guard else UNGUARDED_NOTE),
    )


def _definition(name: str, value: int | float | str | np.ndarray) -> str:
    """A number or a text as a macro, an array as a constant."""
    if not isinstance(value, np.ndarray):
        return f"#define SWINGUP_{name} {value if isinstance(value, int | str) else repr(float(value))}"
    if value.ndim == 2 and value.dtype == np.float32:
        # Weights: the only numbers in single precision, input by input in one row.
        rows = ",\n".join(_decimals(row, "f") for row in value)
        return f"static const float swingup_{name}[{value.size}] = {{\n{rows}\n}};"
    sizes = "".join(f"[{size}]" for size in value.shape)
    return f"static const double swingup_{name}{sizes} = {_braces(value.astype(np.float64))};"


def _braces(values: np.ndarray) -> str:
    """An initialiser."""
    inner = ",\n    ".join(_braces(row) for row in values) if values.ndim > 1 else _decimals(values)
    return f"{{{inner}}}"


def _decimals(values: np.ndarray, suffix: str = "") -> str:
    """Decimals that C reads back as the same numbers."""
    return ", ".join(f"{np.format_float_scientific(value)}{suffix}" for value in values)
