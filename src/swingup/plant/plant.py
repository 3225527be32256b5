"""A plant, the facts about one double pendulum, and the robots, which differ in the joint that is driven.

NumPy and Python's standard library suffice here, since robots run policies without JAX and PyYAML.
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from ..common.checks import LARGEST_NUMBER, one_of
from ..common.errors import SwingupError, quoted
from .equations import Friction, Lumped, Number, mass_entries


@dataclass(frozen=True)
class Robot:
    """An underactuated double pendulum: which of the two joints is driven."""

    name: str  # acrobot or pendubot
    joint: int  # Index of the driven joint: 0 is the shoulder, 1 the elbow

    @property
    def actuation(self) -> tuple[float, float]:
        """Diagonal of B: 1 for the driven joint, 0 for the passive one."""
        return (1.0, 0.0) if self.joint == 0 else (0.0, 1.0)


ROBOTS = {robot.name: robot for robot in (Robot("acrobot", joint=1), Robot("pendubot", joint=0))}

TORQUE_LIMIT = 6.0  # Torque limit of the driven joint on the leaderboards (N m)


def get_robot(name: str | Robot) -> Robot:
    """Find a robot by its name; a ``Robot`` is returned as it is."""
    if isinstance(name, Robot):
        return name
    return ROBOTS[one_of("robot", name, ROBOTS)]


SMALLEST_NUMBER = 1e-9
"""No mass (kg), length (m), gear ratio, gravity (m/s²) or torque limit (N m) above 0 comes near this; squares of
smaller numbers might underflow."""

FRICTIONLESS_SUFFIX = ", frictionless"  # Ends the name of a plant whose friction was left out


@dataclass(frozen=True)
class Plant:
    """The facts about one double pendulum, by RealAIGym's names in SI units, inertias about the joints.

    ``dynamics`` registers it with JAX as a pytree of its numbers: batch it with ``vmap`` to vary the plant. The
    tree leaves the name out, so that plants of all names share compiled code; what ``jit`` and ``tree.map`` return
    has none. Numbers are not checked here, since they may be traced: see :func:`validated`.
    """

    m1: Number
    """Mass of link 1 (kg)."""
    m2: Number
    """Mass of link 2 (kg)."""
    l1: Number
    """Length of link 1 (m)."""
    l2: Number
    """Length of link 2 (m)."""
    r1: Number
    """Distance of the centre of mass of link 1 from the shoulder (m)."""
    r2: Number
    """Distance of the centre of mass of link 2 from the elbow (m)."""
    I1: Number
    """Inertia of link 1 about the shoulder (kg m²)."""
    I2: Number
    """Inertia of link 2 about the elbow (kg m²)."""
    Ir: Number
    """Inertia of a motor's rotor (kg m²)."""
    gr: Number
    """Gear ratio of the motors."""
    b1: Number
    """Viscous damping of the shoulder (N m s/rad)."""
    b2: Number
    """Viscous damping of the elbow (N m s/rad)."""
    cf1: Number
    """Coulomb friction of the shoulder (N m)."""
    cf2: Number
    """Coulomb friction of the elbow (N m)."""
    g: Number
    """Gravity (m/s²)."""
    tl1: Number
    """Torque limit of the shoulder's motor (N m); 0 once a robot is chosen that drives the elbow alone."""
    tl2: Number
    """Torque limit of the elbow's motor (N m); 0 once a robot is chosen that drives the shoulder alone."""
    zero1: Number = 0.0
    """What the shoulder's encoder shows where link 1 hangs down (rad). Simulations measure with it, controllers
    subtract it; in no equation of motion."""
    zero2: Number = 0.0
    """What the elbow's encoder shows where link 2 is in line with link 1 (rad)."""
    name: str = field(default="", compare=False)
    """A shipped plant's name, or the file that it was read from. Not compared."""

    def __str__(self) -> str:
        return self.name or "unnamed"

    @property
    def length(self) -> Number:
        """Height of the tip above the shoulder when upright, l1 + l2 (m)."""
        return self.l1 + self.l2

    @property
    def friction(self) -> Friction | None:
        """Friction of the joints; None if there is none."""
        found = Friction((self.b1, self.b2), (self.cf1, self.cf2))
        # None, not zeros: programs for a plant without friction then have no arctangents.
        return found if any(any(pair) for pair in found) else None

    def limit(self, joint: int) -> Number:
        """Torque limit of a joint (N m)."""
        return (self.tl1, self.tl2)[joint]

    def values(self) -> dict[str, Number]:
        """The numbers by name."""
        return {name: getattr(self, name) for name in NAMES}

    def changed(self, **values: Number) -> "Plant":
        """The plant with some other numbers."""
        return dataclasses.replace(self, **values)

    def driven(self, robot: Robot | str) -> "Plant":
        """The plant with a torque limit of 0 on the joint that the robot does not drive."""
        first, second = get_robot(robot).actuation
        return self.changed(tl1=self.tl1 * first, tl2=self.tl2 * second)

    def needs_motor(self, robot: Robot | str) -> None:
        """Refuse a plant whose driven joint has no motor."""
        robot = get_robot(robot)
        if not self.limit(robot.joint) > 0:
            limit, other = f"tl{robot.joint + 1}", "pendubot" if robot.joint else "acrobot"
            raise SwingupError(
                f"{self.name or 'the plant'} has {limit} = 0, and the {robot.name}'s motor is at joint "
                f"{robot.joint + 1}: give {limit} a torque limit (N m), or use it as {other}"
            )

    @property
    def zeros(self) -> tuple[Number, Number]:
        """The encoders' zeros of shoulder and elbow (rad)."""
        return (self.zero1, self.zero2)

    def frictionless(self) -> "Plant":
        """The plant without friction and rotors' inertia, idealised as the leaderboards idealise C.1."""
        without = dataclasses.replace(self, b1=0.0, b2=0.0, cf1=0.0, cf2=0.0, Ir=0.0)
        name = self.name if without == self else f"{self}{FRICTIONLESS_SUFFIX}"
        return validated(dataclasses.replace(without, name=name))

    def summary(self, robot: Robot | str) -> dict[str, Any]:
        """What a result says of its plant, ready for JSON."""
        return {"plant": str(self), "torque_over_gravity": torque_over_gravity(self.driven(robot))}


