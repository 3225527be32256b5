"""The parts of the boards' rules, as data: normalisers, sweeps of one quantity, and pushes."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from ..loop.draw import vary
from ..plant.plant import Plant
from ..plant.units import NUMBER, PLANT_UNITS, TIME, TORQUE, Scales


@dataclass(frozen=True)
class Normalisers:
    """The divisor of each criterion in the RealAI score, in the units of :class:`~.criteria.Criteria`."""

    swingup_time: float
    energy: float
    torque_cost: float
    torque_smoothness: float
    velocity_cost: float


@dataclass(frozen=True)
class Sweep:
    """Evenly spaced values of one quantity, both ends included, each simulated ``repetitions`` times."""

    low: float
    high: float
    count: int = 21
    repetitions: int = 1

    def values(self) -> list[float]:
        """The values."""
        return np.linspace(self.low, self.high, self.count).tolist()

    def __mul__(self, factor: float) -> "Sweep":
        """The sweep of values that are so many times as large."""
        return replace(self, low=self.low * factor, high=self.high * factor)


@dataclass(frozen=True)
class ModelSweep:
    """Values of one parameter of the plant; the controller keeps the nominal model."""

    parameter: str
    """Field of :class:`~swingup.plant.plant.Plant` that changes."""
    sweep: Sweep
    relative: bool = False
    """The values are factors on the nominal one; otherwise they are added to it."""
    mass: str | None = None
    """If given, the sweep is of the product of this mass and the parameter: m1 r1 or m2 r2."""

    def varied(self, plant: Plant, value: float) -> Plant:
        """The plant with one value of the sweep: with a product m r it is r that changes."""
        return vary(plant, self.parameter, value, self.relative, self.mass)

    def in_units(self, scales: Scales) -> "ModelSweep":
        """The sweep for another pendulum: factors stay."""
        unit = NUMBER if self.relative else PLANT_UNITS[self.parameter]
        return replace(self, sweep=scales.scaled(self.sweep, unit))


@dataclass(frozen=True)
class PushRules:
    """Random profiles of Gaussian pushes, as many on each joint.

    The time between them is real for every pendulum, as the length of a run is.
    """

    profiles: int = 50
    pushes: int = 3
    """Pushes on each joint."""
    apart: float = 1.0
    """Least time between the centres of any two (s)."""
    width: Annotated[tuple[float, float], TIME] = (0.05, 0.1)
    """Range of the standard deviations (s)."""
    amplitude: Annotated[tuple[float, float], TORQUE] = (0.5, 5.0)
    """Range of the absolute amplitudes (N m)."""


_QUARTER = Sweep(0.75, 1.25)
# Absolute values, because the nominal friction is 0. The negative ones drive the joint; the benchmark has them.
_DAMPING, _COULOMB = Sweep(-0.1, 0.1), Sweep(-0.2, 0.2)

MODEL_SWEEPS = {
    # Absolute for the same reason: the leaderboards' plant has no motor inertia.
    "Ir": ModelSweep("Ir", Sweep(0.0, 1e-4)),
    "m1r1": ModelSweep("r1", _QUARTER, relative=True, mass="m1"),
    "I1": ModelSweep("I1", _QUARTER, relative=True),
    "b1": ModelSweep("b1", _DAMPING),
    "cf1": ModelSweep("cf1", _COULOMB),
    "m2r2": ModelSweep("r2", _QUARTER, relative=True, mass="m2"),
    # r2 stays, so that the product m2 r2 varies with m2.
    "m2": ModelSweep("m2", _QUARTER, relative=True),
    "I2": ModelSweep("I2", _QUARTER, relative=True),
    "b2": ModelSweep("b2", _DAMPING),
    "cf2": ModelSweep("cf2", _COULOMB),
}
"""The criterion "model": errors of one parameter at a time (kg m², kg m, kg, N m s/rad, N m, or a factor)."""

SWEPT = ("velocity_noise", "torque_noise", "torque_response", "delay")
"""Criteria that sweep one number of the disturbance (rad/s, N m, -, s)."""

CRITERIA = ("model", *SWEPT, "perturbations")
"""The six criteria of the robustness score."""

RANDOM = ("velocity_noise", "torque_noise", "perturbations")
"""Criteria that depend on the seed."""
