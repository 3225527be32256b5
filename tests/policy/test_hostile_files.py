"""Policy files that are damaged or made to harm: each is refused in one short line, or its torques are finite."""

import copy
import json
import random

import numpy as np
import pytest

from array_files import write_file
from fuzz.mutations import EXTREMES, LINES, mutate, several
from swingup.common.errors import SwingupError
from swingup.export.c_backend.header import c_header
from swingup.plant.plant import load_plant
from swingup.plant.robots import get_robot
from swingup.policy.file import FORMAT, FORMAT_VERSION
from swingup.policy.numpy_backend.controller import numpy_controller
from swingup.policy.pendulum import read_pendulum_policy
from swingup.policy.plant_facts import policy_plant, write_plant

METADATA = {
    "format": FORMAT,
    "format_version": FORMAT_VERSION,
    "robot": "acrobot",
    "torque_limit": 6.0,
    "observation": [{"name": "pendulum", "angles": "sincos"}, {"name": "normalise", "clip": 10.0, "epsilon": 1e-8}],
    "estimator": {"velocity_noise": 0.25, "max_delay_steps": 25},
    "plant": write_plant(policy_plant(load_plant("C.1"), get_robot("acrobot"))),
    "guard": {"velocity_limit": 1000.0, "torque_rate": 500.0, "braking": 0.1},
}


def arrays(hidden=4):
    rng = np.random.default_rng(0)
    shapes = {"trunk.0": (hidden, 6), "trunk.1": (hidden, hidden), "mean": (1, hidden)}
    made = {f"network.{name}.weight": rng.normal(size=shape).astype(np.float32) for name, shape in shapes.items()}
    made |= {f"network.{name}.bias": np.zeros(shape[0], np.float32) for name, shape in shapes.items()}
    return made | {"observation.1.mean": np.zeros(6), "observation.1.variance": np.ones(6)}


def try_it(path):
    """Whether the file was accepted; one that is must run and have a header."""
    try:
        policy = read_pendulum_policy(path)
    except SwingupError as error:
        refusal = str(error)
    else:
        refusal = ""
    assert len(refusal) < 1000
    assert refusal.isprintable()
    if refusal:
        return False
    controller = numpy_controller(policy)
    torques = [controller(np.array([0.1 * k, 0.2, 300.0, -0.1]), 0.002 * k) for k in range(3)]
    assert np.isfinite(torques).all()
    text = c_header(policy)
    assert "inff" not in text
    assert "nanf" not in text
    return True


ARRAYS = arrays()
STRANGE = {
    **{f"dtype {dtype}": {"network.mean.bias": np.zeros(1, dtype)} for dtype in ("i4", "u1", "?", "u8")},
    **{
        f"{name} {shape}": {name: np.zeros(shape, np.float32)}
        for name in ("network.trunk.0.weight", "network.mean.bias", "observation.1.variance")
        for shape in [(), (0,), (0, 4), (4, 0), (1, 1, 1), (3,), (1,) * 32, (4, 4)]
    },
    "overflow together": {name: np.full_like(value, 1e20) for name, value in ARRAYS.items()},
}


def test_arrays_of_other_kinds_and_shapes(tmp_path):
    path = tmp_path / "p.safetensors"
    more = {"network.trunk.1000.weight": np.zeros(3), "observation.0.x": np.array([True]), "zzz": np.zeros(2)}
    write_file(path, METADATA, ARRAYS | more)
    assert try_it(path)  # unknown ones are left alone
    for name, strange in STRANGE.items():
        write_file(path, METADATA, ARRAYS | strange)
        assert not try_it(path), name


@pytest.mark.parametrize("value", EXTREMES, ids=lambda value: repr(value)[:20])
def test_metadata_of_wrong_kinds(tmp_path, value):
    path, settings = tmp_path / "p.safetensors", ("estimator", "identifier", "regulator")
    for place in ("robot", "torque_limit", "observation", *settings, "choices", "format_version"):
        write_file(path, METADATA | {place: value}, ARRAYS)
        # {} are default settings, and 1 is the version, and some numbers are torques.
        assert not try_it(path) or (place in settings and value == {}) or isinstance(value, int | float | str)
    for part, name in (("estimator", "dt"), ("estimator", "max_delay_steps"), ("identifier", "passive_limit"),
                       ("regulator", "enter"), ("guard", "braking")):  # fmt: skip
        write_file(path, METADATA | {part: {name: value}}, ARRAYS)
        try_it(path)
    for name in ("name", "angles", "velocity_scale", "clip", "epsilon", "x"):
        stages = copy.deepcopy(METADATA["observation"])
        stages[name in ("clip", "epsilon")][name] = value
        write_file(path, METADATA | {"observation": stages}, ARRAYS)
        try_it(path)


@pytest.mark.parametrize(
    "text", [*LINES, json.dumps(METADATA).replace("6.0", "9" * 5000)], ids=lambda text: text[:9]
)
def test_metadata_that_is_no_object(tmp_path, text):
    write_file(tmp_path / "p.safetensors", text, ARRAYS)
    assert not try_it(tmp_path / "p.safetensors")


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 20))])
def test_mutated_metadata(tmp_path, seed):
    generator, accepted = random.Random(seed), 0
    for _ in range(200):
        write_file(tmp_path / "p.safetensors", json.dumps(several(generator, mutate, METADATA)), ARRAYS)
        accepted += try_it(tmp_path / "p.safetensors")
    assert 0 < accepted < 200
