"""A fit of one short simulated log, whose plant, offsets and delay are known."""

import importlib
import itertools
import json
from types import SimpleNamespace

import numpy as np
import pytest
from synthetic import OFFSETS, TRUTH, simulate, write

import swingup
from refusals import refusal
from swingup.common.errors import SwingupError
from swingup.identification import fit as bootstrap
from swingup.identification import prediction
from swingup.identification.fit import Evaluator, linearise
from swingup.identification.prediction import INDEX, integration_of, vector_of
from swingup.identification.results import USUAL_LATENCY, bound_notes
from swingup.identification.unknowns import Problem
from swingup.loop.resolve import resolve
from swingup.plant.base_parameters import base_parameters
from swingup.plant.files import load_plant

BASE = ("m1 r1 + m2 l1", "m2 r2", "I1 + m2 l1^2", "I2", "Ir", "b1", "b2", "cf1", "cf2")


def expected_of(plant):
    """What a perfect fit reads of a plant."""
    a, b, second, first, *friction, rotor = base_parameters(plant)
    return dict(zip(BASE, [first, second, a - b, b, rotor, *friction], strict=True))


EXPECTED = expected_of(TRUTH)
RATIO = "(m2 r2) / (m1 r1 + m2 l1)"


@pytest.fixture(scope="module", autouse=True)
def _small_programs():
    """All windows of a log of 4 s at a time, and no more; and few draws."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(prediction, "CHUNK", 34)
        patch.setattr(bootstrap, "DRAWS", 100)
        yield


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    return [str(write(folder / f"{seed}.csv", simulate(4.0, seed))) for seed in (0, 1)]


@pytest.fixture(scope="module")
def found(logs):
    return swingup.identify(logs[:1], test=logs[1:])


def test_the_plant_is_found_and_what_the_log_determines(found):
    for name, tolerance in zip(BASE, [0.01, 0.01, 0.01, 0.01, 0.05, 0.5, 0.5, 0.03, 0.03], strict=True):
        assert found.estimates.values[name] == pytest.approx(EXPECTED[name], rel=tolerance), name
    assert [found.estimates.values[name] for name in ("offset1", "offset2")] == pytest.approx(OFFSETS, abs=2e-3)
    assert found.estimates.values["delay + lag"] == pytest.approx(0.003, abs=3e-4)
    sure = found.estimates.determined
    assert all(sure[name] for name in (*BASE[:5], "cf1", "cf2", "delay + lag"))
    # The sum of delay and lag is known, the parts are not; and m and r only as a product.
    assert not any(sure[name] for name in ("m1", "r1", "m2", "r2", "torque gain"))
    for name in BASE[:5]:
        low, high = found.estimates.intervals[name]
        assert low <= high <= low + 0.2 * EXPECTED[name]


def test_errors_are_below_those_of_the_start(found):
    result = found.as_dict()
    assert list(result) == ["parameters", "intervals", "determined", "errors"]
    fitted, start = (result["errors"][name] for name in ("fitted", "start"))
    for horizon, quantity in itertools.product(("0.1", "0.25", "0.5"), ("angle", "velocity")):
        assert fitted[horizon][quantity] < 0.3 * start[horizon][quantity]
    json.dumps(result, allow_nan=False)


def test_files_are_those_that_others_read(found, tmp_path):
    domain = found.save(tmp_path / "mine.yml", tmp_path / "mine.urdf", tmp_path / "mine.xml")
    plant = load_plant(tmp_path / "mine.yml")
    for ending in ("urdf", "xml"):
        assert load_plant(tmp_path / f"mine.{ending}").values() == pytest.approx(plant.values(), rel=1e-12)
    assert expected_of(plant) == pytest.approx({name: found.estimates.values[name] for name in BASE}, rel=1e-9)
    # Links that could be built: inertia above that of a point mass at the centre of mass.
    assert plant.m1 * plant.r1**2 < plant.I1
    assert plant.m2 * plant.r2**2 < plant.I2
    ranges = resolve(domain=domain)
    assert ranges.nominal_plant.cf1 == pytest.approx(TRUTH.cf1, rel=0.05)


def test_a_model_that_is_refused_leaves_nothing(found, tmp_path, monkeypatch):
    def refuse(*_):
        raise SwingupError("no bodies move as this plant does")

    module = importlib.import_module("swingup.identification.identify")
    save = module.save_plant
    monkeypatch.setattr(
        module, "save_plant", lambda path, *rest: refuse() if path.suffix == ".urdf" else save(path, *rest)
    )
    assert "no bodies" in refusal(found.save, tmp_path / "mine.yml", tmp_path / "mine.urdf")
    assert list(tmp_path.iterdir()) == []


def test_a_log_at_rest_determines_nothing(tmp_path):
    table = simulate(3.0, torque=(0.05, 0.05))
    found = swingup.identify([write(tmp_path / "rest.csv", table)])
    assert not any(found.estimates.determined.values())
    assert found.as_dict()["errors"]["fitted"]["0.25"] == {"angle": None, "velocity": None}
    assert any("determine next to nothing" in note for note in found.notes)


@pytest.mark.slow
def test_a_free_fall_determines_ratios_alone(tmp_path):
    logs = [
        write(tmp_path / f"{k}.csv", simulate(6.0, k, (0.0, 0.0), start))
        for k, start in enumerate([(2.5, 1.0, 0.0, 0.0), (-1.5, 2.0, 0.0, 0.0)])
    ]
    identified = swingup.identify(logs)
    found = identified.estimates
    # Nothing shows the loop, of which the domain keeps what is usual.
    assert {name: tuple(identified.domain[name]) for name in USUAL_LATENCY} == USUAL_LATENCY
    assert [name for name in (*BASE, RATIO) if found.determined[name]] == [RATIO]
    assert found.values[RATIO] == pytest.approx(EXPECTED["m2 r2"] / EXPECTED["m1 r1 + m2 l1"], rel=0.01)
    # A rotor without inertia has no scale; one known value above 0 gives that of all.
    assert swingup.identify(logs, known={"Ir": 0.0}).estimates.determined[RATIO]
    known = swingup.identify(logs, known={"m2r2": float(EXPECTED["m2 r2"])})
    assert known.estimates.values["I2"] == pytest.approx(EXPECTED["I2"], rel=0.02)


@pytest.mark.slow
def test_a_second_session_has_its_own_torque_gain(tmp_path, logs):
    weak = simulate(6.0, 5)
    weak[:, 5:] /= 0.8  # the motors deliver 0.8 of what the log says
    found = swingup.identify([*logs, write(tmp_path / "weak.csv", weak)], sessions=["a", "a", "b"])
    assert found.estimates.values["torque gain @2"] == pytest.approx(0.8, rel=0.01)
    assert found.estimates.values["m2 r2"] == pytest.approx(EXPECTED["m2 r2"], rel=0.01)


def test_a_known_gain_is_that_of_both_motors():
    log = SimpleNamespace(driven=(True, False), commanded=True)
    problem = Problem(integration_of(TRUTH), vector_of(TRUTH), [log, log], [0, 1], {"gain1": 0.8})
    unknowns, gains = problem.unknowns(plant=True), [INDEX["gain1"], INDEX["gain2"]]
    assert not {*gains} & {*unknowns.entries.tolist()}
    np.testing.assert_array_equal(unknowns.models(unknowns.start)[:, gains], 0.8)


@pytest.mark.parametrize(("known", "free"), [({}, [2]), ({"Ir": 6e-5}, [2]), ({"B": 0.05}, [1, 2])])
def test_the_first_session_with_torques_is_the_unit(known, free):
    """A data sheet's rotor says too little of the masses to be the unit; a link's inertia says it."""
    logs = [SimpleNamespace(driven=(bool(each), False), commanded=True) for each in range(3)]
    logs[2].driven = (False, True)
    problem = Problem(integration_of(TRUTH), vector_of(TRUTH), logs, [0, 1, 2], known)
    assert problem.unit_session == 1
    assert np.flatnonzero(problem.unknowns(plant=True).place[:, INDEX["gain1"]] >= 0).tolist() == free


def test_what_ends_at_a_bound_is_a_note():
    """Of two sessions the second's offset, the shared m2 r2, and a loop that is as late as the fit allows."""
    log = SimpleNamespace(driven=(True, False), commanded=True)
    unknowns = Problem(integration_of(TRUTH), vector_of(TRUTH), [log, log], [0, 1], {}).unknowns(plant=True)
    z = np.array(0.5 * (unknowns.low + unknowns.high))
    assert not any("bound" in note for note in bound_notes(unknowns, z))
    for session, name, ends in (
        (0, "m2r2", unknowns.high),
        (1, "offset1", unknowns.low),
        (1, "delay", unknowns.high),
    ):
        number = unknowns.place[session, INDEX[name]]
        z[number] = ends[number]
    notes = bound_notes(unknowns, z)
    value = 10 * TRUTH.m2 * TRUTH.r2
    assert notes[0].startswith(f"at a bound of the fit: m2r2 = {value:.3g} of {value:.3g}; likely another unit")
    assert notes[1].startswith(
        "at a bound of the fit: offset1 @2 = -0.25 of -0.25; likely a zero that is farther off"
    )
    assert "delay @2 = 0.025 of 0.025" in notes[2]
    assert "ms late" in notes[3]


