"""The ONNX graph in ONNX Runtime: its torques are the judge's, for any batch."""

import sys

import numpy as np
import pytest

from swingup.errors import SwingupError
from swingup.physics.parameters import get_robot
from swingup.policy.jax_backend.controller import save_controller
from swingup.policy.numpy_backend.controller import RuntimeController
from swingup.policy.onnx_backend.graph import onnx_model
from swingup.policy.shipped import read_policy

from .loops import TOLERANCE, UNSOUND, judged_torques, paper_policy, random_states


def session(policy):
    """An inference session of a policy's graph."""
    pytest.importorskip("onnx", reason="onnx is not installed")
    runtime = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
    return runtime.InferenceSession(onnx_model(policy), providers=["CPUExecutionProvider"])


@pytest.mark.parametrize("kind", ["refined", "ar-eapo"])
@pytest.mark.parametrize("name", ["acrobot", "pendubot"])
def test_torques_are_the_judges(name, kind):
    states, joint = random_states(), get_robot(name).joint
    expected = judged_torques(name, kind)
    model = session(read_policy(kind, name))
    batch = model.run(None, {"state": states})[0]
    assert batch.dtype == np.float64
    np.testing.assert_allclose(batch[:, joint], expected, rtol=0, atol=TOLERANCE)
    assert not batch[:, 1 - joint].any()
    single = [model.run(["torque"], {"state": x[None]})[0][0, joint] for x in states[:1000]]
    np.testing.assert_allclose(single, expected[:1000], rtol=0, atol=TOLERANCE)
    assert model.run(None, {"state": states[:0]})[0].shape == (0, 2)
    assert np.isnan(model.run(None, {"state": UNSOUND})[0][:, joint]).all()


@pytest.mark.parametrize("normalised", [True, False])
def test_the_papers_observation(tmp_path, normalised):
    save_controller(tmp_path / "p.npz", paper_policy(normalised), {})
    policy = read_policy(tmp_path / "p.npz")
    controller, states = RuntimeController(policy), random_states()[:500]
    expected = np.array([controller(x, 0.0) for x in states])
    np.testing.assert_allclose(session(policy).run(None, {"state": states})[0], expected, rtol=0, atol=1e-6)


def test_without_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(SwingupError, match=r"onnx is not installed: pip install 'swingup\[onnx\]'"):
        onnx_model(read_policy("refined", "acrobot"))
