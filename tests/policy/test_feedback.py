"""Baselines that run without JAX: NumPy and C beside the JAX original, and their folders and headers."""

import dataclasses
import functools
import runpy

import numpy as np
import pytest

from refusals import refusal
from swingup.benchmark.judge import judge
from swingup.controllers.baselines import baselines
from swingup.controllers.baselines.baselines import feedback_policy, shipped_reference
from swingup.controllers.interface import loop_controller
from swingup.controllers.registry import get_controller
from swingup.export.c_header import c_header
from swingup.export.folder import export_folder
from swingup.plant.equations import NUMPY, damped_midpoint_step
from swingup.plant.files import load_plant
from swingup.plant.plant import LEADERBOARD, lump
from swingup.policy.feedback import load_robot_policy, policy_controller, read_feedback, write_feedback
from swingup.policy.guard import GuardSettings
from swingup.rehearsal.process import find_folder
from swingup.runtime import load_controller

from . import compiled

STARTS = ((0.0, 0.0, 0.0, 0.0), (np.pi - 0.03, 0.02, 0.05, -0.05))
ZEROS = {"zero1": 0.04, "zero2": -0.03}
CASES = {
    "lqr": ("lqr", "acrobot", lambda similar: load_plant("cloudpendulum").changed(**ZEROS, cf1=0.0)),
    "lqr-rubbing": ("lqr", "pendubot", lambda similar: load_plant("C.1").changed(cf1=0.1, cf2=0.03, **ZEROS)),
    "tvlqr": ("tvlqr", "acrobot", lambda similar: LEADERBOARD),
    "tvlqr-rubbing": ("tvlqr", "pendubot", lambda similar: similar(LEADERBOARD).changed(cf1=4e-4, cf2=1e-4)),
    "tvlqr-score": ("tvlqr-score", "pendubot", lambda similar: similar(LEADERBOARD).changed(**ZEROS)),
    "tvlqr-estimated": ("tvlqr", "acrobot", lambda similar: similar(LEADERBOARD).changed(cf1=1e-4, **ZEROS), True),
}
"""A baseline, a robot and a plant, some with friction of either joint; perhaps whether behind an estimator."""


def test_a_loop_gives_the_passive_joint_what_its_controller_declares():
    """``adaptive`` carries friction there, also for a plant whose encoders have zeros."""
    adaptive = get_controller("adaptive", "acrobot", plant=load_plant("C.1").changed(zero1=0.1))
    assert loop_controller(adaptive, "acrobot").torque_limits == (0.5, 6.0)
    assert load_controller("adaptive", "acrobot").torque_limits == (0.5, 6.0)


@functools.cache
def loops(plant, name, robot, estimator=False):
    """The law, and times, measurements and torques of JAX's controller in loops from hanging and near the top."""
    law, lumped = feedback_policy(name, robot, plant, estimator), lump(plant)
    limit, zeros = law.torque_limit, np.array([*plant.zeros, 0.0, 0.0])
    found = loop_controller(get_controller(name, robot, estimator, plant=plant), robot, limit=limit)
    rows = []
    for x in STARTS:
        found.reset()
        for call in range(900):
            # A clock that does not begin at 0, and calls that do not meet the trajectory's rows.
            t, measured = 5.0 + 0.0023 * call, np.add(x, zeros)
            rows.append((t, measured, found(measured, t)))
            x = damped_midpoint_step(lumped, plant.friction, x, rows[-1][2].tolist(), 0.0023, NUMPY)
    columns = [np.array(column).reshape(len(STARTS), 900, -1) for column in zip(*rows, strict=True)]
    return law, [np.ravel(column[..., 0]) if column.shape[-1] == 1 else column for column in columns]


@pytest.fixture
def case(request, similar, monkeypatch):
    # Similar plants have similar swing-ups: none is computed anew.
    monkeypatch.setattr(
        baselines, "_computed_reference", lambda design, problem: shipped_reference(design.robot, problem)[0]
    )
    name, robot, plant, *estimator = CASES[request.param]
    law, (times, states, torques) = loops(plant(similar), name, robot, *estimator)
    return law, times.reshape(len(STARTS), -1), states, torques


# A policy of each kind by default: the others have their parts in other combinations.
EACH = [pytest.param(each, marks=pytest.mark.slow if each in ("lqr", "tvlqr") else []) for each in CASES]


