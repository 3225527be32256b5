"""C: the runtime by itself with each combination of its switches, and a header's precision and numbers."""

import dataclasses
import itertools
import re
import shutil
import subprocess

import numpy as np
import pytest

from swingup.export.c_header import c_header, runtime_data
from swingup.export.c_text import c_data, in_precision, runtime
from swingup.policy.guard import default_guard
from swingup.policy.numpy_backend import TorqueNetwork
from swingup.policy.shipped import load_policy

from .compiled import (
    CAREFUL,
    STRICT,
    build,
    compile_header,
    compile_program,
    gcc,
    needs_gcc,
    pointer,
    torques,
    watch,
)
from .references import DT, alone, exact, faults, numpy_run, policy, random_states, within

pytestmark = needs_gcc

PARTS = ("estimator", "identifier", "regulator", "guard")
QUICK = (("guard",), PARTS)
COMBINATIONS = [
    pytest.param(
        "acrobot-told", parts, "double", marks=[] if parts in QUICK else pytest.mark.slow, id="-".join(parts)
    )
    for number in range(len(PARTS) + 1)
    for parts in itertools.combinations(PARTS, number)
    if "identifier" not in parts or "estimator" in parts
]
"""Parts that stand together around a network: an identifier needs an estimator."""

FUZZ = """
#include <stdio.h>
#include "data.h"
#include "runtime.h"

typedef double outer; /* what printf takes */

/* A linear congruential generator: a number in [0, 1). */
static double draw(void)
{
    static uint64_t seed = 1;
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(seed >> 40) / 16777216.0;
}

/* Now and then a number that no sensor should send. */
static double spoilt(double sound)
{
    static const double values[] = {NAN, INFINITY, -INFINITY, 1e308, -1e308, 1e7, 1e3, -1e3, 5e-324, 0.0};
    return draw() < 0.002 ? values[(int)(draw() * 10.0)] : sound;
}

int main(void)
{
    static swingup_controller controller;
    double t = 0.0;
    int k, i;
    swingup_reset(&controller);
    for (k = 0; k < 20000; k++) {
        const double angle = sin(5.0 * t), rate = 5.0 * cos(5.0 * t);
        const double x[4] = {spoilt(3.0 * angle), spoilt(-2.0 * angle), spoilt(3.0 * rate), spoilt(-2.0 * rate)};
        const double when = draw() < 0.001 ? spoilt(t - 1.0) : t;
        double u[2];
        swingup_control(&controller, when, x, u);
        for (i = 0; i < 2; i++) {
            const int broken = !swingup_finite(x, 4) && !SWINGUP_HAS_GUARD && i == SWINGUP_DRIVEN;
            /* Negated, so that a torque of NaN fails. */
            if (!(fabs(u[i]) <= swingup_limits[i]) && !(broken && isnan(u[i]))) {
                printf("u[%d] = %g for %g %g at call %d\\n", i, (outer)u[i], (outer)x[0], (outer)x[1], k);
                return 1;
            }
        }
        if (swingup_guard_reason(&controller) && draw() < 0.02) {
            swingup_reset(&controller);
        }
        t += draw() < 0.01 ? 0.02 * draw() : 0.002;
    }
    return swingup_guard_sentence(&controller) == 0 || isnan(swingup_policy((const double[4]){0.1, 0.2, 0.3, 0.4}));
}
"""


def write(folder, parts, name="acrobot-told", precision="double"):
    told = policy(name)
    # Its motor gives half of what the policy asks for, and less than braking.
    weak = dataclasses.replace(told.plant, **{f"tl{told.robot.joint + 1}": 0.5 * told.torque_limit})
    braking = dataclasses.replace(default_guard(DT), braking=2.0)
    whole = dataclasses.replace(told, plant=weak, guard=braking)
    found = dataclasses.replace(whole, **{part: None for part in PARTS if part not in parts})
    fuzz = FUZZ if parts else FUZZ.replace("20000", "5000")  # a policy alone has no memory
    files = (("data.h", c_data(runtime_data(found))), ("runtime.h", runtime("contract.h")), ("fuzz.c", fuzz))
    for name, text in files:
        text = text if precision == "double" else text.replace("e308", "e38").replace("5e-324", "1e-45")
        (folder / name).write_text(in_precision(text, precision), encoding="utf-8")


COMMAND = (*STRICT, *CAREFUL, "fuzz.c")


