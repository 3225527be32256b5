"""A pendulum's own units, relative to those of the leaderboards' plant (design C.1), and what is scaled to them.

Stretched (q2 = 0) and without its motors' rotors, the pendulum is one rigid body. Its inertia about the shoulder is
J = M11, and the torque of gravity on it when level is Γ:

    J = I1 + I2 + m2 l1² + 2 m2 l1 r2,    Γ = (m1 r1 + m2 l1 + m2 r2) g,    T = √(J / Γ)

The body's small swings have the angular frequency 1/T, and its fall from upright grows e-fold in T. T is the unit
of time of tasks, boards and baselines (:func:`scales_of`). Policies count time in √(l1 / g) (:func:`arm_scales`):
every pendulum then has C.1's l1 and g, and its inertial base parameters alone tell it apart. The motor's torque
limit is the unit of torque, the upper link that of length. Ratios remain: two pendulums move alike only if their
other parameters are equal in these units, and then both units of time give the same.

Numbers are written down for C.1, with their units in their fields' annotations. :func:`scaled`,
:func:`similar_plant` and :class:`Scales` alone know how a unit scales. The loop's real period stays everywhere.
"""

import dataclasses
import math
from typing import Any, NamedTuple, TypeVar

from ..common.errors import SwingupError
from ..common.settings import notes
from .plant import TORQUE_LIMIT, ZEROS, Plant, time_and_gravity

RecordT = TypeVar("RecordT")

REFERENCE = (0.2119482605847436, TORQUE_LIMIT, 0.2)
"""T (s), torque limit (N m) and length l1 (m) of the leaderboards' plant, to the last digit."""
REFERENCE_GRAVITY = 9.81  # Gravity of design C.1 (m/s²)


# No tuple, for the reason of ``Range``.
@dataclasses.dataclass(frozen=True)
class Unit:
    """A unit by its powers of a pendulum's units of torque, time and length."""

    torque: int = 0
    time: int = 0
    length: int = 0


NUMBER = Unit()  # Angles and shares: the same number for every pendulum
TIME, VELOCITY, ACCELERATION = Unit(time=1), Unit(time=-1), Unit(time=-2)
TORQUE, TORQUE_RATE, DAMPING, INERTIA, COMPLIANCE = Unit(1), Unit(1, -1), Unit(1, 1), Unit(1, 2), Unit(-1)
LENGTH, MASS, MOMENT, GRAVITY = Unit(length=1), Unit(1, 2, -2), Unit(1, 2, -1), Unit(0, -2, 1)
"""MOMENT is the unit of a mass times a length."""
STATE = (NUMBER, NUMBER, VELOCITY, VELOCITY)  # [q1, q2, dq1, dq2]
BASE_UNITS = (INERTIA, INERTIA, MOMENT, MOMENT, DAMPING, DAMPING, TORQUE, TORQUE, INERTIA)
"""Units of the base parameters."""

PLANT_UNITS = {
    **dict.fromkeys(("m1", "m2"), MASS), **dict.fromkeys(("l1", "l2", "r1", "r2"), LENGTH),
    **dict.fromkeys(("I1", "I2", "Ir"), INERTIA), "b1": DAMPING, "b2": DAMPING, "g": GRAVITY,
    **dict.fromkeys(("cf1", "cf2", "tl1", "tl2"), TORQUE),
}  # fmt: skip
"""Units of a plant's numbers by name; the gear ratio has none."""