@pytest.mark.parametrize("case", EACH, indirect=True)
def test_torques_are_jaxs(case, tmp_path):
    law, times, states, expected = case
    numpys = policy_controller(law)
    library = compiled.compile_header(tmp_path, c_header(law), *compiled.CAREFUL)
    assert library.self_test() == 0
    for run in range(len(STARTS)):
        for _ in range(2):
            numpys.reset()
            found = np.array([numpys(x, t) for x, t in zip(states[run], times[run], strict=True)])
            np.testing.assert_allclose(found, expected[run], rtol=0, atol=1e-9)
        found = compiled.watch(library, times[run], states[run])[0]
        np.testing.assert_allclose(found, expected[run], rtol=0, atol=1e-9)
    assert np.ptp(expected[1][:, law.robot.joint]) > 0.01 * law.torque_limit
    assert law.swing_up is None or np.ptp(expected[0][:, law.robot.joint]) > 0.1 * law.torque_limit


def test_a_laws_file_is_a_controller_by_its_name(tmp_path):
    """As make-controller keeps it: the baseline's score, in plain Python."""
    path = tmp_path / "law.safetensors"
    write_feedback(path, feedback_policy("tvlqr", "acrobot"))
    score = judge(get_controller(path, "acrobot"), "acrobot").score
    assert score == pytest.approx(judge(get_controller("tvlqr", "acrobot"), "acrobot").score, abs=1e-6)
    assert "for the acrobot, not the pendubot" in refusal(get_controller, path, "pendubot")
    assert "its own plant and estimator" in refusal(get_controller, path, "acrobot", estimator=True)


def test_a_state_that_is_not_finite_gives_nan(tmp_path):
    law, joint = feedback_policy("tvlqr", "acrobot"), 1
    library, states = compiled.compile_header(tmp_path, c_header(law)), np.zeros((4, 4))
    states[[0, 2], [1, 3]] = np.nan, np.inf
    found, times = policy_controller(law), 0.01 * np.arange(4)
    for u in (
        np.array([found(x, t) for x, t in zip(states, times, strict=True)]),
        compiled.watch(library, times, states)[0],
    ):
        np.testing.assert_array_equal(np.isnan(u[:, joint]), [True, False, True, False])
        np.testing.assert_array_equal(u[:, 1 - joint], 0.0)
    assert np.isnan(found(np.zeros(4), np.nan)[joint])


def test_a_damaged_file_is_refused(tmp_path):
    law = feedback_policy("tvlqr", "acrobot")
    for part, change in {
        "top": {"gains": np.zeros(3)},
        "swing_up": {"coefficients": law.swing_up.coefficients[:, :2]},
    }.items():
        changed = dataclasses.replace(getattr(law, part), **change)
        write_feedback(tmp_path / "law", dataclasses.replace(law, **{part: changed}))
        assert "its numbers are not a law" in refusal(read_feedback, tmp_path / "law")
    # It would end a comment of C, or a text of Python.
    for name in ("*/ int x;", 'x", "y": exit(), "z": "'):
        write_feedback(tmp_path / "law", dataclasses.replace(law, name=name))
        assert "use letters, digits" in refusal(read_feedback, tmp_path / "law")


@pytest.mark.parametrize("form", ["realaigym", "cloudpendulum"])
def test_a_folder_has_the_law_with_its_guard(form, tmp_path):
    law = dataclasses.replace(
        feedback_policy("lqr", "pendubot", LEADERBOARD.changed(**ZEROS)), guard=GuardSettings()
    )
    entry = runpy.run_path(export_folder(law, tmp_path / "out", form, f"held_{form}"))
    x = np.array([np.pi + 0.14, -0.13, 0.0, 0.0])
    found = policy_controller(dataclasses.replace(law, guard=None))(x, 0.0)
    assert abs(found[0]) > 0.1
    controller = entry["controller"]
    if form == "realaigym":
        np.testing.assert_array_equal(controller.get_control_output(x, 0.0), found)
        controller.get_control_output(x + np.array([0, 0, 30, 0]), 0.01)
        assert "velocity is beyond the limit" in str(controller.fault)
    readme = next(tmp_path.glob("out/**/*.md")).read_text()
    assert "The optimal-control baseline lqr" in readme
    assert "@" not in readme
    assert controller.robot.name == "pendubot"
    assert load_robot_policy(find_folder(tmp_path / "out").policy, "pendubot").name == "lqr"