NAMES = tuple(each.name for each in dataclasses.fields(Plant) if each.name != "name")  # Names of the numbers
ZEROS = {"zero1": 0.0, "zero2": 0.0}
"""Numbers that a plant without a log lacks, and their values there."""
LARGEST_ZERO = 2 * math.pi  # rad; a larger one is in degrees

RANGE_REFUSED = "is a range, and a plant has facts: give one value, or use the file as a domain"
"""The end of a message about a range in the place of a plant's number."""

PlantLike: TypeAlias = Plant | str | Path  # A plant, a shipped plant's name, or a file

LEADERBOARD = Plant(
    m1=0.5234602302310271, m2=0.6255677234174437, l1=0.2, l2=0.3, r1=0.2, r2=0.25569305436052964,
    I1=0.031887199591513114, I2=0.05086984812807257, Ir=0.0, gr=6.0,
    b1=0.0, b2=0.0, cf1=0.0, cf2=0.0, g=9.81, tl1=TORQUE_LIMIT, tl2=TORQUE_LIMIT, name="leaderboard",
)  # fmt: skip
"""The plant of the leaderboards: C.1 without friction and rotors' inertia. It needs no file, and so no PyYAML."""


def make_plant(values: Mapping[str, Any], source: str, name: str = "") -> Plant:
    """A plant from values by name; other names are ignored. Errors name the ``source``."""
    values = ZEROS | dict(values)
    missing = [each for each in NAMES if each not in values]
    if missing:
        raise SwingupError(f"{source} lacks {', '.join(missing)}: add them in SI units")
    return validated(Plant(**{each: values[each] for each in NAMES}, name=name))


