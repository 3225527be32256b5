"""Policy files that are damaged or made to harm: each is refused in one short line, or its torques are finite."""

import copy
import json
import random

import numpy as np
import pytest

from array_files import write_file
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

HUGE = [1e300, 1e308, -1e300, float("nan"), float("inf"), 10**400, 2**63, 1e-300, 0, -1]
WRONG = [None, True, "", "x", "a\nb\x1b[31m", [], {}, [[]], {"a": 1}, [None], "A" * 100_000, *HUGE]


def arrays(hidden=4):
    rng = np.random.default_rng(0)
    shapes = {"trunk.0": (hidden, 6), "trunk.1": (hidden, hidden), "mean": (1, hidden)}
    made = {f"network.{name}.weight": rng.normal(size=shape).astype(np.float32) for name, shape in shapes.items()}
    made |= {f"network.{name}.bias": np.zeros(shape[0], np.float32) for name, shape in shapes.items()}
    return made | {"observation.1.mean": np.zeros(6), "observation.1.variance": np.ones(6)}


def write(path, metadata, values):
    write_file(path, metadata, values)


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


def test_the_file_itself_is_good(tmp_path):
    write(tmp_path / "p.safetensors", METADATA, arrays())
    assert try_it(tmp_path / "p.safetensors")


@pytest.mark.parametrize("value", [1e300, 1e39, np.nan, np.inf])
def test_numbers_that_single_precision_cannot_hold(tmp_path, value):
    """A float64 weight of 1e300 is finite until the network takes it."""
    for name in ("network.trunk.1.weight", "network.mean.bias", "observation.1.mean", "observation.1.variance"):
        values = arrays()
        values[name] = np.full(values[name].shape, value)
        write(tmp_path / "p.safetensors", METADATA, values)
        with pytest.raises(SwingupError, match=f"array {name} holds values that are not finite"):
            read_pendulum_policy(tmp_path / "p.safetensors")


def test_weights_that_overflow_only_together(tmp_path):
    values = {name: np.full_like(value, 1e20) for name, value in arrays().items()}
    write(tmp_path / "p.safetensors", METADATA, values)
    with pytest.raises(SwingupError, match=r"or a layer may reach 1e\+30: train another"):
        read_pendulum_policy(tmp_path / "p.safetensors")


@pytest.mark.parametrize("dtype", ["i4", "u1", "?", "u8"])
def test_arrays_of_other_kinds(tmp_path, dtype):
    values = arrays()
    values["network.mean.bias"] = np.zeros(1).astype(dtype)
    write(tmp_path / "p.safetensors", METADATA, values)
    assert not try_it(tmp_path / "p.safetensors")


@pytest.mark.parametrize("shape", [(), (0,), (1,), (0, 4), (4, 0), (1, 1, 1), (3,), (1,) * 32, (4, 4)])
@pytest.mark.parametrize("name", ["network.trunk.0.weight", "network.mean.bias", "observation.1.variance"])
def test_arrays_of_other_shapes(tmp_path, name, shape):
    write(tmp_path / "p.safetensors", METADATA, arrays() | {name: np.zeros(shape, np.float32)})
    fits = shape == arrays()[name].shape
    assert try_it(tmp_path / "p.safetensors") == fits


def test_unknown_arrays_are_left_alone(tmp_path):
    more = {"network.trunk.1000.weight": np.zeros(3), "observation.0.x": np.array([True]), "zzz": np.zeros(2)}
    write(tmp_path / "p.safetensors", METADATA, arrays() | more)
    assert try_it(tmp_path / "p.safetensors")


@pytest.mark.parametrize("value", WRONG, ids=lambda value: repr(value)[:20])
@pytest.mark.parametrize(
    "place",
    ["robot", "torque_limit", "observation", "estimator", "identifier", "regulator", "choices", "format_version"],
)
def test_metadata_of_wrong_kinds(tmp_path, place, value):
    write(tmp_path / "p.safetensors", METADATA | {place: value}, arrays())
    accepted = try_it(tmp_path / "p.safetensors")
    # {} are default settings, and an array that is given is only needed by its stage.
    settings = {part: [{}] for part in ("estimator", "identifier", "regulator")}
    allowed = settings | {"torque_limit": [2**63]}
    assert not accepted or value in allowed.get(place, [])
    assert accepted or place not in settings or value != {}


@pytest.mark.parametrize("value", WRONG, ids=lambda value: repr(value)[:20])
def test_settings_of_wrong_kinds(tmp_path, value):
    for part, names in (
        ("estimator", ("dt", "velocity_noise", "max_delay_steps")),
        ("identifier", ("passive_limit",)),
        ("regulator", ("enter", "leave")),
    ):
        for name in names:
            write(tmp_path / "p.safetensors", METADATA | {part: {name: value}}, arrays())
            try_it(tmp_path / "p.safetensors")
    for name in ("name", "angles", "velocity_scale", "clip", "epsilon", "x"):
        stages = copy.deepcopy(METADATA["observation"])
        stages[name in ("clip", "epsilon")][name] = value
        write(tmp_path / "p.safetensors", METADATA | {"observation": stages}, arrays())
        try_it(tmp_path / "p.safetensors")


@pytest.mark.parametrize(
    "text",
    ["", "{", "null", "[]", "1", "[" * 100_000 + "]" * 100_000, '{"a":' * 20_000 + "1" + "}" * 20_000,
     "\xff\xfe{}", json.dumps(METADATA).replace("6.0", "9" * 5000)],
    ids=range(9),
)  # fmt: skip
def test_metadata_that_is_no_object(tmp_path, text):
    write(tmp_path / "p.safetensors", text, arrays())
    assert not try_it(tmp_path / "p.safetensors")


def mutated(generator, value):
    """A JSON value with one change somewhere."""
    if isinstance(value, dict) and value and generator.random() < 0.8:
        name, kind, value = generator.choice(list(value)), generator.random(), dict(value)
        if kind < 0.2:
            del value[name]
        elif kind < 0.5:
            value[name] = generator.choice(WRONG)
        else:
            value[name] = mutated(generator, value[name])
        return value
    if isinstance(value, list) and value and generator.random() < 0.8:
        index, value = generator.randrange(len(value)), list(value)
        value[index] = mutated(generator, value[index])
        return value if generator.random() < 0.9 else value * 50
    return generator.choice(WRONG)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 20))])
def test_mutated_metadata(tmp_path, seed):
    generator, accepted, good = random.Random(seed), 0, arrays()
    for _ in range(200):
        metadata = METADATA
        for _ in range(generator.choice([1, 1, 2])):
            metadata = mutated(generator, metadata)
        write(tmp_path / "p.safetensors", metadata, good)
        accepted += try_it(tmp_path / "p.safetensors")
    assert 0 < accepted < 200
