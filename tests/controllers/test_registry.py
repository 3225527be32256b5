"""Controllers by their names, with and without a state estimator before them."""

import importlib
import sys

import pytest

import swingup
from policies import lone_policy
from refusals import refusal
from swingup.controllers.baselines.switch import LatchingSwitch
from swingup.controllers.registry import get_controller, has_estimator
from swingup.controllers.stack.controller import PolicyController, save_controller
from swingup.controllers.stack.estimator import EstimatingController
from swingup.plant.plant import LEADERBOARD
from swingup.policy import shipped
from swingup.policy.estimator.settings import EstimatorSettings

MODULE = """
import jax.numpy as jnp
import swingup
from swingup.plant.plant import LEADERBOARD
from swingup.plant.robots import get_robot
from swingup.controllers.stack.estimator import with_estimator

class Damping(swingup.AbstractController):
    def init(self):
        return None

    def __call__(self, carry, t, x):
        return None, -0.1 * x[2:] * jnp.array([0.0, 1.0])

compiled = Damping()
estimating = with_estimator(compiled, get_robot("acrobot"), LEADERBOARD.driven("acrobot"))
pendubot = swingup.baseline("lqr", "pendubot")

def plain(x, t):
    return [0.0, 0.0]
"""


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Policy files of the acrobot: without an estimator, with the defaults, and with settings of its own."""
    policy, _ = lone_policy("ar-eapo", "acrobot")
    meant = {"alone": {}, "defaults": {"estimator": {}}, "own": {"estimator": {"dt": 0.004, "max_delay_steps": 7}}}
    for name, metadata in meant.items():
        save_controller(tmp_path / f"{name}.safetensors", policy, metadata)
    (tmp_path / "some_controllers.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))


def test_policy_files_say_whether_an_estimator_is_meant(files):
    own, defaults = EstimatorSettings(dt=0.004, max_delay_steps=7), EstimatorSettings()
    for name, told, forced in (("alone", None, defaults), ("defaults", defaults, defaults), ("own", own, own)):
        for wanted, answer in ((None, told), (False, None), (True, forced)):
            controller = get_controller(f"{name}.safetensors", "acrobot", wanted)
            assert getattr(controller, "settings", None) == answer
            assert has_estimator(controller) == (answer is not None)
            assert isinstance(controller if answer is None else controller.controller, PolicyController)


def test_built_in_names(robot):
    assert isinstance(swingup.get_controller("tvlqr", robot), LatchingSwitch)
    behind = get_controller("tvlqr", robot, estimator=True)
    assert isinstance(behind.controller, LatchingSwitch)
    assert (behind.robot, behind.plant.values()) == (robot, LEADERBOARD.driven(robot).values())


def test_controllers_of_modules(files):
    assert not has_estimator(get_controller("some_controllers:compiled", "acrobot"))
    assert has_estimator(get_controller("some_controllers:compiled", "acrobot", True))
    # One that brings its own estimator keeps it, gets no second one, and can go without.
    own = get_controller("some_controllers:estimating", "acrobot", True)
    assert not isinstance(own.controller, EstimatingController)
    assert has_estimator(get_controller("some_controllers:estimating", "acrobot"))
    assert not has_estimator(get_controller("some_controllers:estimating", "acrobot", False))
    assert not has_estimator(get_controller("some_controllers:plain", "acrobot", False))
    named = "'some_controllers:pendubot': it is for the pendubot"
    assert named in refusal(get_controller, "some_controllers:pendubot", "acrobot", True)


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


def test_a_missing_policy_of_the_zoo_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(shipped, "ZOO", tmp_path)
    named = "lacks the policy acrobot-global.safetensors: use adaptive or train one"
    assert named in refusal(get_controller, "global", "acrobot")
