"""Arguments that several commands share."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, OmitArgPrefixes, Positional, arg

from ..benchmark.disturbances import DisturbanceSettings
from ..benchmark.rules import PushRules
from ..common.errors import SwingupError
from ..controllers.registry import BUILT_IN, has_estimator
from ..controllers.stack.controller import PolicyController
from ..controllers.stack.regulator import RegulatingController
from ..plant.plant import LEADERBOARD, SHIPPED_PLANTS, Plant, load_plant
from ..plant.robots import ROBOTS, Robot, get_robot
from ..plant.units import torque_over_gravity

RobotName = Positional[Annotated[str, arg(metavar="ROBOT", help="acrobot or pendubot.")]]
RobotOrNone = Positional[Annotated[str | None, arg(metavar="[ROBOT]", help="acrobot or pendubot.")]]
RobotOrAll = Positional[Annotated[str, arg(metavar="[ROBOT]", help="acrobot, pendubot or all.")]]
ControllerName = Annotated[
    str, arg(metavar="NAME", help=f"{', '.join(BUILT_IN)}, a policy file (.safetensors), or module:object.")
]
ControllerNames = Annotated[
    tuple[str, ...], arg(metavar="NAME...", help="controllers of yours: policy files or module:object.")
]
PLANT_HELP = (
    f"plant: {', '.join(SHIPPED_PLANTS)}, or a parameter file (.yml) as RealAIGym's model_parameters.yml; "
    "default: the leaderboards' plant, C.1 without friction."
)
DomainName = Annotated[str, arg(metavar="DOMAIN")]
DomainOrNone = Annotated[str | None, arg(metavar="DOMAIN")]


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
    pushes: bool = False
    """Push the driven joint three times, as the robustness benchmark does."""

    def make(self) -> DisturbanceSettings | None:
        """The disturbance, or None if nothing disturbs.

        Raises:
            SwingupError: a value is out of range.
        """
        numbers = {name: value for name, value in vars(self).items() if name != "pushes"}
        made = DisturbanceSettings(**numbers, pushes=PushRules() if self.pushes else None)
        return None if self == DisturbanceOptions() else made

    @property
    def flags(self) -> list[str]:
        """The options as they were given."""
        default = vars(DisturbanceOptions())
        given = {name: value for name, value in vars(self).items() if value != default[name]}
        return [
            f"--{name.replace('_', '-')}" + ("" if value is True else f"={value}") for name, value in given.items()
        ]


@dataclass(frozen=True)
class EstimatorOptions:
    """Whether a state estimator stands before the controller; by default where the policy file has one."""

    estimator: FlagCreatePairsOff[bool] = False
    """Put a state estimator before the controller."""
    no_estimator: FlagCreatePairsOff[bool] = False
    """Judge a policy alone, although its file has an estimator."""

    @property
    def wanted(self) -> bool | None:
        """True or False as the options say; None without either.

        Raises:
            SwingupError: both were given.
        """
        if self.estimator and self.no_estimator:
            raise SwingupError("--estimator and --no-estimator exclude each other: choose one")
        return None if self == EstimatorOptions() else self.estimator

    @property
    def flags(self) -> list[str]:
        """The options as they were given."""
        return [f"--{name.replace('_', '-')}" for name, given in vars(self).items() if given]


EstimatorFlags = OmitArgPrefixes[EstimatorOptions]


@dataclass(frozen=True)
class PlantOptions:
    """Which plant; by default the leaderboards', design C.1 without friction and rotors' inertia."""

    plant: Annotated[str | None, arg(metavar="PLANT", help=PLANT_HELP, help_behavior_hint="")] = None
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

    @property
    def flags(self) -> list[str]:
        """The options as they were given."""
        return [
            *([] if self.plant is None else [f"--plant={self.plant}"]),
            *(["--frictionless"] if self.frictionless else []),
        ]


PlantFlags = OmitArgPrefixes[PlantOptions]

NO_PLANT = PlantOptions()
"""The default of the commands: the leaderboards' plant."""


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


def split_commas(values: Iterable[str]) -> tuple[str, ...]:
    """Values of one option, which spaces or commas may separate; a file whose name has a comma is one value."""
    return tuple(
        part for value in values for part in ([value] if Path(value).is_file() else value.split(",")) if part
    )


def robots(name: str) -> Sequence[Robot]:
    """The robot of that name, or all of them.

    Raises:
        SwingupError: there is no such robot.
    """
    return list(ROBOTS.values()) if name == "all" else [get_robot(name)]


def task_name(robot: str | None, env: str | None) -> str:
    """The robot's name or the Gymnasium id, of which one is given.

    Raises:
        SwingupError: both or none are given, or there is no such robot.
    """
    if (robot is None) == (env is None):
        raise SwingupError(f"robot = {robot!r} and env = {env!r}: give one of the two")
    return env or get_robot(str(robot)).name
