"""The C header beyond the conformance table: single precision, the file's numbers, two in one program."""

import re
from dataclasses import replace

import numpy as np
import pytest

from swingup.export.c_backend.header import c_header
from swingup.policy.guard.settings import default_guard
from swingup.policy.numpy_backend.network import NumpyNetwork
from swingup.policy.shipped import load_policy

from . import references
from .compiled import CAREFUL, compile_header, compile_program, needs_gcc, pointer, torques
from .references import DT, SIGHTED, TOLD, alone, random_states

pytestmark = needs_gcc


def test_in_single_precision(tmp_path):
    library = compile_header(tmp_path, c_header(load_policy("ar-eapo", "acrobot")), "-DSWINGUP_REAL=float")
    error = np.abs(torques(library, random_states()) - alone("acrobot-ar-eapo", random_states())).max()
    assert 1e-6 < error < 1e-4


@pytest.mark.parametrize("name", [SIGHTED, TOLD])
def test_conversions_are_written_out(tmp_path, name):
    """A folded bias and all constants are double, the network is float; ``test_c_runtime.py`` has it in double."""
    text = c_header(replace(references.policy(name), guard=default_guard(DT)))
    compile_header(tmp_path, text, *CAREFUL, "-DSWINGUP_REAL=float", "-O0")


@pytest.mark.parametrize("name", ["acrobot", "pendubot"])
def test_numbers_are_the_files(name):
    """The header's decimals are the file's float32 numbers, input by input."""
    policy = load_policy("ar-eapo", name)
    text = c_header(policy)
    for index, layer in enumerate(policy.network.layers):
        body = re.search(rf"swingup_weight_{index}\[\d+\] = {{(.*?)}};", text, re.DOTALL)[1]
        numbers = np.array(re.findall(r"[-+\d.e]+(?=f)", body), np.float32)
        np.testing.assert_array_equal(numbers.reshape(layer.weight.T.shape), layer.weight.T)
    assert "@" not in text
    assert "malloc" not in text
    assert set(re.findall(r"#include (.*)", text)) == {"<math.h>", "<stdint.h>"}


TWO = """
#include "left.h"
#include "right.h"

void both(const double *x, double *u);

void both(const double *x, double *u)
{
    u[0] = left_policy(x);
    u[1] = right_policy(x);
}
"""


def test_two_policies_in_one_program(tmp_path):
    policies = [load_policy("ar-eapo", name) for name in ("acrobot", "pendubot")]
    for policy, name in zip(policies, ("left", "right"), strict=True):
        (tmp_path / f"{name}.h").write_text(c_header(policy, name))
    library, u = compile_program(tmp_path, TWO), np.zeros(2)
    for x in random_states()[:5]:
        library.both(pointer(np.ascontiguousarray(x)), pointer(u))
        np.testing.assert_allclose(u, [NumpyNetwork(policy)(x) for policy in policies], rtol=0, atol=1e-11)
