"""Controllers by their names, with and without a state estimator before them, and on any clock."""

import importlib
import sys

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import swingup
from benchmark import controllers
from policies import lone_policy
from refusals import refusal
from swingup.controllers.baselines.upright import LatchingSwitch
from swingup.controllers.interface import AbstractController, from_zeros, split_time
from swingup.controllers.registry import get_controller, has_estimator
from swingup.controllers.stack.policy import PolicyController, save_controller
from swingup.plant.plant import LEADERBOARD
from swingup.policy.estimator import EstimatorSettings


def test_policy_files_say_whether_an_estimator_is_meant(tmp_path):
    policy, _ = lone_policy("ar-eapo", "acrobot")
    own, defaults = EstimatorSettings(dt=0.004, max_delay_steps=7), EstimatorSettings()
    for metadata, told, forced in (
        ({}, None, defaults),
        ({"estimator": {}}, defaults, defaults),
        ({"estimator": {"dt": 0.004, "max_delay_steps": 7}}, own, own),
    ):
        save_controller(tmp_path / "p.safetensors", policy, metadata)
        for wanted, answer in ((None, told), (False, None), (True, forced)):
            controller = get_controller(f"{tmp_path}/p.safetensors", "acrobot", wanted)
            assert getattr(controller, "settings", None) == answer
            assert has_estimator(controller) == (answer is not None)
            assert isinstance(controller if answer is None else controller.controller, PolicyController)


def test_built_in_names(robot):
    assert isinstance(swingup.get_controller("tvlqr", robot), LatchingSwitch)
    behind = get_controller("tvlqr", robot, estimator=True)
    assert isinstance(behind.controller, LatchingSwitch)
    assert (behind.robot, behind.plant.values()) == (robot, LEADERBOARD.driven(robot).values())


def test_controllers_of_modules(monkeypatch):
    def named(controller, estimator=None):
        monkeypatch.setattr(controllers, "MINE", controller, raising=False)
        return get_controller("benchmark.controllers:MINE", "acrobot", estimator)

    compiled, plain = controllers.SWINGING, controllers.swinging
    assert [has_estimator(named(compiled, wanted)) for wanted in (None, True)] == [False, True]
    # One that brings its own estimator keeps it, gets no second one, and can go without.
    own = get_controller("tvlqr", "acrobot", estimator=True)
    assert [has_estimator(named(own, wanted)) for wanted in (None, True, False)] == [True, True, False]
    assert not has_estimator(named(own, True).controller)
    assert not has_estimator(named(plain, False))
    told = "'benchmark.controllers:MINE': it is for the pendubot"
    assert told in refusal(named, swingup.baseline("lqr", "pendubot"), True)


def test_an_own_controller_sees_the_encoders_angles_with_and_without_an_estimator(monkeypatch):
    class Showing(AbstractController):
        places: int = 2  # a shape
        on: bool = True  # a branch

        def init(self):
            return jnp.zeros(self.places)

        def __call__(self, carry, t, x):
            return x[:2], x[:2] if self.on else carry

    monkeypatch.setattr(controllers, "MINE", Showing(), raising=False)
    plant = LEADERBOARD.changed(zero1=0.2, zero2=-0.3)
    shown = jnp.array([0.2, -0.3, 0.0, 0.0])  # it hangs
    for wanted in (None, True):
        found = get_controller("benchmark.controllers:MINE", "acrobot", wanted, design=plant)
        _, u = found(found.init(), jnp.zeros(()), shown)
        np.testing.assert_allclose(u[1], shown[1], atol=1e-6)
        swingup.judge(found, "acrobot", plant=plant)


def test_a_controller_behind_zeros_is_still_for_its_robot():
    off = LEADERBOARD.changed(zero1=0.1)
    found = swingup.baseline("lqr", "acrobot", off)
    told = "it is for the acrobot, not the pendubot"
    assert told in refusal(swingup.judge, get_controller("lqr", "acrobot", design=off), "pendubot", plant=off)
    assert told in refusal(swingup.judge, from_zeros(found, off), "pendubot", plant=off)


def test_a_state_of_whole_numbers_is_a_state():
    policy, _ = lone_policy("ar-eapo", "acrobot")
    torques = [policy(None, 0.0, jnp.array(x))[1] for x in ([3, 0, 0, 0], [3.0, 0.0, 0.0, 0.0])]
    np.testing.assert_array_equal(*torques)
    assert abs(float(torques[0][1])) > 1e-3


def test_the_working_folder_comes_first_only_while_a_module_is_imported(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    (tmp_path / "neighbour_of_mine.py").write_text("torque = [0.0, 1.0]\n", encoding="utf-8")
    text = "import neighbour_of_mine\n\ndef act(x, t):\n    return neighbour_of_mine.torque\n"
    (tmp_path / "mine_alone.py").write_text(text, encoding="utf-8")
    (tmp_path / "mine_failing.py").write_text("raise ValueError('no\\nway')\n", encoding="utf-8")
    (tmp_path / "colorsys.py").write_text("", encoding="utf-8")
    monkeypatch.delitem(sys.modules, "colorsys", raising=False)
    before = list(sys.path)
    assert get_controller("mine_alone:act", "acrobot").source([0, 0, 0, 0], 0.0) == [0.0, 1.0]
    named = "cannot load controller 'mine_failing:act': ValueError (no way)"
    assert named in refusal(get_controller, "mine_failing:act", "acrobot")
    # Last, it serves what a module imports when it is called, and hides nothing of Python's.
    assert sys.path == [*before, ""]
    assert importlib.import_module("colorsys").hsv_to_rgb


DT, HOURS, EPOCH = 0.002, 1e6, 1.76e9


def answers(controller, start):
    """Torques (40, 2) along a motion, in float32, on a clock that starts at a time (s)."""
    call, memory, torques = eqx.filter_jit(controller), controller.init(), []
    for t in DT * np.arange(40):
        x = np.array([np.sin(3 * t), np.cos(4 * t) - 1, 3 * np.cos(3 * t), -4 * np.sin(4 * t)], np.float32)
        memory, u = call(memory, split_time(start + t), x)
        torques.append(u)
    return np.array(torques)


def test_a_clock_may_start_anywhere():
    """Of a trajectory's follower behind an estimator."""
    found = get_controller("tvlqr", "acrobot", estimator=True)
    expected = answers(found, 0.0)
    assert np.ptp(expected) > 0.1
    for start in (HOURS, EPOCH):
        # The clock itself, in float64, resolves 2e-7 s at most.
        np.testing.assert_allclose(answers(found, start), expected, rtol=0, atol=1e-3)