@pytest.mark.parametrize(
    ("name", "parts", "precision"),
    [*COMBINATIONS, ("pendubot-ar-eapo", (), "double"), ("acrobot-told", PARTS, "single")],
)
def test_with_each_combination_of_switches(tmp_path, name, parts, precision):
    """Without a warning; and whatever it is sent, no torque is beyond its motor's limit."""
    write(tmp_path, parts, name, precision)
    program = build(tmp_path, *COMMAND, "-fsanitize=undefined,address", "-fno-sanitize-recover")
    result = subprocess.run([program], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


CANNOT_TELL_NAN = [
    (flag, "", "compile without -ffast-math") for flag in ("-ffast-math", "-ffinite-math-only", "-Ofast")
]


@pytest.mark.parametrize(
    ("flag", "part", "named"), [*CANNOT_TELL_NAN, ("-O2", "ESTIMATOR", "an identifier needs an estimator")]
)
def test_what_cannot_work_is_refused_by_the_compiler(tmp_path, flag, part, named):
    write(tmp_path, PARTS)
    text = (tmp_path / "data.h").read_text(encoding="utf-8").replace(f"HAS_{part} 1", f"HAS_{part} 0")
    (tmp_path / "data.h").write_text(text, encoding="utf-8")
    assert named in gcc(tmp_path, *COMMAND, flag).stderr


@pytest.mark.parametrize("name", ["acrobot-told", "acrobot-ar-eapo"])
def test_a_compiler_that_honours_no_nan_hides_no_broken_measurement(tmp_path, name):
    """Some options pass the refusal above (clang's -fno-honor-nans): NaN is tested and written by its bits."""
    text, (times, states) = c_header(policy(name)), faults()
    states = np.concatenate([numpy_run("acrobot-ar-eapo")[1][:300], states])
    times = np.concatenate([DT * np.arange(300), 300 * DT + times])
    runs = []
    for number, flag in enumerate(("-O2", "-ffinite-math-only")):
        folder = tmp_path / str(number)
        folder.mkdir()
        library = compile_header(folder, re.sub(r"#error \"compile without.*", "", text), flag)
        runs.append(watch(library, times, states)[0])
    np.testing.assert_array_equal(np.isnan(runs[1]), np.isnan(runs[0]))
    np.testing.assert_allclose(runs[1], runs[0], rtol=0, atol=1e-6)
    assert np.isnan(runs[0][:, policy(name).robot.joint]).any()


@pytest.mark.parametrize(
    "name",
    [
        "acrobot-told",
        *(pytest.param(f"acrobot-{kind}", marks=pytest.mark.slow) for kind in ("adaptive", "ar-eapo")),
    ],
)
def test_single_precision(tmp_path, name):
    """Conversions are written out; a run is near that in double precision, whose weights are the same."""
    library = compile_header(tmp_path, c_header(policy(name), precision="single"), *CAREFUL, "-O0")
    error = np.abs(torques(library, random_states()) - alone(exact(name), random_states())).max()
    assert 1e-8 < error < 1e-4
    times, states, expected = numpy_run(name)
    found = watch(library, times, states, expected)[0]
    assert np.abs(within(name, found) - within(name, expected)).max() < 0.01


@pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is not installed")
@pytest.mark.parametrize("precision", ["double", "single"])
def test_a_header_is_cplusplus_as_well(tmp_path, precision):
    text = c_header(dataclasses.replace(policy("acrobot-told"), guard=default_guard(DT)), precision=precision)
    (tmp_path / "policy.cpp").write_text(text + "int main() { return 0; }\n", encoding="utf-8")
    found = gcc(tmp_path, "g++", "-std=c++11", *STRICT[2:], *CAREFUL, "-fsyntax-only", "policy.cpp")
    assert (found.returncode, found.stderr) == (0, "")


def test_a_header_needs_no_other_file_and_no_heap():
    text = c_header(policy("acrobot-told"))
    assert "malloc" not in text
    assert set(re.findall(r"#include (.*)", text)) == {"<math.h>", "<stdint.h>", "<string.h>", "<avr/pgmspace.h>"}


PGMSPACE = """
#define PROGMEM
#define pgm_read_float(address) (*(address))
"""


def test_what_an_avrs_library_lacks(tmp_path):
    """Its branches, compiled here: the self-test of a policy that uses all of them passes."""
    (tmp_path / "avr").mkdir()
    (tmp_path / "avr" / "pgmspace.h").write_text(PGMSPACE, encoding="utf-8")
    text = c_header(policy("acrobot-told"), precision="single")
    library = compile_header(tmp_path, text, "-D__AVR__", "-I.")
    assert library.self_test() == 0
    for given, told in (
        (c_header(load_policy("ar-eapo", "acrobot"), precision="single"), "do not fit into the first 64 kB"),
        (c_header(policy("acrobot-told")), "precision single"),
    ):
        (tmp_path / "policy.h").write_text(given, encoding="utf-8")
        (tmp_path / "main.c").write_text('#include "policy.h"\n', encoding="utf-8")
        assert told in gcc(tmp_path, "gcc", "-D__AVR__", "-I.", "-fsyntax-only", "main.c").stderr


TWO = """
#include "left.h"
#include "right.h"

void both(const double *x, double *u)
{
    u[0] = left_policy(x);
    u[1] = right_policy(x);
}
"""


def test_two_policies_in_one_program(tmp_path):
    policies = [load_policy("ar-eapo", name) for name in ("acrobot", "pendubot")]
    for each, name in zip(policies, ("left", "right"), strict=True):
        (tmp_path / f"{name}.h").write_text(c_header(each, name))
    library, u = compile_program(tmp_path, TWO), np.zeros(2)
    for x in random_states()[:5]:
        library.both(pointer(np.ascontiguousarray(x)), pointer(u))
        np.testing.assert_allclose(u, [TorqueNetwork(each)(x) for each in policies], rtol=0, atol=1e-11)
