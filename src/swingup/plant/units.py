"""A pendulum's own units, relative to those of the leaderboards' plant (design C.1).

Stretched (q2 = 0) and without its motors' rotors, the pendulum is one rigid body. Its inertia about the shoulder is
J = M11, and the torque of gravity on it when level is Γ:

    J = I1 + I2 + m2 l1² + 2 m2 l1 r2,    Γ = (m1 r1 + m2 l1 + m2 r2) g,    T = √(J / Γ)

The body's small swings have the angular frequency 1/T, and its fall from upright grows e-fold in T. In units of
time T and torque Γ every pendulum has J = Γ = 1. Ratios remain: two pendulums move alike only if their other
parameters are equal in these units.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..common.errors import SwingupError
from .equations import lump
from .robots import TORQUE_LIMIT

if TYPE_CHECKING:
    from .plant import Plant

REFERENCE = (0.2119482605847436, 3.8235349329950976, TORQUE_LIMIT, 0.5)
"""T (s), Γ (N m), torque limit (N m) and length (m) of the leaderboards' plant, to the last digit."""


@dataclass(frozen=True)
class Scales:
    """A pendulum's units as multiples of C.1's; a number of C.1's tasks times its scale suits the pendulum."""

    time: float
    """Unit of time, T."""
    torque: float
    """Unit of torque and of energy, Γ."""
    torque_limit: float
    """Larger of the two torque limits, relative to 6 N m."""
    length: float
    """Length l1 + l2."""

    @property
    def velocity(self) -> float:
        """Unit of angular velocity, 1/T."""
        return 1 / self.time

    @property
    def acceleration(self) -> float:
        """Unit of angular acceleration, 1/T²."""
        return 1 / self.time**2

    @property
    def inertia(self) -> float:
        """Unit of inertia, J = Γ T²."""
        return self.torque * self.time**2

    def plant_units(self) -> dict[str, float]:
        """Units of a plant's numbers by name, with the torque limit as the unit of torque; lengths keep theirs."""
        time, torque = self.time, self.torque_limit
        units = dict.fromkeys(("m1", "m2", "I1", "I2", "Ir"), torque * time**2)
        units |= {"b1": torque * time, "b2": torque * time, "g": 1 / time**2}
        return units | dict.fromkeys(("cf1", "cf2", "tl1", "tl2"), torque)


def scales_of(parameters: "Plant") -> Scales:
    """The units of a pendulum, relative to C.1's: exactly 1 for C.1, with or without its frictions and rotors.

    Args:
        parameters: a plant: a robot's, with a torque
            limit of 0 on the passive joint, or a pendulum's with two motors.

    Raises:
        SwingupError: gravity does not pull its stretched arm down, or its inertia is not positive.
    """
    return Scales(*(value / unit for value, unit in zip(_absolute(parameters), REFERENCE, strict=True)))


def torque_over_gravity(parameters: "Plant") -> float:
    """Larger torque limit over Γ: above 1 a motor at the shoulder can hold the stretched arm level.

    Raises:
        SwingupError: as :func:`scales_of`.
    """
    _, gravity, limit, _ = _absolute(parameters)
    return limit / gravity


def _absolute(p: "Plant") -> tuple[float, float, float, float]:
    """T (s), Γ (N m), the torque limit (N m) and the length (m)."""
    plant = lump(p)
    inertia, gravity = float(plant.shoulder + 2 * plant.coupling), float(plant.gravity1 + plant.gravity2)
    # Negated, so that NaN is refused as well.
    if not gravity > 0:
        raise SwingupError(
            f"gravity's torque on the level arm is {gravity:g} N m: m1 r1 + m2 (l1 + r2) must be positive"
        )
    if not inertia > 0:
        raise SwingupError(f"the stretched arm's inertia is {inertia:g} kg m² without rotors: raise I1 or I2")
    return math.sqrt(inertia / gravity), gravity, float(max(p.tl1, p.tl2)), float(p.l1 + p.l2)
