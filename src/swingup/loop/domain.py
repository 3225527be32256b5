"""Domains: a plant whose values may be ranges, and the loop around it; each episode draws its own values.

A range of one value is a known fact; wider ranges are domain randomisation. A plant's file is a domain as it is.
The package's domains are files in ``loop/domains``, with the source of every number.
"""

import dataclasses
import functools
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import jax

from ..common.checks import one_of
from ..common.errors import SwingupError, naming, one_line, quoted
from ..common.files import has_suffix
from ..common.yaml_map import read_map
from ..dynamics.integrate import stable_substeps
from ..plant.files import PARAMETER_FILES, PLANT_FILES, SHIPPED_PLANTS, base_plant, is_model_file, load_plant
from ..plant.plant import NAMES, Plant, make_plant, validated
from .disturbance import Effects
from .loop import LONGEST_PERIOD, LOOP_DT, PERFECT_LOOP, VALUES, Loop

MOTORS = ("tl1", "tl2")
"""Torque limits of the plant's motors."""

TORQUE_LIMIT = "torque_limit"
"""A domain may give one limit for both motors; the loop's ``passive_limit`` replaces it on the passive joint."""

PLANT = tuple(name for name in NAMES if name not in MOTORS)
"""The other parameters of the plant."""

MASSES = ("m2", "l1", "r2", "I1", "I2", "Ir", "gr")
"""Parameters in the mass matrix, which must be positive definite for all their combinations."""

SESSIONS = ("excitation", "acrobot", "pendubot", "acrobot-pushed", "acrobot-iros", "pendubot-iros")
"""Sessions of the robot of design C.1, each with its fitted plant and loop: the domains ``session-...``."""

SHIPPED_DOMAINS = (
    "identified",
    "randomised",
    "recorded",
    "imperfect",
    "cells",
    *(f"session-{name}" for name in SESSIONS),
)
"""Domains that the package ships."""


class PlantInLoop(NamedTuple):
    """A plant and the loop around it: one end of a domain."""

    plant: Plant
    loop: Loop

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
    """The name or the file that ``load_domain`` read. Not compared, so that equal ranges compile once."""

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

    def __str__(self) -> str:
        return f"{self.name} {self.as_dict()}"

    def as_dict(self) -> dict[str, Any]:
        """As JSON values."""
        named = {"plant": self.plant.name}
        if self.design != self.nominal_plant:
            named["design"] = self.design.name
        option = {} if self.low.loop.velocities is None else {"velocities": self.low.loop.velocities}
        return {**named, **option, **{name: [low, high] for name, low, high in self.ranges}}


def whole_steps(time: float, period: float = LOOP_DT) -> int:
    """Whole steps of a loop in a time (s); 1e-4 of a step is added, since rounding may lose a whole one."""
    return int(time / period + 1e-4)


def make_domain(content: Mapping[str, Any], name: str = "DOMAIN.yml", folder: str | Path = ".") -> Domain:
    """A domain from values by name: a number, or a range of two.

    The content may have ``plant``, a plant or the name or file (in the folder) of one; without it all values of a
    plant are needed. It may have ``design``, another plant for which controllers are designed, and ``velocities``.
    """
    values = dict(content)
    velocities = values.pop("velocities", None)
    named, design = (
        given if given is None or isinstance(given, Plant) else base_plant(given, folder)
        for given in (values.pop("plant", None), values.pop("design", None))
    )
    ranges = {each: _range(each, value) for each, value in values.items()}
    given = ranges | (dict.fromkeys(MOTORS, ranges[TORQUE_LIMIT]) if TORQUE_LIMIT in ranges else {})
    if named is None and not given.keys() >= set(PLANT):
        raise SwingupError(
            f"domain {one_line(name)} lacks its plant: add 'plant', one of {', '.join(SHIPPED_PLANTS)}, "
            f"{PLANT_FILES}, or all values of one"
        )
    # A plant without ranges is the middle of ranges of one value.
    middles = {each: 0.5 * (low + high) for each, (low, high) in given.items()}
    plant = make_plant(middles, f"domain {name}", name) if named is None else named
    low, high = (
        PlantInLoop(
            plant.changed(**{each: given[each][end] for each in given if each in NAMES}),
            Loop(**{each: given[each][end] for each in given if each in VALUES}, velocities=velocities),
        )
        for end in (0, 1)
    )
    # The middle is known once both ends are.
    made = Domain(low, high, tuple(ranges), plant, plant, name)
    return dataclasses.replace(made, design=design or made.nominal_plant)


def load_domain(source: str | Path) -> Domain:
    """A domain by its name or a shipped plant's, or from a YAML file of ``name: value`` and ``name: [low, high]``.

    Raises:
        SwingupError: there is no such domain, the file cannot be read, or its content makes none.
    """
    source = str(source)
    if source in SHIPPED_DOMAINS:
        with resources.as_file(resources.files(__package__) / "domains" / f"{source}.yml") as path:
            return make_domain(read_map(path, "domain"), source)
    if source in SHIPPED_PLANTS or is_model_file(source):
        return make_domain({"plant": load_plant(source)}, source)
    if not has_suffix(source, *PARAMETER_FILES):
        one_of("domain", source, (*SHIPPED_DOMAINS, *SHIPPED_PLANTS), " or a YAML file (.yml)")
    with naming(f"domain {one_line(source)}"):
        return make_domain(read_map(source, "domain"), source, Path(source).parent)


def _range(name: str, value: Any) -> tuple[float, float]:
    one_of("name", name, (*NAMES, TORQUE_LIMIT, *VALUES))
    ends = value if isinstance(value, list | tuple) else [value, value]
    numbers = [number for number in map(_number, ends) if number is not None]
    if len(ends) != 2 or len(numbers) != 2:
        raise SwingupError(f"{name} = {quoted(value)} must be a number, or a range [low, high]")
    low, high = numbers
    # Negated, so that NaN is refused as well.
    if not low <= high:
        raise SwingupError(f"{name} = [{low:g}, {high:g}] must be a range from low to high")
    allowed = VALUES.get(name)
    if allowed is not None and not allowed.minimum <= low <= high <= allowed.maximum:
        raise SwingupError(
            f"{name} = [{low:g}, {high:g}] must lie between {allowed.minimum:g} and {allowed.maximum:g}"
        )
    return low, high


def _number(value: Any) -> float | None:
    """A number, or a text that is one: YAML's 4e-5 has no point."""
    try:
        return None if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        return None
