"""Swing-ups to follow: the shipped ones, their optimum, their files, and RealAIGym's CSV format."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import swingup
from array_files import change_file
from refusals import refusal
from swingup.benchmark.recording import load_trajectory
from swingup.cli import main
from swingup.controllers.baselines.baselines import shipped_reference
from swingup.controllers.baselines.settings import OPTIMAL_SETTINGS, PUBLISHED_SETTINGS, SEARCH
from swingup.controllers.baselines.tracking import RiccatiController
from swingup.controllers.swingups import design
from swingup.controllers.swingups.design import compute_reference
from swingup.controllers.swingups.reference import (
    REFERENCE_ARRAYS,
    Reference,
    load_reference,
    save_reference,
    save_reference_csv,
)
from swingup.controllers.swingups.transition import PendulumTransition, TorqueRateTransition
from swingup.dynamics.dynamics import UPRIGHT
from swingup.dynamics.integrate import rk4_step
from swingup.plant.files import save_plant
from swingup.plant.plant import LEADERBOARD, ROBOTS

ACROBOT = ROBOTS["acrobot"]


@pytest.mark.parametrize(
    ("problem", "name", "dt", "off"), [("published", "tvlqr", 0.001, 2e-3), ("score", "tvlqr-score", 0.002, 5e-3)]
)
def test_shipped_trajectories_obey_the_equations_of_motion(x64, robot, problem, name, dt, off):
    reference, metadata = shipped_reference(robot, problem)
    steps = 5999 if problem == "published" else OPTIMAL_SETTINGS[robot.name].swingup.steps
    assert (reference.robot, reference.dt, len(reference.torque)) == (robot, dt, steps)
    assert reference.time[-1] == pytest.approx((steps - 1) * dt)
    p, u = LEADERBOARD.driven(robot), reference.torque[:, None] * np.array(robot.actuation)
    following = jax.jit(jax.vmap(lambda x, u: rk4_step(p, x, u, dt)))(reference.states[:-1], u[:-1])
    np.testing.assert_allclose(reference.states[1:], following, atol=1e-12)
    np.testing.assert_array_equal(reference.states[0], 0.0)
    np.testing.assert_allclose(reference.states[-1], UPRIGHT, atol=off)
    assert np.abs(reference.torque).max() < 6.0
    assert {"cost", "iterations", "status", "version"} <= set(metadata)
    assert problem == "published" or metadata["status"] == "converged"
    assert f"export {name} --robot={robot.name} --to=trajectory --seed={metadata['seed']} " in metadata["command"]


def test_shipped_trajectories_have_the_published_figures(robot):
    # Published torques reach 2.6 and 1.6 N m, velocity costs are 105.8 and 211.1.
    reference, _ = shipped_reference(robot)
    largest, velocity_cost = {"acrobot": (2.6, 105.83), "pendubot": (1.6, 211.12)}[robot.name]
    assert np.abs(reference.torque).max() == pytest.approx(largest, abs=0.06)
    assert np.sum(reference.states[:, 2:] ** 2) * 0.001 == pytest.approx(velocity_cost, abs=0.5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "problem", "settings", "rtol", "atol"),
    [("acrobot", "published", PUBLISHED_SETTINGS, 1e-6, 1e-3)]
    + [(name, "score", OPTIMAL_SETTINGS, 1e-4, 1e-2) for name in ROBOTS],
)
def test_a_shipped_trajectory_can_be_recomputed(name, problem, settings, rtol, atol):
    """But for the published pendubot's, which takes four times as long."""
    shipped, metadata = shipped_reference(name, problem)
    reference, provenance = compute_reference(name, settings[name].swingup, metadata["seed"])
    assert provenance["cost"] == pytest.approx(metadata["cost"], rel=rtol)
    np.testing.assert_allclose(reference.torque, shipped.torque, atol=atol)


@pytest.mark.slow
def test_the_optimiser_stays_at_the_pendubots_trajectory(monkeypatch):
    pendubot = ROBOTS["pendubot"]
    shipped, metadata = shipped_reference(pendubot)
    problem = dataclasses.replace(PUBLISHED_SETTINGS["pendubot"].swingup, search=SEARCH)
    # A search that finds it at once.
    monkeypatch.setattr(design, "_searched", lambda *_: (problem, shipped.torque))
    found, provenance = compute_reference(pendubot, problem, metadata["seed"])
    assert (provenance["status"], provenance["iterations"]) == ("converged", 1)
    assert provenance["cost"] == pytest.approx(metadata["cost"], rel=1e-6)
    np.testing.assert_allclose(found.torque, shipped.torque, atol=1e-5)
    np.testing.assert_allclose(found.states, shipped.states, atol=1e-3)
    np.testing.assert_allclose(found.gains, shipped.gains, atol=1e-3 * np.abs(shipped.gains).max())


