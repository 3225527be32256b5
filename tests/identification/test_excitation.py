"""Excitations: motions within limits, the choice among them, and what is checked over a prior."""

import jax
import numpy as np
import pytest
from synthetic import QUANTUM, step

from refusals import refusal
from swingup import identify, load_plant
from swingup.cli import main
from swingup.common.table import write_columns
from swingup.identification import excitation as search
from swingup.identification.excitation import (
    PERIOD,
    REST,
    SHARES,
    TILTS,
    Sequences,
    corner_models,
    draw_models,
    multisines,
    simulate,
)
from swingup.identification.prediction import INDEX, integration_of, vector_of
from swingup.identification.recording import read_recording
from swingup.identification.results import TITLES, prior_around
from swingup.loop.resolve import resolve

C1 = load_plant("C.1")
SETTING = integration_of(C1).coarse
NO_FEEDBACK = np.zeros((2, 2))


@pytest.fixture(scope="module")
def sequence():
    """Three seconds of torque on both joints."""
    time = PERIOD * np.arange(1500)
    return np.stack([1.2 * np.sin(5 * time), 0.6 * np.sin(8 * time)], axis=1)


def alone(torques, limit=6.0):
    """Torques without feedback."""
    torques = np.asarray(torques)
    return Sequences(torques, np.zeros((*torques.shape[:2], 4)), NO_FEEDBACK, np.full(2, limit))


@pytest.fixture(scope="module")
def models():
    return draw_models(prior_around(resolve(C1)), 3, 0)


@pytest.fixture(scope="module")
def trial(models, sequence):
    return simulate(SETTING, models, alone([0.1 * sequence, sequence]), keep=True)


def test_a_rollout_is_the_integrator_step_by_step(sequence, trial):
    model = vector_of(C1)[None]
    kept = simulate(SETTING, model, alone([sequence]), keep=True)
    with jax.enable_x64(True):
        advance, x = jax.jit(step), np.zeros(4)
        for u in sequence[:100]:
            x = np.asarray(advance(C1, x, u, PERIOD))
    assert kept.states[0, 0, 100] == pytest.approx(x, abs=1e-9)
    assert kept.torque[0, 0] == pytest.approx(sequence)
    assert np.all(trial.speed[1] > trial.speed[0])
    assert np.all(trial.speed >= np.abs(trial.states[..., 2:]).max(axis=(2, 3)) - 1e-12)


def test_feedback_brings_plants_together_within_the_limits(sequence, models, trial):
    reference = trial.states[1:, 0]  # of the plant in the middle
    feedback, limits = np.array([[5.0, 5.0], [1.0, 0.5]]), np.array([2.0, 0.9])
    followed = simulate(SETTING, models, Sequences(sequence[None], reference, feedback, limits), keep=True)
    assert np.all(np.abs(followed.torque) <= limits)
    assert followed.torque[0, 0] == pytest.approx(sequence, abs=1e-6)
    apart, close = (np.ptp(each.states[-1], axis=0).max() for each in (trial, followed))
    assert close < 0.5 * apart


def test_information_grows_with_motion(trial):
    slow, fast = (search.information(SETTING, states) for states in trial.states[:, 0])
    assert fast > slow
    # Ten times the angles: every entry of the matrix grows, for small angles by that factor.
    assert fast - slow > 9 * np.log(10)


def test_a_prior_around_a_plant_and_from_a_domain():
    prior = prior_around(resolve(C1))
    drawn, corners = draw_models(prior, 50, 0), corner_models(prior)
    first = INDEX["k"]
    middle = vector_of(C1)[first]
    assert drawn[0, first] == pytest.approx(middle, rel=0.02)
    assert corners[:, first].min() <= drawn[:, first].min() < 0.9 * middle
    assert corners[:, first].max() >= drawn[:, first].max() > 1.1 * middle
    assert np.array_equal(draw_models(prior, 50, 0), drawn)
    gains = draw_models(resolve(domain={"plant": "C.1", "gain1": [0.8, 1.0]}), 50, 0)[:, INDEX["gain1"]]
    assert 0.8 <= gains.min() < 0.82
    assert 0.98 < gains.max() <= 1.0


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    """Few plants, few strengths and small batches."""
    monkeypatch.setattr(search, "CHECKED_PLANTS", 4)
    monkeypatch.setattr(search, "STRENGTHS", np.array([0.6, 0.3]))
    monkeypatch.setattr(search, "LANES", 32)


