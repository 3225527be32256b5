"""Arguments that several commands share."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypedDict

from tyro.conf import FlagCreatePairsOff, Positional, arg
from tyro.constructors import PrimitiveConstructorSpec

from ..benchmark.disturbances import DisturbanceSettings
from ..benchmark.rules import PushRules
from ..common.checks import one_of
from ..common.errors import SwingupError
from ..controllers.registry import BUILT_IN, has_estimator
from ..controllers.stack.controller import PolicyController
from ..controllers.stack.regulator import RegulatingController
from ..plant.plant import LEADERBOARD, SHIPPED_PLANTS, Plant, load_plant
from ..plant.robots import ROBOTS, Robot, get_robot
from ..plant.units import torque_over_gravity
from .parsing import value_of


def optional(metavar: str | None = None, text: str | None = None) -> Any:
    """An option that may be left out, without tyro's "(default: None)": the text says what then happens."""
    return arg(metavar=metavar, help=text, help_behavior_hint="")


def word_of(kind: str, *words: str) -> PrimitiveConstructorSpec[str]:
    """One of several words."""
    return value_of(lambda word: one_of(kind, word, words), "{" + ",".join(words) + "}")


def split_commas(values: Iterable[str]) -> tuple[str, ...]:
    """Values of one option, which spaces or commas may separate; a file whose name has a comma is one value."""
    return tuple(
        part for value in values for part in ([value] if Path(value).is_file() else value.split(",")) if part
    )


def _robots(name: str) -> Sequence[Robot]:
    return tuple(ROBOTS.values()) if name == "all" else (get_robot(name),)


NAMES = PrimitiveConstructorSpec(
    nargs="*",
    metavar="NAME...",
    instance_from_str=split_commas,
    is_instance=lambda value: True,
    str_from_instance=list,
)
ROBOT = value_of(get_robot, "ROBOT", lambda robot: getattr(robot, "name", ""))
RobotName = Positional[Annotated[Robot, ROBOT, arg(help="acrobot or pendubot.")]]
RobotOrNone = Positional[Annotated[Robot | None, ROBOT, optional(text="acrobot or pendubot.")]]
RobotOrAll = Positional[
    Annotated[
        Sequence[Robot], value_of(_robots, "ROBOT", lambda robots: "all"), arg(help="acrobot, pendubot or all.")
    ]
]
OptionalRobot = Annotated[Robot | None, ROBOT, optional()]
"""An option, where a log or a file may say it."""
OptionalText = Annotated[str | None, optional()]
OptionalInt = Annotated[int | None, optional()]
OptionalFloat = Annotated[float | None, optional()]
OptionalFile = Annotated[str | None, optional("FILE")]
OptionalDomain = Annotated[str | None, optional("DOMAIN")]
ControllerName = Annotated[
    str, arg(metavar="NAME", help=f"{', '.join(BUILT_IN)}, a policy file (.safetensors), or module:object.")
]
ControllerNames = Annotated[
    tuple[str, ...], NAMES, optional(text="controllers of yours: policy files or module:object.")
]
Names = Annotated[tuple[str, ...], NAMES]
OptionalNames = Annotated[tuple[str, ...], NAMES, optional()]
PLANTS = f"{', '.join(SHIPPED_PLANTS)}, or a parameter file (.yml) as RealAIGym's model_parameters.yml"
PLANT_HELP = f"plant: {PLANTS}; default: the leaderboards' plant, C.1 without friction."
EVERY_ROBOT = tuple(ROBOTS.values())


@dataclass(frozen=True)
class DisturbanceOptions:
    """Disturbances of a swing-up."""

    velocity_noise: float = 0.0
    """Standard deviation of the noise on measured velocities (rad/s)."""
    torque_noise: float = 0.0
    """Standard deviation of the noise on the torque (N m)."""
    torque_response: float = 1.0
    """Motor response: 1 is a perfect motor."""
    delay: float = 0.0
    """Age of what the controller measures (s)."""
    pushes: FlagCreatePairsOff[bool] = False
    """Push the driven joint three times, as the robustness benchmark does."""

    def make(self) -> DisturbanceSettings | None:
        """The disturbance, or None if nothing disturbs.

        Raises:
            SwingupError: a value is out of range.
        """
        made = DisturbanceSettings(**vars(self) | {"pushes": PushRules() if self.pushes else None})
        return None if self == DisturbanceOptions() else made


class EstimatorOptions(TypedDict, total=False):
    """Whether a state estimator stands before the controller; by default where the policy file has one."""

    estimator: Annotated[bool, optional(text="Put a state estimator before the controller, or judge it without.")]


@dataclass(frozen=True)
class PlantOptions:
    """Which plant; by default the leaderboards', design C.1 without friction and rotors' inertia."""

    plant: Annotated[str | None, optional("PLANT", PLANT_HELP)] = None
    frictionless: FlagCreatePairsOff[bool] = False
    """Leave the plant's friction and rotors' inertia out, as the leaderboards do."""

    def make(self) -> Plant:
        """The plant that the options name; the leaderboards' without any.

        Raises:
            SwingupError: as :meth:`given`.
        """
        return self.given() or LEADERBOARD

    def given(self) -> Plant | None:
        """The plant that the options name; None without any.

        Raises:
            SwingupError: there is no such plant, or its friction is left out where none was named.
        """
        if self.plant is None:
            if self.frictionless:
                raise SwingupError("--frictionless needs --plant: the leaderboards' plant has no friction")
            return None
        found = load_plant(self.plant)
        return found.frictionless() if self.frictionless else found


NO_PLANT = PlantOptions()
"""The default of the commands: the leaderboards' plant."""


def changed(options: DisturbanceOptions | PlantOptions) -> dict[str, Any]:
    """The options that were given, by name."""
    default = vars(type(options)())
    return {name: value for name, value in vars(options).items() if value != default[name]}


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
    """The robot's name or the Gymnasium id, of which one is given.

    Raises:
        SwingupError: both or none are given.
    """
    if (robot is None) == (env is None):
        raise SwingupError(f"robot = {robot and robot.name!r} and env = {env!r}: give one of the two")
    return robot.name if robot else str(env)
