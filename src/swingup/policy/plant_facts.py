"""The plant that a policy was made for, as its file holds it, and how another plant differs from it."""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ..checks import LARGEST, finite_number, suggestion
from ..errors import SwingupError
from ..physics.base_parameters import BASE_NAMES, FRICTIONS, base_parameters
from ..physics.damped import Friction
from ..physics.validity import check_pendulum
from ..robots import TORQUE_LIMIT, Robot
from ..text import quoted
from .plant import identified_values
from .stages import PlantStage

PLANT = "plant"
"""Key of the plant in a policy file's metadata."""
LEADERBOARD = "leaderboard"
"""Name of the plant of the leaderboards."""
IDEAL = {"b1": 0.0, "b2": 0.0, "cf1": 0.0, "cf2": 0.0, "Ir": 0.0}
"""What the leaderboards' plant has not, whatever the model's file says: friction and motor inertia."""


@dataclass(frozen=True)
class PolicyPlant:
    """The facts about one pendulum with one driven joint, by RealAIGym's names (SI, inertias about the joints)."""

    m1: float
    m2: float
    l1: float
    l2: float
    r1: float
    r2: float
    I1: float
    I2: float
    Ir: float
    gr: float
    b1: float
    b2: float
    cf1: float
    cf2: float
    g: float
    tl1: float
    """Torque limit of the shoulder (N m), 0 if the elbow is driven; ``tl2`` likewise."""
    tl2: float
    name: str = field(default="", compare=False)
    """The plant's name, or the file that it was read from; not compared."""

    def __post_init__(self) -> None:
        """Refuse what is no pendulum.

        Raises:
            SwingupError: a value is no finite number, a mass, length or g is not positive, a torque limit is
                negative, or the mass matrix is not positive definite in every configuration.
        """
        for name in PLANT_NAMES:
            value = finite_number(f"plant parameter {name}", getattr(self, name), -LARGEST, LARGEST)
            object.__setattr__(self, name, value)
        check_pendulum({name: getattr(self, name) for name in PLANT_NAMES})

    def limit(self, joint: int) -> float:
        """Torque limit of a joint (N m)."""
        return (self.tl1, self.tl2)[joint]

    @property
    def friction(self) -> Friction | None:
        """Friction of the joints; None if there is none."""
        found = Friction((self.b1, self.b2), (self.cf1, self.cf2))
        return found if any(any(pair) for pair in found) else None


PLANT_NAMES = tuple(each.name for each in dataclasses.fields(PolicyPlant) if each.name != "name")


def policy_plant(parameters: Any, robot: Robot, name: str = "") -> PolicyPlant:
    """The plant of a policy file from anything with attributes of these names; the passive joint has no torque.

    Raises:
        SwingupError: the values make no pendulum, or the driven joint has no torque.
    """
    values = {each: float(getattr(parameters, each)) for each in PLANT_NAMES}
    limits = {each: values[each] * acts for each, acts in zip(("tl1", "tl2"), robot.actuation, strict=True)}
    return _driven(PolicyPlant(**(values | limits), name=name), robot)


def leaderboard_plant(robot: Robot) -> PolicyPlant:
    """The leaderboards' plant, that of files of version 1: C.1 without friction and motor inertia."""
    limits = {"tl1": TORQUE_LIMIT * robot.actuation[0], "tl2": TORQUE_LIMIT * robot.actuation[1]}
    values = identified_values() | IDEAL | limits
    return PolicyPlant(**{each: values[each] for each in PLANT_NAMES}, name=LEADERBOARD)


def read_plant(metadata: Mapping[str, Any], robot: Robot) -> PolicyPlant:
    """The plant in a policy file's metadata, or the leaderboards'.

    Raises:
        SwingupError: it is no object of the parameters, or they make no pendulum.
    """
    if PLANT not in metadata:
        return leaderboard_plant(robot)
    given = metadata[PLANT]
    if not isinstance(given, Mapping):
        raise SwingupError(f"plant {quoted(given)} is no object of parameters: use those of docs/policy-format.md")
    name = given.get("name", "")
    if not isinstance(name, str):
        raise SwingupError(f"plant name {quoted(name)} is no text")
    for each in given:
        if each not in PLANT_NAMES and each != "name":
            near = suggestion(each, PLANT_NAMES)
            raise SwingupError(f"unknown plant parameter {quoted(each)}: use {', '.join(PLANT_NAMES)}{near}")
    missing = [each for each in PLANT_NAMES if each not in given]
    if missing:
        raise SwingupError(f"its plant lacks {', '.join(missing)}: add them in SI units")
    return _driven(PolicyPlant(**{each: given[each] for each in PLANT_NAMES}, name=name), robot)