SMALL = resolve(domain={"plant": "C.1", "cf1": [0.1, 0.2], "m1": [0.5, 0.55], "delay": [0.0, 0.004]})
"""A prior with few corners."""


def test_the_command_writes_what_it_checked(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(search, "prior_around", lambda facts: SMALL)
    out = tmp_path / "excitation.csv"
    assert main(["excite", "--joint", "shoulder", "--duration", "3", "--speed", "9", "--out", str(out)]) == 0
    assert "checked on" in capsys.readouterr().out
    table = np.genfromtxt(out, delimiter=",", names=True)
    names = ("time", "pos1", "pos2", "vel1", "vel2", "acc1", "acc2", "tau1", "tau2")
    assert table.dtype.names == (*names, *(f"K{joint}{entry}" for joint in (1, 2) for entry in (1, 2, 3, 4)))
    assert np.all(table["K11"] < 0)
    assert np.all(table["K12"] == 0)
    assert len(table) == 1500
    assert np.all(table["tau2"] == 0)
    assert 0 < np.abs(table["vel1"]).max() <= 9
    assert read_recording(out).driven == (True, False)
    # What is written is what was checked: the torques make that motion on the plant in the middle.
    u = np.stack([table["tau1"], table["tau2"]], axis=1)
    motion = simulate(SETTING, draw_models(SMALL, 1, 0), alone([u]), keep=True).states[0, 0]
    assert motion[:, 2] == pytest.approx(table["vel1"], abs=1e-6)


WILD = resolve(domain={"plant": "C.1", "b1": -2.0, "b2": -2.0, "cf1": 0.0, "cf2": 0.0})
"""Negative damping: the pendulum swings up by itself. Feedback tames it; torques alone do not."""


def test_torques_that_no_excitation_may_have():
    assert "within 3 rad and 20 rad/s" in refusal(search.excite, domain=WILD, duration=3, alone=True)


def test_torques_alone_have_no_feedback():
    found = search.excite(SMALL, duration=3, speed=4.0, alone=True)
    assert not found.feedback.any()
    assert np.abs(found.torque).max() > 0.0
    assert found.speed <= 4.0


def test_the_strongest_that_all_plants_bear():
    found, again = (search.excite(SMALL, duration=3, speed=4.0, angle=1.0) for _ in range(2))
    assert found.angle <= 1.0
    assert found.speed <= 4.0
    assert found.plants == 4 + len(corner_models(SMALL))
    assert np.array_equal(found.torque, again.torque)
    assert found.time.tolist() == pytest.approx(np.arange(0.0, 3.0, PERIOD).tolist())
    assert found.as_dict()["reached"]["speed"] == found.speed


def test_the_plants_own_limit_counts():
    strong, weak = {"tl1": 60.0, "tl2": 60.0}, {"torque_limit": [2.0, 6.0]}  # the weakest motors count
    domains = [resolve(domain={"plant": "C.1", **each}) for each in (strong, weak)]
    limits = [search.limits_for(each, joint) for each in domains for joint in ("both", "elbow")]
    assert [each.torque for each in limits] == [(60.0, 60.0), (0.0, 60.0), (2.0, 2.0), (0.0, 2.0)]
    assert search.limits_for(domains[0], "both", 20.0).torque == (20.0, 20.0)
    # In the loop of another robot as well, whose motors have 6 N m; so is the prior around the plant.
    for domain in ("recorded", None):
        prior = prior_around(resolve("cloudpendulum", domain))
        assert search.limits_for(prior, "both").torque == pytest.approx((0.13, 0.13))


@pytest.mark.slow
@pytest.mark.parametrize("domain", ["recorded", None])
def test_torques_are_those_of_the_plants_motors(domain):
    found = search.excite("cloudpendulum", domain, duration=3.0)
    assert 0 < np.abs(found.torque).max() <= max(found.limits.torque) == pytest.approx(0.13)


def test_a_prior_keeps_what_the_plants_file_says(tmp_path):
    (tmp_path / "mine.yml").write_text("plant: cloudpendulum\ndelay: 0.004\ntl2: 0.1\n")
    prior = prior_around(resolve(tmp_path / "mine.yml", "recorded"))
    low, high = prior.low, prior.high
    assert (low.plant.tl1, low.plant.tl2, high.plant.tl2) == (0.13, 0.1, 0.1)
    assert (low.loop.delay, high.loop.delay) == (0.004, 0.004)
    assert (low.loop.lag, high.loop.lag) == (0.001, 0.004)
    assert low.plant.m1 == high.plant.m1
    assert low.plant.I2 < load_plant("cloudpendulum").I2 < high.plant.I2


def test_positions_are_those_that_the_encoders_show(tmp_path):
    """The feedback would pull a pendulum towards other zeros."""
    rest = np.zeros((5, 2)), np.zeros((5, 4)), np.ones((2, 2))
    search.Excitation(*rest, None, 0.0, 0.0, 1, zeros=(0.25, -0.1)).save(tmp_path / "excitation.csv")
    table = np.genfromtxt(tmp_path / "excitation.csv", delimiter=",", names=True)
    assert (set(table["pos1"]), set(table["pos2"])) == ({0.25}, {-0.1})


@pytest.mark.slow
def test_an_excitation_lets_identify_find_a_plant_of_the_prior(tmp_path):
    prior = prior_around(resolve(C1))
    excitation = search.excite(prior, duration=6.0, seed=1)
    truth = draw_models(prior, 4, 123)[3:]
    limits = np.array(excitation.limits.torque)
    play = Sequences(excitation.torque[None], excitation.state[None], excitation.feedback, limits)
    motion = simulate(integration_of(C1), truth, play, keep=True)
    q = QUANTUM * np.round(motion.states[0, 0, :, :2] / QUANTUM)
    columns = {"time": excitation.time, "pos_meas1": q[:, 0], "pos_meas2": q[:, 1]}
    columns |= {f"tau_con{joint + 1}": motion.torque[0, 0, :, joint] for joint in (0, 1)}
    write_columns(tmp_path / "log.csv", columns)
    found = identify([tmp_path / "log.csv"]).estimates
    truth[0, INDEX["A"]] -= truth[0, INDEX["B"]]  # results have what link 1 adds
    for name in ("k", "m2r2", "A", "B", "cf1", "cf2"):
        title, value = TITLES.get(name, name), truth[0, INDEX[name]]
        assert found.values[title] == pytest.approx(value, rel=0.08)
        assert found.determined[title]


def test_motions_start_and_end_at_rest_and_no_two_are_alike():
    motions = multisines(4.0, 0.75, 2.0, np.array([1.0, 0.0]))
    assert len(motions) == len(TILTS) * len(SHARES) == 12
    q, dq = motions[..., :2], motions[..., 2:]
    assert np.all(q[..., 1] == 0)
    reached = np.abs(q[..., 0]).max(axis=1).reshape(len(TILTS), len(SHARES))
    assert np.all(reached <= 2.0 * np.array(SHARES)[:, 0] + 1e-12)
    assert np.all(reached > np.array(SHARES)[:, 0])
    assert np.all(q[:, 0] == 0)
    assert np.all(motions[:, round((1 - REST) * 4.0 / PERIOD) + 1 :] == 0)
    assert np.diff(q, axis=1) / PERIOD == pytest.approx(0.5 * (dq[:, 1:] + dq[:, :-1]), abs=0.03)
    both = multisines(10.0, 0.75, 2.0, np.ones(2))[..., :2]
    alike = np.corrcoef(np.concatenate([each.T for each in both]))[::2, 1::2]
    assert np.all(np.abs(np.diag(alike)) < 0.3)
