"""Controllers by their names, with and without a state estimator before them."""

import importlib
import sys

import pytest

import swingup
from array_files import read_metadata
from policies import lone_policy
from swingup.common.errors import SwingupError
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

acrobot = get_robot("acrobot")
compiled = Damping()
estimating = with_estimator(compiled, acrobot, LEADERBOARD.driven(acrobot))
pendubot = swingup.baseline("lqr", "pendubot")

def plain(x, t):
    return [0.0, 0.0]
"""


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Policy files of the acrobot: without an estimator, with the defaults, and with settings of its own."""
    policy, metadata = lone_policy("ar-eapo", "acrobot")
    kept = {"scores": metadata["scores"]}
    save_controller(tmp_path / "alone.safetensors", policy, kept)
    save_controller(tmp_path / "defaults.safetensors", policy, kept | {"estimator": {}})
    save_controller(tmp_path / "own.safetensors", policy, kept | {"estimator": {"dt": 0.004, "max_delay_steps": 7}})
    (tmp_path / "some_controllers.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def settings(controller):
    """Those of the estimator before a policy, or None for a policy alone."""
    if isinstance(controller, PolicyController):
        return None
    assert isinstance(controller.controller, PolicyController)
    return controller.settings


def test_policy_files_say_whether_an_estimator_is_meant(files):
    own, defaults = EstimatorSettings(dt=0.004, max_delay_steps=7), EstimatorSettings()
    expected = {
        "alone.safetensors": {None: None, False: None, True: defaults},
        "defaults.safetensors": {None: defaults, False: None, True: defaults},
        "own.safetensors": {None: own, False: None, True: own},
    }
    for name, answers in expected.items():
        for wanted, answer in answers.items():
            controller = get_controller(name, "acrobot", wanted)
            assert settings(controller) == answer
            assert has_estimator(controller) == (answer is not None)


def test_the_model_is_the_leaderboards(files, robot):
    controller = get_controller("tvlqr", robot, estimator=True)
    assert controller.robot == robot
    assert controller.plant.values() == LEADERBOARD.driven(robot).values()


def test_load_policy_gives_the_policy_alone(files):
    controller, metadata = lone_policy("own.safetensors")
    assert isinstance(controller, PolicyController)
    assert metadata["estimator"] == {"dt": 0.004, "max_delay_steps": 7}


@pytest.mark.parametrize(
    ("estimator", "message"),
    [
        ({"delay": 1}, "unknown estimator setting 'delay'"),
        ({"dt": -0.002}, "estimator setting dt = -0.002: use a number from 1e-06 to 0.1"),
        (None, "estimator None is not an object"),
    ],
)
def test_bad_settings_are_refused_with_the_files_name(files, estimator, message):
    save_controller("bad.safetensors", lone_policy("alone.safetensors")[0], {"estimator": estimator})
    for wanted in (None, False):
        with pytest.raises(SwingupError) as error:
            get_controller("bad.safetensors", "acrobot", wanted)
        assert str(error.value).startswith(f"policy file bad.safetensors: {message}")
        assert "\n" not in str(error.value)


def test_controllers_of_modules(files):
    assert not has_estimator(get_controller("some_controllers:compiled", "acrobot"))
    assert has_estimator(get_controller("some_controllers:compiled", "acrobot", True))
    # One that brings its own estimator keeps it, gets no second one, and can go without.
    own = get_controller("some_controllers:estimating", "acrobot", True)
    assert not isinstance(own.controller, EstimatingController)
    assert has_estimator(get_controller("some_controllers:estimating", "acrobot"))
    assert not has_estimator(get_controller("some_controllers:estimating", "acrobot", False))
    assert not has_estimator(get_controller("some_controllers:plain", "acrobot", False))
    with pytest.raises(SwingupError, match="'some_controllers:plain' is in plain Python: an estimator goes only"):
        get_controller("some_controllers:plain", "acrobot", True)
    with pytest.raises(SwingupError, match="'some_controllers:pendubot': it is for the pendubot, not the acrobot"):
        get_controller("some_controllers:pendubot", "acrobot", True)


def test_the_working_folder_comes_first_only_while_a_module_is_imported(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    (tmp_path / "neighbour_of_mine.py").write_text("torque = [0.0, 1.0]\n", encoding="utf-8")
    (tmp_path / "mine_alone.py").write_text(
        "import neighbour_of_mine\n\ndef act(x, t):\n    return neighbour_of_mine.torque\n", encoding="utf-8"
    )
    (tmp_path / "mine_failing.py").write_text("raise ValueError('no\\nway')\n", encoding="utf-8")
    (tmp_path / "colorsys.py").write_text("", encoding="utf-8")
    monkeypatch.delitem(sys.modules, "colorsys", raising=False)
    before = list(sys.path)
    assert get_controller("mine_alone:act", "acrobot").source([0, 0, 0, 0], 0.0) == [0.0, 1.0]
    with pytest.raises(SwingupError, match=r"cannot load controller 'mine_failing:act': ValueError \(no way\)"):
        get_controller("mine_failing:act", "acrobot")
    # Last, it serves what a module imports when it is called, and hides nothing of Python's.
    assert sys.path == [*before, ""]
    assert importlib.import_module("colorsys").hsv_to_rgb


@pytest.mark.parametrize("name", ["mine:", ":it", "a\nb:it", "..x:it", "math:pi.nothing", "\udce9:it"])
def test_names_of_modules_that_cannot_be(name):
    with pytest.raises(SwingupError, match="cannot load controller") as error:
        get_controller(name, "acrobot")
    assert str(error.value).isprintable()


def test_a_policy_takes_no_plant():
    with pytest.raises(SwingupError, match="policy 'ar-eapo' has a plant of its own: leave plant out here"):
        get_controller("ar-eapo", "pendubot", plant="B.0")


def test_built_in_names(files):
    assert isinstance(swingup.get_controller("tvlqr", "pendubot"), LatchingSwitch)
    assert isinstance(get_controller("tvlqr", "pendubot", True).controller, LatchingSwitch)
    assert settings(get_controller("global", "pendubot")) == EstimatorSettings()
    assert settings(get_controller("global", "pendubot", False)) is None
    assert settings(get_controller("ar-eapo", "pendubot")) is None
    assert settings(get_controller("ar-eapo", "pendubot", True)) == EstimatorSettings()
    known = "adaptive, ar-eapo, global, lqr"
    with pytest.raises(SwingupError, match=f"unknown controller 'pid': use {known}"):
        get_controller("pid", "pendubot")
    with pytest.raises(SwingupError, match="unknown robot 'cartpole'"):
        get_controller("tvlqr", "cartpole")


def test_the_global_policy(files, monkeypatch, robot):
    with pytest.raises(SwingupError, match="unknown policy 'best': use one of adaptive, ar-eapo, global"):
        lone_policy("best", robot)
    monkeypatch.setattr(shipped, "ZOO", files)
    with pytest.raises(
        SwingupError, match=f"lacks the policy {robot.name}-global.safetensors: use adaptive or train one"
    ):
        get_controller("global", robot)
    policy = lone_policy("alone.safetensors", "acrobot")[0]
    policy = PolicyController(policy.policy, 5.0, robot)
    save_controller(files / f"{robot.name}-global.safetensors", policy, {"estimator": {"max_delay_steps": 3}})
    found = get_controller("global", robot)
    assert (found.settings.max_delay_steps, found.controller.torque_limit) == (3, 5.0)
    assert not has_estimator(get_controller("global", robot, False))


def test_where_the_shipped_files_are(robot):
    for name in shipped.SHIPPED_POLICIES:
        file = shipped.shipped_file(robot, name)
        assert (file.name, file.is_file()) == (f"{robot.name}-{name}.safetensors", True)


def test_the_metadata_stays_json(files):
    assert read_metadata("own.safetensors")["estimator"] == {"dt": 0.004, "max_delay_steps": 7}
