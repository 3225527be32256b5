"""The plant that a policy was made for, as its file holds it, and how another plant differs from it."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..common.checks import finite_number, one_of
from ..common.errors import SwingupError, quoted
from ..plant.base_parameters import BASE_NAMES, FRICTIONS, base_parameters
from ..plant.equations import friction
from ..plant.plant import NAMES, Plant, Robot, make_plant, validated
from .network.stages import PlantStage

PLANT = "plant"
"""Key of the plant in a policy file's metadata."""


def policy_plant(plant: Plant, robot: Robot) -> Plant:
    """The plant of a policy file: the passive joint has no torque."""
    found = validated(plant.driven(robot))
    if found.limit(robot.joint) <= 0:
        limit = ("tl1", "tl2")[robot.joint]
        raise SwingupError(f"plant parameter {limit} = 0: the {robot.name}'s driven joint needs a torque limit")
    return found


def read_plant(given: Any, robot: Robot) -> Plant:
    """The plant that a policy file's metadata holds."""
    if not isinstance(given, Mapping):
        raise SwingupError(
            f"plant {quoted(given)} is not an object of parameters: use those of docs/policy-format.md"
        )
    name = given.get("name", "")
    if not isinstance(name, str):
        raise SwingupError(f"plant name {quoted(name)} is not a text")
    for each in given:
        if each != "name":
            one_of("plant parameter", each, NAMES)
    values = {each: finite_number(f"plant parameter {each}", given[each]) for each in NAMES if each in given}
    return policy_plant(make_plant(values, "its plant", name), robot)


def write_plant(plant: Plant) -> dict[str, Any]:
    """The plant as a policy file's metadata has it."""
    return {"name": plant.name, **plant.values()}


LARGE_DIFFERENCE = 0.1
"""From this relative difference of a base parameter on, two plants differ much."""


def plant_difference(
    made_for: Plant, plant: Plant, robot: Robot, identified: PlantStage | None = None
) -> str | None:
    """One sentence on how a plant differs from the one that a policy was made for; None if it differs little.

    Compared are the base parameters, which alone act in the equations of motion, gravity, the driven joint's torque
    limit, and both joints' friction at 1 rad/s as a part of that limit. A policy that sees the plant that an
    identifier finds is made for more than one: there the inertial parameters and the rotor's are compared with what
    the policy can be told, and friction is left out, since it is compensated. ``identified`` is how the policy sees
    what an identifier finds; None for a policy of one plant.
    """
    # Lengths, gravity and limits are not identified: they count for every policy.
    one, other = _facts(made_for, robot), _facts(plant, robot)
    if identified is None:
        one, other = one | _bases(made_for), other | _bases(plant)
    limit = made_for.limit(robot.joint)
    # Where a number is 0, the change itself counts.
    changes = {
        name: (other[name] - value) / (limit if name.startswith("friction") else abs(value) or 1.0)
        for name, value in one.items()
    }
    name = max(changes, key=lambda each: abs(changes[each]))
    if not abs(changes[name]) > LARGE_DIFFERENCE:
        return None if identified is None else beyond(identified, plant)
    own = f"{quoted(made_for.name)} " if made_for.name else ""
    more = "the torque limit" if name.startswith("friction") else "it"
    many = sum(abs(change) > LARGE_DIFFERENCE for change in changes.values()) - 1
    others = f"; {many} more differ by over {100 * LARGE_DIFFERENCE:g} %" if many else ""
    return (
        f"the policy was made for a plant {own}with {name} = {one[name]:.4g}, here it is {other[name]:.4g} "
        f"({100 * changes[name]:+.0f} % of {more}{others}): train or refine it on this plant"
    )


def beyond(stage: PlantStage, plant: Plant) -> str | None:
    """One sentence on a plant's base parameter that is farthest beyond what a policy can be told; None for none."""
    base = base_parameters(plant)
    far = np.abs(base - stage.centre) / stage.scale
    # Friction is compensated: the policy is told what is left of it.
    far[FRICTIONS] = 0.0
    worst = int(np.argmax(far))
    if not far[worst] > stage.clip:
        return None
    least, most = stage.centre[worst] + np.array([-1, 1]) * stage.clip * stage.scale[worst]
    return (
        f"the policy can be told a base parameter {BASE_NAMES[worst]} from {max(least, 0.0):.3g} to {most:.3g}, "
        f"here it is {base[worst]:.3g}: train or refine another on this plant"
    )


def _facts(plant: Plant, robot: Robot) -> dict[str, float]:
    """What nothing identifies."""
    names = {"l1": "l1", "l2": "l2", "g": "g", "the torque limit": ("tl1", "tl2")[robot.joint]}
    return {name: float(getattr(plant, attribute)) for name, attribute in names.items()}


def _bases(plant: Plant) -> dict[str, float]:
    """What an identifier can find, with friction at 1 rad/s (N m)."""
    both, elbow, second, first, b1, b2, cf1, cf2, rotor = base_parameters(plant).tolist()
    geared = float(plant.gr) ** 2 * rotor
    return {
        "m1 r1 + m2 l1": first,
        "m2 r2": second,
        "I1 + m2 l1² + gr² Ir": both - elbow + geared,
        "I2 + gr² Ir": elbow + geared,
        "friction of the shoulder": friction(b1, cf1, 1.0, math.atan),
        "friction of the elbow": friction(b2, cf2, 1.0, math.atan),
    }
