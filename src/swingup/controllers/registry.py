"""Controllers by name: a built-in one, the file of a policy or of a feedback law, or ``module:object``."""

import importlib
import inspect
from pathlib import Path
from typing import Any

from ..common.checks import suggestion
from ..common.errors import SwingupError, described, naming, quoted
from ..common.files import working_folder_first
from ..loop.resolve import resolve
from ..plant.plant import LEADERBOARD, Plant, PlantLike, Robot, get_robot
from ..policy.feedback import is_law, load_robot_policy, policy_controller
from ..policy.shipped import SHIPPED_POLICIES, is_policy, load_policy
from .baselines.baselines import BASELINES, baseline
from .interface import AbstractController, PythonController, from_zeros, layers
from .stack.estimator import EstimatingController, with_estimator
from .stack.policy import make_controller

BUILT_IN = (*SHIPPED_POLICIES, *BASELINES)  # Names of the controllers that the package ships

Controller = AbstractController[Any] | PythonController


def get_controller(
    name: str,
    robot: Robot | str,
    estimator: bool | None = None,
    plant: PlantLike | None = None,
    design: Plant = LEADERBOARD,
) -> Controller:
    """Find a controller by its name, with or without a state estimator before it.

    Args:
        name: a built-in name, the path of a policy file or of a feedback law, or ``module:object`` with a module
            from the working folder or the Python path, and an object, or a class without arguments, that is a
            controller in JAX, has ``get_control_output(x, t)``, or is a function of (x, t).
        robot: which joint is driven.
        estimator: never (False), always (True), or where the policy file has its settings (None). Without settings
            in the file it has the defaults.
        plant: what a policy that finds its plant begins with, or what a baseline is designed for, and the model of
            an estimator before it: a plant, its name or its file; None for the plant of the policy's file, or for
            ``design``. Other policies have one of their own.
        design: what a baseline is designed for where no plant is given.

    Raises:
        SwingupError: there is no such controller or plant, it cannot be loaded, it is for another robot, it is in
            plain Python and an estimator was requested, or it is a policy that is not for the plant given.
    """
    robot = get_robot(robot)
    if not isinstance(name, str | Path):
        raise SwingupError(f"{quoted(name)} is no name of a controller: pass a controller itself to judge()")
    given = None if plant is None else resolve(plant).facts
    if is_law(name):
        if given is not None or estimator is not None:
            raise SwingupError(f"feedback law {name} has its own plant and estimator: give no others")
        return PythonController(policy_controller(load_robot_policy(name, robot), guard=False))
    if is_policy(name):
        return make_controller(load_policy(name, robot, given), estimator)
    design = design if given is None else given
    found = baseline(name, robot, design) if name in BASELINES else _imported(str(name))
    # An imported controller may bring its own estimator; a second one would estimate an estimate.
    if isinstance(found, EstimatingController):
        return found.controller if estimator is False else found
    if not estimator:
        return from_zeros(found, design) if name in BASELINES and isinstance(found, AbstractController) else found
    if isinstance(found, PythonController):
        raise SwingupError(
            f"controller {quoted(name)} is in plain Python: an estimator goes only before policies and controllers "
            "in JAX"
        )
    if name not in BASELINES:  # it is shown what the encoders show, as without an estimator
        found = from_zeros(found, design.changed(zero1=-design.zero1, zero2=-design.zero2))
    with naming(f"controller {quoted(name)}"):
        return from_zeros(with_estimator(found, robot, design.driven(robot)), design)


def controller_on(
    name: str, robot: Robot | str, plant: Plant, estimator: bool | None = None, given: bool = True
) -> Controller:
    """The controller that a name means on a plant, as it is exported for it.

    A baseline is designed for the plant. A policy that finds its plant begins with it, if it was given.
    """
    begins = given and not is_law(name) and is_policy(name) and load_policy(name, robot).finds_plant
    return get_controller(name, robot, estimator, plant if begins else None, plant)


def has_estimator(controller: Any) -> bool:
    """Whether a state estimator stands before the controller."""
    return any(isinstance(layer, EstimatingController) for layer in layers(controller))


def _imported(name: str) -> Controller:
    """An object of a module, or of a class of it without arguments."""
    module_name, colon, object_name = name.partition(":")
    if not colon:
        known = f"{', '.join(BUILT_IN)}, a policy file (.safetensors) or module:object"
        near = suggestion(name, BUILT_IN)
        hint = f"; for an object of a module: {name.removesuffix('.py')}:NAME" if name.endswith(".py") else near
        raise SwingupError(f"unknown controller {quoted(name)}: use {known}{hint}")
    try:
        with working_folder_first():
            found: Any = importlib.import_module(module_name)
            for attribute in object_name.split("."):
                found = getattr(found, attribute)
            if inspect.isclass(found):
                found = found()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever a foreign module raises
        raise SwingupError(
            f"cannot load controller {quoted(name)}: {described(error)}; write module:object with an object, or a "
            "class without arguments, of a module that can be imported"
        ) from error
    with naming(f"controller {quoted(name)}"):
        return found if isinstance(found, AbstractController) else PythonController(found)
