"""Arguments that several commands share."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, TypedDict

from tyro.conf import Positional, arg

from ..benchmark.disturbances import DisturbanceSettings
from ..benchmark.rules import PushRules
from ..common.checks import one_of
from ..common.errors import SwingupError
from ..common.files import check_suffix, check_writable
from ..common.text import one_line, quoted
from ..controllers.registry import BUILT_IN, has_estimator
from ..controllers.stack.controller import PolicyController
from ..controllers.stack.regulator import RegulatingController
from ..plant.plant import LEADERBOARD, MODEL_FILES, PARAMETER_FILES, PLANT_FILES, SHIPPED_PLANTS, Plant, load_plant
from ..plant.robots import ROBOTS, Robot, get_robot
from ..plant.units import torque_over_gravity
from .parsing import value_of


def optional(metavar: str | None = None, text: str | None = None) -> Any:
    """An option that may be left out, without tyro's "(default: None)": the text says what then happens."""
    return arg(metavar=metavar, help=text, help_behavior_hint="")


def word_of(kind: str, *words: str) -> Any:
    """One of several words."""
    return value_of(lambda word: one_of(kind, word, words), "{" + ",".join(words) + "}")


def split_commas(*values: str) -> tuple[str, ...]:
    """Values of one option, which spaces or commas may separate; a file whose name has a comma is one value."""
    return tuple(
        part for value in values for part in ([value] if Path(value).is_file() else value.split(",")) if part
    )


def _robots(name: str) -> Sequence[Robot]:
    return EVERY_ROBOT if name == "all" else (get_robot(name),)


EVERY_ROBOT = tuple(ROBOTS.values())
NAMES = value_of(split_commas, "NAME...", "*")
ROBOT = value_of(get_robot, "ROBOT")
EACH = arg(help="acrobot, pendubot or all.", help_behavior_hint="(default: all)")
RobotName = Positional[Annotated[Robot, ROBOT, arg(help="acrobot or pendubot.")]]
RobotOrNone = Positional[Annotated[Robot | None, ROBOT, arg(help="acrobot or pendubot.")]]
RobotOrAll = Positional[Annotated[Sequence[Robot], value_of(_robots, "ROBOT"), EACH]]
OptionalRobot = Annotated[Robot | None, ROBOT]
"""An option, where a log or a file may say it."""
OptionalFile = Annotated[str | None, arg(metavar="FILE")]
OptionalDomain = Annotated[str | None, arg(metavar="DOMAIN")]
ControllerName = Annotated[
    str, arg(metavar="NAME", help=f"{', '.join(BUILT_IN)}, a policy file (.safetensors), or module:object.")
]
ControllerNames = Annotated[
    tuple[str, ...], NAMES, arg(help="controllers of yours: policy files or module:object.")
]
Names = Annotated[tuple[str, ...], NAMES]
PLANTS = f"{', '.join(SHIPPED_PLANTS)}, {PLANT_FILES}"
PlantOutputs = Annotated[tuple[str, ...], NAMES, arg(metavar="FILE...")]


class DisturbanceOptions(TypedDict, total=False):
    """Disturbances of a swing-up; none without an option."""

    velocity_noise: Annotated[float, optional(text="standard deviation of the measured velocities' noise (rad/s).")]
    torque_noise: Annotated[float, optional(text="standard deviation of the torque's noise (N m).")]
    torque_response: Annotated[float, optional(text="motor response; 1 is a perfect motor.")]
    delay: Annotated[float, optional(text="age of what the controller measures (s).")]
    pushes: Annotated[bool, optional(text="push the driven joint three times, as the robustness board does.")]


class EstimatorOptions(TypedDict, total=False):
    """Whether a state estimator stands before the controller; by default where the policy file has one."""

    estimator: Annotated[bool, optional(text="put a state estimator before the controller, or judge it without.")]


class PlantOptions(TypedDict, total=False):
    """Which plant; by default the leaderboards', design C.1 without friction and rotors' inertia."""

    plant: Annotated[str, optional("PLANT", f"{PLANTS}; default: the leaderboards' plant, C.1 without friction.")]
    frictionless: Annotated[bool, optional(text="leave the plant's friction and rotors' inertia out.")]


NO_OPTIONS: Any = {}
"""Nothing was given of a class of options."""


def plant_of(options: PlantOptions) -> Plant:
    """The plant that the options name; the leaderboards' without any."""
    if "plant" not in options:
        if options.get("frictionless"):
            raise SwingupError("--frictionless needs --plant: the leaderboards' plant has no friction")
        return LEADERBOARD
    found = load_plant(options["plant"])
    return found.frictionless() if options.get("frictionless") else found


PLANT_FORMATS = (*PARAMETER_FILES, *MODEL_FILES)


def check_outputs(formats: Sequence[str], *paths: str | None) -> None:
    """Refuse files that cannot be written, before the work that makes their content; None is not a file."""
    for path in paths:
        if path is not None:
            check_suffix(path, formats)
            check_writable(path)


def named_values(option: str, words: Iterable[str], example: str) -> dict[str, float]:
    """NAME=VALUE words of an option as a map."""
    found: dict[str, float] = {}
    for word in words:
        name, equals, value = word.rpartition("=")
        try:
            number = float(value)
        except ValueError:
            equals = ""
        if not equals or not name:
            raise SwingupError(f"{option} {quoted(word)}: write NAME=VALUE, as in {example}")
        if name in found:
            raise SwingupError(f"{option} gives {one_line(name, 60)} twice: give it once")
        found[name] = number
    return found


def disturbance_of(options: DisturbanceOptions) -> DisturbanceSettings | None:
    """What the options disturb; None without any."""
    given: dict[str, Any] = {**options, "pushes": PushRules() if options.get("pushes") else None}
    return DisturbanceSettings(**given) if options else None


def plant_note(plant: Plant, robot: str) -> str:
    """What a result's headline says of its plant; nothing of the leaderboards'."""
    if plant == LEADERBOARD:
        return ""
    return f", plant {plant}, torque/gravity {torque_over_gravity(plant.driven(robot)):.2f}"


def judged_name(name: str, controller: object) -> str:
    """A controller's name, with a note on what was judged: with an estimator or without, or a policy alone."""
    if isinstance(controller, RegulatingController):
        return f"{name}, without estimator"
    alone = ", policy alone" if isinstance(controller, PolicyController) else ""
    return name + (", with estimator" if has_estimator(controller) else alone)


def task_name(robot: Robot | None, env: str | None) -> str:
    """The robot's name or the Gymnasium id, of which one is given."""
    if (robot is None) == (env is None):
        raise SwingupError(f"robot = {robot and robot.name!r} and env = {env!r}: give one of the two")
    return robot.name if robot else str(env)
