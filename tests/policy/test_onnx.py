"""The ONNX graph beyond the conformance table: batches of any size, and what it needs."""

import sys

import numpy as np
import pytest

from swingup.common.errors import SwingupError
from swingup.export.onnx_backend.graph import onnx_model
from swingup.policy.shipped import load_policy

from .backends import Onnx
from .references import TOLERANCE, random_states


@pytest.mark.parametrize("robot", ["acrobot", "pendubot"])
def test_batches_of_any_size(robot, tmp_path):
    found, states = Onnx(load_policy("ar-eapo", robot), tmp_path), random_states()[:1000]
    single = [found.alone(x[None])[0] for x in states]
    np.testing.assert_allclose(single, found.alone(states), rtol=0, atol=TOLERANCE)
    assert found.alone(states[:0]).shape == (0,)


def test_without_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(SwingupError, match=r"onnx is not installed: pip install 'swingup\[onnx\]'"):
        onnx_model(load_policy("ar-eapo", "acrobot"))
