"""Controllers by what a user calls them: a built-in name, a policy file, or ``module:object``."""

import importlib
import inspect
import sys
from typing import Any

from ..errors import SwingupError
from ..physics.parameters import Robot, get_robot, leaderboard_parameters
from ..policy.jax_backend.controller import load_policy, shipped_policy
from ..policy.jax_backend.estimator import EstimatingController, with_estimator
from ..policy.settings import EstimatorSettings, read_settings
from ..policy.shipped import SHIPPED_POLICIES
from ..renamed import current_name
from .baselines import BASELINES, baseline
from .controller import AbstractController, one_line
from .python_controller import PythonController

BUILT_IN = (*SHIPPED_POLICIES, *BASELINES)
"""Names of the controllers that the package ships."""


Controller = AbstractController[Any] | PythonController


def get_controller(name: str, robot: Robot | str, estimator: bool | None = None) -> Controller:
    """Find a controller by its name, with or without a state estimator before it.

    Args:
        name: a built-in name, the path of a policy file, or ``module:object`` with a module from the working folder
            or the Python path, and an object, or a class without arguments, that is a controller in JAX, has
            ``get_control_output(x, t)``, or is a function of (x, t).
        robot: which joint is driven.
        estimator: as it comes (None: with one if the policy file asks for it), never (False) or always (True). Its
            settings are the policy file's or the defaults, its model is the leaderboard's plant.

    Raises:
        SwingupError: there is no such controller, it cannot be loaded, is for another robot, or is in plain Python,
            which no estimator goes before.
    """
    robot = get_robot(robot)
    found, settings = _find(name, robot)
    if isinstance(found, EstimatingController):
        return found.controller if estimator is False else found
    if not (settings is not None if estimator is None else estimator):
        return found
    if isinstance(found, PythonController):
        raise SwingupError(
            f"controller {name!r} is in plain Python: an estimator goes only before policies and controllers in JAX"
        )
    try:
        return with_estimator(found, robot, leaderboard_parameters(robot), settings)
    except SwingupError as error:
        raise SwingupError(f"controller {name!r}: {error}") from error


def has_estimator(controller: Any) -> bool:
    """Whether a state estimator stands before the controller."""
    return isinstance(controller, EstimatingController)


def _find(name: str, robot: Robot) -> tuple[Controller, EstimatorSettings | None]:
    """A controller, and the settings of the estimator that its policy file asks for, if any."""
    if name in BASELINES:
        return baseline(name, robot), None
    name = current_name("controller", name)
    if name in SHIPPED_POLICIES or name.endswith(".npz"):
        policy, metadata = shipped_policy(robot, name) if name in SHIPPED_POLICIES else load_policy(name, robot)
        return policy, read_settings(metadata)
    if ":" in name:
        return _imported(name), None
    known = ", ".join(BUILT_IN)
    hint = f"; for an object of a module: {name.removesuffix('.py')}:NAME" if name.endswith(".py") else ""
    raise SwingupError(f"unknown controller {name!r}: use {known}, a policy file (.npz) or module:object{hint}")


def _imported(name: str) -> Controller:
    module_name, _, object_name = name.partition(":")
    if "" not in sys.path:
        sys.path.insert(0, "")  # a module in the working folder, as `python` itself would find it
    try:
        found: Any = importlib.import_module(module_name)
        for attribute in object_name.split("."):
            found = getattr(found, attribute)
        if inspect.isclass(found):
            found = found()
    except (Exception, SystemExit) as error:  # whatever a foreign module raises
        raise SwingupError(
            f"cannot load controller {name!r}: {type(error).__name__}: {one_line(error)}; write module:object "
            "with an object, or a class without arguments, of a module that can be imported"
        ) from error
    return found if isinstance(found, AbstractController) else PythonController(found)
