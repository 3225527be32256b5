"""C headers as functions of Python: compiled by gcc without a warning, called through ctypes."""

import ctypes
import functools
import hashlib
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

STRICT = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2"]

CAREFUL = ["-Wfloat-conversion", "-Wdouble-promotion", "-Wconversion", "-Wsign-conversion", "-Wshadow", "-Wundef"]
"""More warnings than STRICT has, of conversions above all."""

KEPT = Path(os.environ["JAX_COMPILATION_CACHE_DIR"]) / "c"
"""What gcc made, beside JAX's programs: all workers and later runs share it."""

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")

DRIVER = """
#include "policy.h"

void torques(int n, const double *x, double *u);
void run(int n, const double *t, const double *x, double *u);

void torques(int n, const double *x, double *u)
{
    int k;
    for (k = 0; k < n; k++) {
        u[k] = swingup_policy(x + 4 * k);
    }
}

void run(int n, const double *t, const double *x, double *u)
{
    swingup_controller controller;
    int k;
    swingup_reset(&controller);
    for (k = 0; k < n; k++) {
        swingup_control(&controller, t[k], x + 4 * k, u + 2 * k);
    }
}
"""

FOLLOW = (
    DRIVER
    + """
void follow(int n, const double *t, const double *x, const double *given, double *u);

void follow(int n, const double *t, const double *x, const double *given, double *u)
{
    swingup_controller controller;
    int k;
    swingup_reset(&controller);
    for (k = 0; k < n; k++) {
        swingup_control(&controller, t[k], x + 4 * k, u + 2 * k);
        controller.estimator.torques[0] = given[2 * k + SWINGUP_DRIVEN];
        controller.estimator.identifier.torques[0][0] = given[2 * k];
        controller.estimator.identifier.torques[0][1] = given[2 * k + 1];
    }
}
"""
)
"""For a header with an identifier: the motors were given other torques than the controller's."""

WATCH = """
#include "policy.h"

const char *watch(int n, const double *t, const double *x, double *u, int *reasons, double *fault);

const char *watch(int n, const double *t, const double *x, double *u, int *reasons, double *fault)
{
    static swingup_controller controller;
    int k;
    swingup_reset(&controller);
    for (k = 0; k < n; k++) {
        swingup_control(&controller, t[k], x + 4 * k, u + 2 * k);
        reasons[k] = swingup_guard_reason(&controller);
    }
    fault[0] = controller.guard.joint;
    fault[1] = controller.guard.when;
    fault[2] = controller.guard.value;
    return swingup_guard_sentence(&controller);
}
"""


def compile_header(folder, text, *flags):
    """The shared library of a header's text."""
    (folder / "policy.h").write_text(text, encoding="utf-8")
    return compile_program(folder, FOLLOW if "HAS_IDENTIFIER 1" in text else DRIVER, *flags)


def compile_program(folder, text, *flags):
    """The shared library of a program that includes headers of the folder."""
    (folder / "driver.c").write_text(text, encoding="utf-8")
    return ctypes.CDLL(str(build(folder, *STRICT, *flags, "-shared", "-fPIC", "driver.c")))


def gcc(folder, *command):
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@functools.cache
def version():
    return gcc(None, "gcc", "--version").stdout


def build(folder, *command):
    """The path of what gcc makes of a folder's files without a warning, now or when it last saw the same."""
    key = hashlib.sha256(repr((command, version())).encode())
    for path in sorted(folder.glob("*.[ch]")):
        key.update(path.read_bytes())
    made = KEPT / key.hexdigest()
    if not made.exists():
        result = gcc(folder, *command, "-o", "made", "-lm")
        assert (result.returncode, result.stderr) == (0, "")
        KEPT.mkdir(parents=True, exist_ok=True)
        # Another worker may be reading: a file there is whole.
        whole = shutil.copy(folder / "made", made.with_suffix(f".{os.getpid()}"))
        os.replace(whole, made)
    return made


def torques(library, states):
    """The policy's torques (n,) for states (n, 4)."""
    u = np.empty(len(states))
    library.torques(len(states), pointer(states), pointer(u))
    return u


def run(library, times, states):
    """The controller's torques (n, 2) from its reset on."""
    u = np.empty((len(states), 2))
    library.run(len(states), pointer(times), pointer(states), pointer(u))
    return u


def follow(library, times, states, given):
    """The same while the motors are given other torques (n, 2), within their limits."""
    u = np.empty((len(states), 2))
    library.follow(len(states), *map(pointer, (times, states, given, u)))
    return u


def watch(library, times, states):
    """A guarded controller's torques (n, 2), its guard's reasons (n,), [joint, time, value] and the sentence."""
    u, reasons, fault = np.empty((len(states), 2)), np.zeros(len(states), np.int32), np.empty(3)
    library.watch.restype = ctypes.c_char_p
    rows = (times, states, u)
    said = library.watch(len(states), *map(pointer, rows), reasons.ctypes.data_as(ctypes.c_void_p), pointer(fault))
    return u, reasons, fault, said.decode()


def pointer(array):
    """An array for C."""
    assert array.flags.c_contiguous
    assert array.dtype == np.float64
    return array.ctypes.data_as(ctypes.c_void_p)
