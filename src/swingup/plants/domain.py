"""Domains: a plant whose values may be ranges, and the loop around it; each episode draws its own values.

A range of one value is a known fact; wider ranges are domain randomisation. A plant's file is a domain as it is.
The package's domains are files in ``plants/domains``, with the source of every number.
"""

import functools
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from ..checks import suggestion
from ..errors import SwingupError
from ..physics.integrate import stable_substeps
from ..physics.plant import NAMES, SHIPPED_PLANTS, Plant, base_plant, load_plant, make_plant, validated
from ..text import one_line, quoted
from ..yaml_map import read_map
from .loop import BOUNDS, CLOCK, EVERY_LOOP, LONGEST, LOOP_DT, check_velocities

MOTORS = ("tl1", "tl2")
"""Torque limits of the plant's motors; a domain may have one for the driven motor, ``torque_limit``, instead."""

PLANT = tuple(name for name in NAMES if name not in MOTORS)
"""The other parameters of the plant."""

MASSES = ("m2", "l1", "r2", "I1", "I2", "Ir", "gr")
"""Numbers in the mass matrix, which must be positive definite for all their combinations."""

IDENTIFIED = "C.1"
"""The plant of a domain that names none: what it leaves out is as identified there."""

SESSIONS = ("excitation", "acrobot", "pendubot", "acrobot-pushed", "acrobot-iros", "pendubot-iros")
"""Sessions of the robot of design C.1, each with its fitted plant and loop: the domains ``session-...``."""

SHIPPED = ("identified", "randomised", "recorded", "cells", *(f"session-{name}" for name in SESSIONS))
"""Domains that the package ships."""


@dataclass(frozen=True)
class Domain:
    """A range of values, low to high, for everything about plant and loop; hashable."""

    ranges: tuple[tuple[str, float, float], ...]
    name: str = field(default="DOMAIN.yml", compare=False)
    """The name or the file that ``load_domain`` read. Not compared, so that equal ranges compile once."""
    plant: Plant | None = None
    """Has the values that the ranges leave out; None for C.1 as identified."""
    velocities: str | None = None
    """Where measured velocities come from: ``differences`` of positions, or the motors' ``driver``."""

    def __post_init__(self) -> None:
        """Refuse what cannot work.

        Raises:
            SwingupError: a name is unknown, a range ends below its start, or a value makes no pendulum or loop.
        """
        known = (*NAMES, *EVERY_LOOP)
        check_velocities(self.velocities)
        for name, low, high in self.ranges:
            if name not in known:
                raise SwingupError(
                    f"unknown name {quoted(name)}: use some of {', '.join(known)}{suggestion(name, known)}"
                )
            if not low <= high:
                raise SwingupError(f"{name} = [{low:g}, {high:g}] must be a range from low to high")
            least, most = BOUNDS.get(name, (low, high))
            if not least <= low <= high <= most:
                raise SwingupError(f"{name} = [{low:g}, {high:g}] must lie between {least:g} and {most:g}")
        for corner in self.corners():
            validated(corner)

    @functools.cached_property
    def base(self) -> Plant:
        """The plant where no range changes it."""
        return load_plant(IDENTIFIED) if self.plant is None else self.plant

    def corners(self) -> Iterator[Plant]:
        """Plants at the ends of the ranges: all combinations of the masses', and both ends of the others.

        Draws may pair any ends of the masses' ranges, and some pairs make no pendulum though both ends alone do.
        """
        plant = {name: (low, high) for name, low, high in self.ranges if name in NAMES}
        apart = [name for name in MASSES if name in plant]
        # dict.fromkeys: a range of one value has one end.
        combined = itertools.product(*(dict.fromkeys(plant[name]) for name in apart))
        for end, corner in itertools.product((0, 1), combined):
            values = {name: pair[end] for name, pair in plant.items()} | dict(zip(apart, corner, strict=True))
            yield self.base.changed(**values)

    @property
    def defaults(self) -> dict[str, float]:
        """What the ranges may leave out: the plant's values, and those of a perfect loop."""
        return self.base.values() | EVERY_LOOP

    @property
    def names(self) -> frozenset[str]:
        """Names that the domain gives a value or a range."""
        return frozenset(name for name, _, _ in self.ranges)

    @property
    def differences(self) -> bool:
        """Whether measured velocities are differences of positions: by choice, or where angles have a quantum."""
        return self.velocities == "differences" or (
            self.velocities is None and not self.names.isdisjoint(("quantum1", "quantum2"))
        )

    @property
    def depth(self) -> int:
        """Number of states that the loop remembers, enough for the longest delay and a difference before it."""
        longest = whole_delay_steps({name: high for name, _, high in self.ranges}.get("delay", 0.0))
        return longest + 1 + self.differences

    @functools.cached_property
    def substeps(self) -> int:
        """Steps of RK4 in a step of the loop, so that friction stays stable on all of its plants.

        Loops around C.1 as identified that are always on time keep one, as the boards do.
        """
        is_late = not self.names.isdisjoint(CLOCK)
        if self.plant is None and not self.names.issuperset(PLANT) and not is_late:
            return 1
        return max(stable_substeps(corner, LOOP_DT * (LONGEST if is_late else 1)) for corner in self.corners())

    def middle(self, name: str) -> float:
        """Middle of a range, or the default if the domain leaves the name out."""
        low, high = {each: (low, high) for each, low, high in self.ranges}.get(name, (self.defaults[name],) * 2)
        return 0.5 * (low + high)

    @property
    def middle_plant(self) -> Plant:
        """The plant in the middle of the ranges; both motors have the ``torque_limit``, if there is one."""
        values = {name: self.middle(name) for name in NAMES}
        if "torque_limit" in self.names:
            values |= dict.fromkeys(MOTORS, self.middle("torque_limit"))
        return self.base.changed(**values)

    def __str__(self) -> str:
        """Its name and its ranges."""
        return f"{self.name} {self.as_dict()}"

    def as_dict(self) -> dict[str, Any]:
        """As JSON values."""
        named = {} if self.plant is None else {"plant": self.plant.name}
        option = {} if self.velocities is None else {"velocities": self.velocities}
        return {**named, **option, **{name: [low, high] for name, low, high in self.ranges}}