def validated(plant: Plant) -> Plant:
    """The plant with Python's floats, if they describe a pendulum.

    Negative friction and inertias below m r² are allowed: the robustness benchmark contains both.
    """
    found = plant.changed(**{name: _real(name, value) for name, value in plant.values().items()})
    for name in ("m1", "m2", "l1", "l2", "gr", "g", "tl1", "tl2"):
        # A joint may be without a motor.
        value, is_motor = getattr(found, name), name.startswith("tl")
        if value < 0 or (value == 0 and not is_motor):
            raise SwingupError(
                f"parameter {name} = {value:g} must {'not be negative' if is_motor else 'be positive'}"
            )
        if 0 < value < SMALLEST_NUMBER:
            raise SwingupError(f"parameter {name} = {value:g} must be at least {SMALLEST_NUMBER:g}: use SI units")
    for name in ZEROS:
        if not abs(value := getattr(found, name)) <= LARGEST_ZERO:
            raise SwingupError(f"parameter {name} = {value:g} must be within ±2π: write it in rad")
    # det M is concave in cos(q2), so that its minimum lies at cos(q2) = 1 or -1.
    for cos_q2 in (1.0, -1.0):
        m11, m12, m22 = mass_entries(lump(found), cos_q2)
        if not (m22 > 0 and m11 * m22 - m12 * m12 > 0):
            raise SwingupError(
                f"mass matrix is not positive definite at cos(q2) = {cos_q2:g}: "
                f"raise I1 = {found.I1:g} or I2 = {found.I2:g}"
            )
    return found


def _real(name: str, value: Any) -> float:
    """A parameter as a float: a number, an array of one, or a text that is one, as YAML's 4e-5 is."""
    try:
        # float(True) would be 1.
        if isinstance(value, bool):
            raise TypeError("a truth value")
        real = float(value)
    # An integer beyond floating point: the check below names it.
    except OverflowError:
        real = math.inf
    except (TypeError, ValueError):
        raise SwingupError(
            f"parameter {name} = {quoted(value)} is not a number: write its value in SI units"
        ) from None
    if not abs(real) < LARGEST_NUMBER:
        raise SwingupError(f"parameter {name} = {real:g} must be finite and below {LARGEST_NUMBER:g}: use SI units")
    return real


def lump(p: Plant) -> Lumped:
    """The combinations for a plant."""
    return Lumped(
        # I2 is about the elbow: seen from the shoulder, link 2 adds its mass there.
        shoulder=p.I1 + p.I2 + p.m2 * p.l1**2,
        elbow=p.I2,
        coupling=p.m2 * p.l1 * p.r2,
        gravity1=(p.m1 * p.r1 + p.m2 * p.l1) * p.g,
        gravity2=p.m2 * p.g * p.r2,
        reflected=p.gr**2 * p.Ir,
        geared=p.gr * p.Ir,
        rotor=p.Ir,
    )


def torque_over_gravity(parameters: Plant) -> float:
    """Larger torque limit over Γ: above 1 a motor at the shoulder can hold the stretched arm level.

    A plant without a positive inertia, or whose stretched arm gravity does not pull down, is refused.
    """
    return float(max(parameters.tl1, parameters.tl2)) / time_and_gravity(parameters)[1]


def time_and_gravity(p: Plant) -> tuple[float, float]:
    """T (s) and Γ (N m)."""
    plant = lump(p)
    inertia, gravity = float(plant.shoulder + 2 * plant.coupling), float(plant.gravity1 + plant.gravity2)
    # Negated, so that NaN is refused as well.
    if not gravity > 0:
        raise SwingupError(
            f"gravity's torque on the level arm is {gravity:g} N m: m1 r1 + m2 (l1 + r2) must be positive"
        )
    if not inertia > 0:
        raise SwingupError(f"the stretched arm's inertia is {inertia:g} kg m² without rotors: raise I1 or I2")
    return math.sqrt(inertia / gravity), gravity
