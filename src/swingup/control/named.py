"""Controllers by what a user calls them: a built-in name, a policy file, or ``module:object``."""

import importlib
import inspect
import sys
from typing import Any

from ..errors import SwingupError
from ..physics.parameters import Robot
from .builtin import BASELINES, baseline
from .controller import AbstractController, one_line
from .learned import load_policy
from .plain import PlainController
from .zoo import SHIPPED, shipped_policy

BUILT_IN = (SHIPPED, *BASELINES)
"""Names of the controllers that the package ships."""


def get_controller(name: str, robot: Robot) -> AbstractController[Any] | PlainController:
    """Find a controller by its name.

    Args:
        name: a built-in name, the path of a policy file, or ``module:object`` with a module from the working folder
            or the Python path, and an object, or a class without arguments, that is a controller in JAX, has
            ``get_control_output(x, t)``, or is a function of (x, t).
        robot: which joint is driven.

    Raises:
        SwingupError: there is no such controller, it cannot be loaded, or it is for another robot.
    """
    if name == SHIPPED:
        return shipped_policy(robot)[0]
    if name in BASELINES:
        return baseline(name, robot)
    if name.endswith(".npz"):
        return load_policy(name, robot)[0]
    if ":" in name:
        return _imported(name)
    known = ", ".join(BUILT_IN)
    hint = f"; for an object of a module: {name.removesuffix('.py')}:NAME" if name.endswith(".py") else ""
    raise SwingupError(f"unknown controller {name!r}: use {known}, a policy file (.npz) or module:object{hint}")


def _imported(name: str) -> AbstractController[Any] | PlainController:
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
    return found if isinstance(found, AbstractController) else PlainController(found)