def whole_delay_steps(delay: float) -> int:
    """Whole loop steps in a delay (s); 1e-4 of a step is added, since rounding may lose a whole one."""
    return int(delay / LOOP_DT + 1e-4)


def make_domain(content: Mapping[str, Any], name: str = "DOMAIN.yml", folder: str | Path = ".") -> Domain:
    """A domain from values by name: a number, or a range of two.

    Args:
        content: the values; also ``plant``, a plant's name or file, and ``velocities``.
        name: of the domain.
        folder: where a plant's file is looked for.

    Raises:
        SwingupError: a name is unknown, a value is none, or there is no such plant.
    """
    values = dict(content)
    named, velocities = values.pop("plant", None), values.pop("velocities", None)
    plant = None if named is None else base_plant(named, folder)
    ranges = tuple((each, *_range(each, value)) for each, value in values.items())
    if named is None and values.keys() >= set(PLANT):
        # A domain with all of a plant's values is around a plant of its own.
        middles = {each: 0.5 * (low + high) for each, low, high in ranges}
        limits = dict.fromkeys(MOTORS, middles["torque_limit"]) if "torque_limit" in middles else {}
        plant = make_plant(limits | middles, f"domain {name}", name)
    return Domain(ranges, name, plant, velocities)


def load_domain(source: str | Path) -> Domain:
    """A domain by its name, or from a YAML file of ``name: value`` and ``name: [low, high]``.

    Args:
        source: a domain that the package ships, a file of ranges or of a plant's facts, or a shipped plant's name.

    Raises:
        SwingupError: there is no such domain, the file cannot be read, or its content makes none.
    """
    source = str(source)
    if source in SHIPPED:
        with resources.as_file(resources.files(__package__) / "domains" / f"{source}.yml") as path:
            return make_domain(read_map(path, "domain"), source)
    if source in SHIPPED_PLANTS:
        return Domain((), source, load_plant(source))
    if not source.endswith((".yml", ".yaml")):
        near = suggestion(source, (*SHIPPED, *SHIPPED_PLANTS))
        raise SwingupError(
            f"unknown domain {quoted(source)}: use {', '.join(SHIPPED)}, a plant's name or a YAML file (.yml){near}"
        )
    try:
        return make_domain(read_map(source, "domain"), source, Path(source).parent)
    except SwingupError as error:
        raise SwingupError(f"domain {one_line(source)}: {error}") from error


def _range(name: str, value: Any) -> tuple[float, float]:
    ends = value if isinstance(value, list | tuple) else [value, value]
    numbers = [number for number in map(_number, ends) if number is not None]
    if len(ends) != 2 or len(numbers) != 2:
        raise SwingupError(f"{name} = {quoted(value)} must be a number, or a range [low, high]")
    return numbers[0], numbers[1]


def _number(value: Any) -> float | None:
    """A number, or a text that is one: YAML's 4e-5 has no point."""
    try:
        return None if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        return None
