"""A plant: the facts about one double pendulum, with a name; and those that the package ships."""

import dataclasses
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, TypeAlias

from ..checks import suggestion
from ..errors import SwingupError
from ..physics.parameters import (
    NAMES,
    Parameters,
    Robot,
    get_robot,
    leaderboard_parameters,
    load_parameters,
    make_parameters,
    validated,
)
from ..physics.units import torque_over_gravity
from ..robots import TORQUE_LIMIT
from ..text import one_line, quoted
from ..yaml_map import read_map

LEADERBOARD = "leaderboard"
"""Name of the plant of the leaderboards: C.1 without friction and rotors' inertia."""


FRICTIONLESS = ", frictionless"
"""Ends the name of a plant whose friction was left out."""


@dataclass(frozen=True)
class Plant:
    """The facts about one double pendulum."""

    name: str = field(compare=False)
    """A shipped plant's name, or the file that it was read from."""
    parameters: Parameters
    """Both torque limits are those of the motors, whichever joint a robot drives."""

    def __str__(self) -> str:
        """Its name."""
        return self.name

    def driven(self, robot: Robot | str) -> Parameters:
        """The parameters with a torque limit of 0 on the joint that the robot does not drive."""
        first, second = get_robot(robot).actuation
        p = self.parameters
        return dataclasses.replace(p, tl1=p.tl1 * first, tl2=p.tl2 * second)

    def frictionless(self) -> "Plant":
        """The plant without friction and rotors' inertia, idealised as the leaderboards idealise C.1."""
        ideal = dataclasses.replace(self.parameters, b1=0.0, b2=0.0, cf1=0.0, cf2=0.0, Ir=0.0)
        # Without the rotors a mass matrix may stop being positive definite.
        return Plant(f"{self.name}{FRICTIONLESS}", validated(ideal))


PlantLike: TypeAlias = Plant | Parameters | str | Path
"""A plant, its parameters, a shipped plant's name, or a parameter file."""


@dataclass(frozen=True)
class _Shipped:
    file: str
    """In ``physics/models``, with its source."""
    torque_limit: float | None = None
    """What the competitions allow (N m), where the file has more."""


SHIPPED_PLANTS = {
    "A.0": _Shipped("design_A.0_model_2.0.yml", TORQUE_LIMIT),
    "B.0": _Shipped("design_B.0_model_1.0.yml", TORQUE_LIMIT),
    "C.0": _Shipped("design_C.0_model_3.0.yml", TORQUE_LIMIT),
    "C.1": _Shipped("design_C.1_model_1.0.yml", TORQUE_LIMIT),
    "cloudpendulum": _Shipped("cloudpendulum.yml"),
    "cloudpendulum-rods": _Shipped("cloudpendulum_two_rods.yml"),
}
"""Plants that the package ships: RealAIGym's designs and a CloudPendulum as identified, and it as two rods."""


def load_plant(source: PlantLike) -> Plant:
    """Find a plant by its name, or read it from a parameter file.

    Args:
        source: one of :data:`SHIPPED_PLANTS`, a YAML file with RealAIGym's names (its ``model_parameters.yml``, or
            what ``swingup identify`` wrote), parameters, or a plant, which is returned as it is. A file with an
            entry ``plant`` has that plant's values where it gives none itself.

    Raises:
        SwingupError: there is no such plant, or the file cannot be read, lacks a value, has a range, or makes no
            pendulum.
    """
    if isinstance(source, Plant):
        return source
    if isinstance(source, Parameters):
        return Plant("parameters", validated(source))
    name = str(source)
    if name in SHIPPED_PLANTS:
        return _shipped_plant(name)
    if not is_plant_name(name):
        known = ", ".join(SHIPPED_PLANTS)
        near = suggestion(name, SHIPPED_PLANTS)
        raise SwingupError(f"unknown plant {quoted(name)}: use {known} or a parameter file (.yml){near}")
    try:
        return Plant(name, _facts(name))
    except SwingupError as error:
        raise SwingupError(f"plant {one_line(name)}: {error}") from error


def is_plant_name(name: str) -> bool:
    """Whether a name is a shipped plant's or a parameter file's, as the command line takes them."""
    return name in SHIPPED_PLANTS or name.endswith((".yml", ".yaml"))


def find_plant(plant: PlantLike | None) -> Plant | None:
    """As :func:`load_plant`; None stays None, which stands for the leaderboards' plant."""
    return None if plant is None else load_plant(plant)


def robot_parameters(plant: PlantLike | None, robot: Robot | str) -> Parameters:
    """The plant of a robot, with one driven joint: a plant's, or the leaderboards' where it is None.

    Raises:
        SwingupError: as :func:`load_plant`, or there is no such robot.
    """
    robot = get_robot(robot)
    return leaderboard_parameters(robot) if plant is None else load_plant(plant).driven(robot)


def plant_as_dict(plant: Plant | None, robot: Robot | str) -> dict[str, Any]:
    """What a result says of its plant, ready for JSON; nothing of the leaderboards' (None)."""
    if plant is None:
        return {}
    return {"plant": plant.name, "torque_over_gravity": torque_over_gravity(plant.driven(robot))}


def base_plant(source: object, folder: str | Path) -> Plant:
    """The plant that a file's entry ``plant`` names: a shipped one, or a file with all values, seen from a folder.

    Raises:
        SwingupError: there is no such plant, or its file lacks values.
    """
    if isinstance(source, str) and source in SHIPPED_PLANTS:
        return _shipped_plant(source)
    if not isinstance(source, str) or not source.endswith((".yml", ".yaml")):
        known = ", ".join(SHIPPED_PLANTS)
        raise SwingupError(f"plant = {quoted(source)} is no plant: use {known} or a parameter file (.yml)")
    return Plant(source, load_parameters(Path(folder) / source))


def _facts(file: str) -> Parameters:
    entries = read_map(file, "parameter")
    base = vars(base_plant(entries["plant"], Path(file).parent).parameters) if "plant" in entries else {}
    for name in NAMES:
        if isinstance(entries.get(name), list):
            raise SwingupError(
                f"{name} = {quoted(entries[name])} is a range, and a plant has facts: "
                "give one value, or use the file as a domain"
            )
    return make_parameters(base | entries, f"parameter file {file}")


def _shipped_plant(name: str) -> Plant:
    shipped = SHIPPED_PLANTS[name]
    with resources.as_file(resources.files("swingup") / "physics" / "models" / shipped.file) as path:
        parameters = load_parameters(path)
    if shipped.torque_limit is not None:
        parameters = dataclasses.replace(parameters, tl1=shipped.torque_limit, tl2=shipped.torque_limit)
    return Plant(name, parameters)