class Scales(NamedTuple):
    """A pendulum's units as multiples of C.1's; a compiled program may take them as its arguments."""

    time: float  # Unit of time: T, or √(l1 / g)
    torque: float  # Unit of torque: the larger of the two torque limits, relative to 6 N m
    length: float  # Unit of length: the upper link's, relative to 0.2 m

    def of(self, unit: Unit) -> float:
        """A unit as a multiple of C.1's.

        Raises:
            SwingupError: a plant without motors has no such unit, or an extreme one has none within floating point.
        """
        try:
            return self.torque**unit.torque * self.time**unit.time * self.length**unit.length
        except ArithmeticError:
            sizes = f"{self.torque:g}, {self.time:g} and {self.length:g} times C.1's"
            raise SwingupError(
                f"the pendulum's torque limit, time and upper link are {sizes}, and nothing can be scaled to them: "
                "give it a motor, and SI units"
            ) from None

    def scaled(self, value: Any, *units: Unit) -> Any:
        """What suits C.1, for the pendulum: a number, or those of a tuple or of an array's last axis.

        There is one unit for all numbers, or one for each. Arrays keep their precision.
        """
        factors = tuple(map(self.of, units))
        if isinstance(value, tuple):
            each = factors * len(value) if len(factors) == 1 else factors
            return tuple(number * factor for number, factor in zip(value, each, strict=True))
        return value * _like(value, factors)

    def similar(self, value: Any, *units: Unit) -> Any:
        """A number or an array of the pendulum, for the similar one in C.1's units; units as in :meth:`scaled`."""
        return value / _like(value, tuple(map(self.of, units)))

    @property
    def base(self) -> tuple[float, ...]:
        """Units of the base parameters (``base_parameters.py``), in their order."""
        return tuple(map(self.of, BASE_UNITS))

    def over(self, other: "Scales") -> "Scales":
        """These units as multiples of another pendulum's."""
        return Scales(self.time / other.time, self.torque / other.torque, self.length / other.length)

    @property
    def state(self) -> tuple[float, ...]:
        """Units of [q1, q2, dq1, dq2]."""
        return tuple(map(self.of, STATE))


C1 = Scales(1.0, 1.0, 1.0)  # The units of the leaderboards' plant


def scales_of(parameters: Plant) -> Scales:
    """The units of a pendulum, relative to C.1's: exactly 1 for C.1, with or without its frictions and rotors.

    A pendulum without a positive inertia, or whose stretched arm gravity does not pull down, is refused.
    """
    time, _ = time_and_gravity(parameters)
    absolute = time, float(max(parameters.tl1, parameters.tl2)), float(parameters.l1)
    return Scales(*(value / unit for value, unit in zip(absolute, REFERENCE, strict=True)))


def arm_scales(parameters: Plant) -> Scales:
    """The units of a pendulum's policies, relative to C.1's: as :func:`scales_of`, but for the time, √(l1 / g)."""
    torque, length = float(max(parameters.tl1, parameters.tl2)) / REFERENCE[1], float(parameters.l1) / REFERENCE[2]
    return Scales(math.sqrt(length * REFERENCE_GRAVITY / float(parameters.g)), torque, length)


def similar_plant(plant: Plant, scales: Scales) -> Plant:
    """The pendulum that moves as a plant does in C.1's units; its encoders show 0 where it hangs."""
    scales.of(COMPLIANCE)  # Refuses a plant without a motor, by which the rest divides
    numbers = {name: scales.similar(getattr(plant, name), unit) for name, unit in PLANT_UNITS.items()}
    zeros = {name: 0.0 * abs(getattr(plant, name)) for name in ZEROS}  # One for each plant of a batch
    return plant.changed(**zeros, **numbers)


def scaled(record: RecordT, scales: Scales) -> RecordT:
    """A dataclass of numbers that suit C.1, for a pendulum of other units.

    Fields whose annotations have a :class:`Unit` are multiplied by it, or the numbers of a tuple or of an array's
    last axis by one each; None stays. Dataclasses in other fields are scaled as well.
    """
    changes: dict[str, Any] = {}
    for field in dataclasses.fields(record):  # type: ignore[arg-type]  # a dataclass
        value, units = getattr(record, field.name), notes(field, Unit)
        if units and value is not None:
            changes[field.name] = scales.scaled(value, *units)
        elif dataclasses.is_dataclass(value):
            changes[field.name] = scaled(value, scales)
    return dataclasses.replace(record, **changes)  # type: ignore[type-var]


def _like(value: Any, factors: tuple[float, ...]) -> Any:
    """A factor, or an array of factors that leaves an array of single precision as it is."""
    return factors[0] if len(factors) == 1 else value.__array_namespace__().array(factors, value.dtype)