def test_the_torques_rate_moves_the_torque_only_in_its_own_step(x64):
    pendulum = PendulumTransition(LEADERBOARD.driven(ACROBOT), ACROBOT.joint, 0.002)
    transition, x = TorqueRateTransition(pendulum), tuple(map(jnp.float64, (0.3, -0.2, 1.0, 2.0, 0.7)))
    np.testing.assert_allclose(transition.step(x, 5.0)[4], 0.7 + 0.002 * 5.0)
    np.testing.assert_allclose(transition.step(x, 5.0)[:4], pendulum.step(x[:4], x[4]))
    columns = np.array(transition.jacobian(x, jnp.float64(5.0)))
    np.testing.assert_allclose(columns[5], [0, 0, 0, 0, 0.002])
    np.testing.assert_allclose(columns[:5, :4], pendulum.jacobian(x[:4], x[4]), atol=1e-15)


def test_files_keep_everything(tmp_path):
    rows = np.random.default_rng(0).normal(size=(2, 7, 4))
    reference = Reference(ACROBOT, 0.001, rows[0], rows[0, :, 0], rows[1])
    # What the file says itself wins over what the provenance, such as another file's metadata, says of that.
    save_reference(tmp_path / "a.safetensors", reference, {"command": "this test", "dt": 9.0, "robot": "pendubot"})
    loaded, metadata = load_reference(tmp_path / "a.safetensors")
    np.testing.assert_equal(dataclasses.asdict(loaded), dataclasses.asdict(reference))
    assert {getattr(loaded, name).dtype for name in REFERENCE_ARRAYS} == {np.dtype(np.float64)}
    assert metadata["command"] == "this test"


FAULTY = {
    "lacks torque": {"torque": None},
    "states of shape": {"states": np.zeros((5, 3))},
    "not finite": {"torque": np.array([0, 0, np.nan, 0, 0])},
    "dt = 0.0": {"dt": 0.0},
    "unknown robot": {"robot": "cartpole"},
}


@pytest.mark.parametrize("named", FAULTY)
def test_faulty_files_are_refused(tmp_path, named):
    path, rows = tmp_path / "a.safetensors", np.zeros((5, 4))
    save_reference(path, Reference(ACROBOT, 0.001, rows, rows[:, 0], rows), {})
    is_array = next(iter(FAULTY[named])) in REFERENCE_ARRAYS
    change_file(path, **{"arrays" if is_array else "metadata": FAULTY[named]})
    assert named in refusal(load_reference, path)


def test_the_judge_reads_a_trajectory_as_a_run(tmp_path, robot):
    reference = shipped_reference(robot)[0]
    save_reference_csv(tmp_path / "r.csv", reference)
    table = np.genfromtxt(tmp_path / "r.csv", delimiter=",")[1:]
    np.testing.assert_array_equal(table[:, 0], reference.time)
    np.testing.assert_array_equal(table[:, 1:5], reference.states)
    np.testing.assert_array_equal(table[:, 5 + robot.joint], reference.torque)
    swingup.score(load_trajectory(tmp_path / "r.csv"), robot)


def test_a_swing_up_for_encoders_with_zeros_shows_their_angles(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_plant("off.yml", LEADERBOARD.changed(zero1=0.1, zero2=-0.05))
    words = "export tvlqr --robot acrobot --to trajectory --plant off.yml --out off.csv"
    assert main(words.split()) == 0
    table = np.genfromtxt("off.csv", delimiter=",", names=True)
    assert (table["pos1"][0], table["pos2"][0]) == (0.1, -0.05)
    ends = [np.sin(table[name][-1] - zero) for name, zero in (("pos1", 0.1), ("pos2", -0.05))]
    np.testing.assert_allclose(ends, 0.0, atol=0.02)


def test_gains_act_as_realaigyms_controller_has_them(tmp_path, robot, x64):
    """u = tau - K (x_des - x), by the columns of the file alone."""
    reference = shipped_reference(robot)[0]
    save_reference_csv(tmp_path / "r.csv", reference)
    table = np.genfromtxt(tmp_path / "r.csv", delimiter=",", names=True)
    controller = RiccatiController(reference.dt, reference.states, reference.torque, reference.gains, 6.0, robot)
    for row in (0, 100, 400):
        x = reference.states[row] + np.array([0.01, -0.02, 0.1, 0.2])
        desired = np.array([table[name][row] for name in ("pos1", "pos2", "vel1", "vel2")])
        expected = [
            table[f"tau{joint}"][row] - np.array([table[f"K{joint}{k}"][row] for k in (1, 2, 3, 4)]) @ (desired - x)
            for joint in (1, 2)
        ]
        np.testing.assert_allclose(controller(None, row * reference.dt, x)[1], expected, rtol=1e-9, atol=1e-12)
