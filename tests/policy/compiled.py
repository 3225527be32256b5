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

from swingup.export.c_text import in_precision

STRICT = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2"]

CAREFUL = ["-Wfloat-conversion", "-Wdouble-promotion", "-Wconversion", "-Wsign-conversion", "-Wshadow", "-Wundef"]
"""More warnings than STRICT has, of conversions above all."""

KEPT = Path(os.environ["JAX_COMPILATION_CACHE_DIR"]) / "c"
"""What gcc made, beside JAX's programs: all workers and later runs share it."""

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")

DRIVER = """
#include "policy.h"

typedef double outer; /* what Python passes, to a header in single precision as well */

static void enter(const outer *from, double *to, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        to[i] = (double)from[i];
    }
}

#if !SWINGUP_HAS_FEEDBACK
void torques(int n, const outer *x, outer *u)
{
    double state[4];
    int k;
    for (k = 0; k < n; k++) {
        enter(x + 4 * k, state, 4);
        u[k] = (outer)swingup_policy(state);
    }
}
#endif

const char *watch(
    int n, const outer *t, const outer *x, const outer *given, outer *u, int *reasons, outer *fault)
{
    static swingup_controller controller;
    double state[4], torque[2];
    int k;
    swingup_reset(&controller);
    for (k = 0; k < n; k++) {
        enter(x + 4 * k, state, 4);
        swingup_control(&controller, t[k], state, torque);
        u[2 * k] = (outer)torque[0];
        u[2 * k + 1] = (outer)torque[1];
        reasons[k] = swingup_guard_reason(&controller);
#if SWINGUP_HAS_IDENTIFIER
        if (given) {
            enter(given + 2 * k + SWINGUP_DRIVEN, controller.estimator.torques, 1);
            enter(given + 2 * k, controller.estimator.identifier.torques[0], 2);
        }
#endif
    }
    (void)given;
    fault[0] = controller.guard.joint;
    fault[1] = controller.guard.when;
    fault[2] = (outer)controller.guard.value;
    return swingup_guard_sentence(&controller);
}

int self_test(void)
{
    static swingup_controller controller;
    return swingup_self_test(&controller);
}
"""

TASK_DRIVER = """
#include "policy.h"

typedef double outer; /* as above */

void act(int n, const outer *observations, outer *actions)
{
    double observation[SWINGUP_INPUTS];
    SWINGUP_ACTION action[SWINGUP_ACTIONS];
    int k, i;
    for (k = 0; k < n; k++) {
        for (i = 0; i < SWINGUP_INPUTS; i++) {
            observation[i] = (double)observations[k * SWINGUP_INPUTS + i];
        }
        for (i = 0; i < SWINGUP_ACTIONS; i++) {
            action[i] = -99;
        }
        (void)swingup_policy(observation, action);
        for (i = 0; i < SWINGUP_ACTIONS; i++) {
            actions[k * SWINGUP_ACTIONS + i] = (outer)action[i];
        }
    }
}

int self_test(void)
{
    return swingup_self_test();
}
"""
"""An action that swingup_policy leaves alone is -99."""


def compile_header(folder, text, *flags, driver=DRIVER):
    """The shared library of a header's text."""
    (folder / "policy.h").write_text(text, encoding="utf-8")
    precision = "single" if "#define SWINGUP_SINGLE 1" in text else "double"
    return compile_program(folder, in_precision(driver, precision), *flags)


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


def watch(library, times, states, given=None):
    """From a reset on: torques (n, 2), the guard's reasons (n,), its [joint, time, value] and its sentence.

    The motors may be given other torques.
    """
    u, reasons, fault = np.empty((len(states), 2)), np.zeros(len(states), np.int32), np.empty(3)
    library.watch.restype = ctypes.c_char_p
    others = None if given is None else pointer(given)
    rows = pointer(times), pointer(states), others, pointer(u), pointer(reasons, np.int32), pointer(fault)
    said = library.watch(len(states), *rows)
    return u, reasons, fault, said.decode()


def pointer(array, dtype=np.float64):
    """An array for C."""
    assert array.flags.c_contiguous
    assert array.dtype == dtype
    return array.ctypes.data_as(ctypes.c_void_p)
