"""Domains: a plant whose values may be ranges, and the loop around it; each episode draws its own values.

A range of one value is a known fact; wider ranges are domain randomisation. A plant's file is a domain as it is.
"""

import dataclasses
import functools
import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax

from ..common.errors import SwingupError
from ..dynamics.integrate import stable_substeps
from ..plant.plant import FRICTIONLESS_SUFFIX, NAMES, RANGE_REFUSED, Plant, Robot, validated
from .disturbance import Effects
from .loop import LONGEST_PERIOD, LOOP_DT, PERFECT_LOOP, VALUES, Loop

MOTORS = ("tl1", "tl2")  # Torque limits of the plant's motors

TORQUE_LIMIT = "torque_limit"
"""A domain may give one limit for both motors; the loop's ``passive_limit`` lowers it on the passive joint."""

MASSES = ("m2", "l1", "r2", "I1", "I2", "Ir", "gr")
"""Parameters in the mass matrix, which must be positive definite for all their combinations."""


class PlantInLoop(NamedTuple):
    """A plant and the loop around it: one end of a domain."""

    plant: Plant
    loop: Loop

    def passive_limit(self, robot: Robot) -> float:
        """Torque limit of the passive joint (N m): the loop's, and no more than its motor has in the plant."""
        return float(min(self.loop.passive_limit, self.plant.limit(1 - robot.joint)))

    def value(self, name: str) -> float:
        """A number by the name that a domain's file has for it."""
        name = MOTORS[0] if name == TORQUE_LIMIT else name
        return float(getattr(self.loop if name in VALUES else self.plant, name))


@dataclass(frozen=True)
class Domain:
    """Plants in their loops, from the lowest values to the highest; hashable."""

    low: PlantInLoop
    high: PlantInLoop
    names: tuple[str, ...]
    """What the source gives; the rest is the plant's or a perfect loop's."""
    plant: Plant
    """The plant that the source names, or the middle of the ranges where it gives all values."""
    design: Plant
    """The plant that controllers are designed for: the middle of the ranges, unless the source names another."""
    name: str = field(default="DOMAIN.yml", compare=False)
    """The name or the file that was read. Not compared, so that equal ranges compile once."""

    def __post_init__(self) -> None:
        for corner in self.corners():
            validated(corner)

    @property
    def ranges(self) -> tuple[tuple[str, float, float], ...]:
        """What the source gives: names with their lowest and highest values."""
        return tuple((name, self.low.value(name), self.high.value(name)) for name in self.names)

    def corners(self) -> Iterator[Plant]:
        """Plants at the ends of the ranges: all combinations of the masses', and both ends of the others.

        Draws may pair any ends of the masses' ranges, and some pairs make no pendulum though both ends alone do.
        """
        # dict.fromkeys: a range of one value has one end.
        pairs = [dict.fromkeys(getattr(end.plant, name) for end in (self.low, self.high)) for name in MASSES]
        for end, masses in itertools.product((self.low, self.high), itertools.product(*pairs)):
            yield end.plant.changed(**dict(zip(MASSES, masses, strict=True)))

    @functools.cached_property
    def effects(self) -> Effects:
        """The effects that a drawn loop may have: those in which one of the ends differs from a perfect loop."""

        def may_have(*names: str) -> bool:
            ends = self.low.loop, self.high.loop
            return any(getattr(loop, name) != getattr(PERFECT_LOOP, name) for loop in ends for name in names)

        # A driver's velocity has no steps: where a file says nothing else, an encoder's steps speak for
        # differences.
        chosen, quantised = self.low.loop.velocities, may_have("quantum1", "quantum2")
        differences = quantised if chosen is None else chosen == "differences"
        return Effects(
            # Always, since noise and limits of the two motors are the robot's, whatever their rate and ripple.
            motors=True,
            drive=may_have("lag", "gain1", "gain2", "passive_push"),
            sensors=differences or quantised or may_have("offset1", "offset2"),
            differences=differences,
            late=may_have("late", "period"),
            loads=may_have(*(f"{name}{joint}" for name in ("spring", "load", "stiction") for joint in (1, 2))),
            windup=may_have("compliance2", "backlash2"),
            sag=may_have("sag"),
            gaps=may_have("dropouts", "spoilt"),
        )

    @property
    def depth(self) -> int:
        """Number of states that the loop remembers: the longest delay and gap, and a difference before."""
        # The shortest period has the most steps in a delay.
        shortest, high = self.low.value("period"), self.high
        gap = whole_steps(high.value("dropout"), shortest) if high.value("dropouts") else 0
        return whole_steps(high.value("delay"), shortest) + gap + 1 + self.effects.differences

    @functools.cached_property
    def substeps(self) -> int:
        """Steps of RK4 in a step of the loop, so that friction stays stable on all of its plants."""
        longest = self.high.value("period") * (LONGEST_PERIOD if self.effects.late else 1.0)
        return max(stable_substeps(corner, longest) for corner in self.corners())

    @property
    def nominal(self) -> PlantInLoop:
        """The middle of all ranges."""
        middle: PlantInLoop = jax.tree.map(lambda low, high: 0.5 * (low + high), self.low, self.high)
        return middle

    @property
    def nominal_plant(self) -> Plant:
        """The plant in the middle of the ranges, with the name of the domain's plant."""
        return dataclasses.replace(self.nominal.plant, name=self.plant.name)

    @property
    def knows_plant(self) -> bool:
        """Whether no number of the plant has a range."""
        return self.low.plant == self.high.plant

    @property
    def facts(self) -> Plant:
        """The plant of a domain, under the domain's name; a plant with a range is refused."""
        for name in NAMES:
            low, high = self.low.value(name), self.high.value(name)
            if low != high:
                raise SwingupError(f"{name} = [{low:g}, {high:g}] {RANGE_REFUSED}")
        return dataclasses.replace(self.low.plant, name=self.name)

    def frictionless(self) -> "Domain":
        """The domain without the plants' friction and rotors, see :meth:`Plant.frictionless`; loops stay."""
        low, high = (end._replace(plant=end.plant.frictionless()) for end in (self.low, self.high))
        name = self.name if (low, high) == (self.low, self.high) else f"{self.name}{FRICTIONLESS_SUFFIX}"
        plant, design = self.plant.frictionless(), self.design.frictionless()
        return dataclasses.replace(self, low=low, high=high, plant=plant, design=design, name=name)

    @property
    def content(self) -> dict[str, Any]:
        """The content of a file that makes the same ranges of plants and loops."""
        names = [*NAMES, *(name for name in self.names if name in VALUES)]
        ends = {name: (self.low.value(name), self.high.value(name)) for name in names}
        option = {} if self.low.loop.velocities is None else {"velocities": self.low.loop.velocities}
        return {name: low if low == high else [low, high] for name, (low, high) in ends.items()} | option

    def __str__(self) -> str:
        return f"{self.name} {self.as_dict()}"

    def as_dict(self) -> dict[str, Any]:
        """The ranges and the names of plants, as JSON values."""
        named = {"plant": self.plant.name}
        if self.design != self.nominal_plant:
            named["design"] = self.design.name
        option = {} if self.low.loop.velocities is None else {"velocities": self.low.loop.velocities}
        return {**named, **option, **{name: [low, high] for name, low, high in self.ranges}}


def whole_steps(time: float, period: float = LOOP_DT) -> int:
    """Whole steps of a loop in a time (s); 1e-4 of a step is added, since rounding may lose a whole one."""
    return int(time / period + 1e-4)