def test_a_fit_is_never_worse_than_its_start(logs, monkeypatch):
    """A fit that went wrong is pulled back towards its start until held-out motion is predicted best."""
    module = importlib.import_module("swingup.identification.identify")
    spoilt = []

    def astray(problem, windows, start):
        unknowns = problem.unknowns(plant=True)
        z = np.clip(unknowns.position(start) + 0.7, unknowns.low, unknowns.high)
        spoilt.append(linearise(Evaluator(problem.setting, windows, unknowns), z))
        return spoilt[-1]

    monkeypatch.setattr(module, "fit_all", astray)
    monkeypatch.setattr(module, "check_columns", lambda *given: ())
    monkeypatch.setattr(bootstrap, "DRAWS", 10)
    found = swingup.identify(logs[:1], test=logs[1:], start=TRUTH)
    fitted, start = (found.errors[name]["0.25"].angle for name in ("fitted", "start"))
    assert fitted <= start
    assert "worse than the starting plant" in found.notes[0]
    assert not np.allclose(found.models[0], spoilt[0].models[0])
    # What the logs said stays possible.
    low, high = found.estimates.intervals["m2 r2"]
    ends = sorted([spoilt[0].models[0][INDEX["m2r2"]], found.estimates.values["m2 r2"]])
    assert low <= ends[1] - 0.5 * (ends[1] - ends[0]) <= high
    assert high - low > 0.5 * (ends[1] - ends[0])


def test_columns_of_another_sign_are_named(tmp_path, logs):
    assert "unknown known value 'mass'" in refusal(swingup.identify, logs[:1], known={"mass": 1.0})
    assert "2 sessions for 1 logs" in refusal(swingup.identify, logs[:1], sessions=["a", "b"])
    table = np.loadtxt(logs[0], delimiter=",", skiprows=1) * [*5 * [1], -1, -1]
    message = refusal(swingup.identify, [write(tmp_path / "wrong.csv", table)])
    assert message.endswith("--columns u1=-tau_con1 u2=-tau_con2, or take it as it is with --force")