def write_plant(plant: PolicyPlant) -> dict[str, Any]:
    """The plant as a policy file's metadata has it."""
    values = asdict(plant)
    return {"name": values.pop("name"), **values}


def _driven(plant: PolicyPlant, robot: Robot) -> PolicyPlant:
    if plant.limit(robot.joint) <= 0:
        limit = ("tl1", "tl2")[robot.joint]
        raise SwingupError(f"plant parameter {limit} = 0: the {robot.name}'s driven joint needs a torque limit")
    return plant


DIFFERENT = 0.1
"""From this relative difference of a base parameter on, two plants differ much."""


def plant_difference(
    made_for: PolicyPlant, plant: Any, robot: Robot, identified: PlantStage | None = None
) -> str | None:
    """One sentence on how a plant differs from the one that a policy was made for; None if it differs little.

    Compared are the base parameters, which alone act in the equations of motion, gravity, the driven joint's torque
    limit, and both joints' friction at 1 rad/s as a part of that limit. A policy that sees the plant that an
    identifier finds is made for more than one: there the inertial parameters and the rotor's are compared with what
    the policy can be told, and friction is left out, since it is compensated.

    Args:
        made_for: the policy's plant.
        plant: another one: anything with attributes of these names.
        robot: which joint is driven.
        identified: how the policy sees what an identifier finds; None for a policy of one plant.
    """
    one, other = _facts(made_for, robot), _facts(plant, robot)
    if identified is None:
        one, other = one | _bases(made_for), other | _bases(plant)
    limit = made_for.limit(robot.joint)
    changes = {
        name: (other[name] - value) / (limit if name.startswith("friction") else abs(value) or 1.0)
        for name, value in one.items()
    }
    name = max(changes, key=lambda each: abs(changes[each]))
    if not abs(changes[name]) > DIFFERENT:
        return None if identified is None else _beyond(identified, base_parameters(plant))
    own = f"{quoted(made_for.name)} " if made_for.name else ""
    more = "the torque limit" if name.startswith("friction") else "it"
    many = sum(abs(change) > DIFFERENT for change in changes.values()) - 1
    others = f"; {many} more differ by over {100 * DIFFERENT:g} %" if many else ""
    return (
        f"the policy was made for a plant {own}with {name} = {one[name]:.4g}, here it is {other[name]:.4g} "
        f"({100 * changes[name]:+.0f} % of {more}{others}): train or refine it on this plant"
    )


def _beyond(stage: PlantStage, base: np.ndarray) -> str | None:
    """One sentence on the base parameter (9,) that a policy can be told least of; None if it can be told all."""
    far = np.abs(base - stage.centre) / stage.scale
    far[FRICTIONS] = 0.0
    worst = int(np.argmax(far))
    if not far[worst] > stage.clip:
        return None
    least, most = stage.centre[worst] + np.array([-1, 1]) * stage.clip * stage.scale[worst]
    return (
        f"the policy can be told a base parameter {BASE_NAMES[worst]} from {max(least, 0.0):.3g} to {most:.3g}, "
        f"here it is {base[worst]:.3g}: train or refine another on this plant"
    )


def _facts(plant: Any, robot: Robot) -> dict[str, float]:
    """What nothing identifies."""
    names = {"l1": "l1", "l2": "l2", "g": "g", "the torque limit": ("tl1", "tl2")[robot.joint]}
    return {name: float(getattr(plant, attribute)) for name, attribute in names.items()}


def _bases(plant: Any) -> dict[str, float]:
    """What an identifier can find, with friction at 1 rad/s (N m)."""
    p = {name: float(getattr(plant, name)) for name in PLANT_NAMES}
    rotor, at_rate = p["gr"] ** 2 * p["Ir"], math.atan(100.0)
    return {
        "m1 r1 + m2 l1": p["m1"] * p["r1"] + p["m2"] * p["l1"],
        "m2 r2": p["m2"] * p["r2"],
        "I1 + m2 l1² + gr² Ir": p["I1"] + p["m2"] * p["l1"] ** 2 + rotor,
        "I2 + gr² Ir": p["I2"] + rotor,
        "friction of the shoulder": p["b1"] + p["cf1"] * at_rate,
        "friction of the elbow": p["b2"] + p["cf2"] * at_rate,
    }
