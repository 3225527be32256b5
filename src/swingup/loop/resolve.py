"""The resolver: a name, a file, its content, a plant or a domain becomes a :class:`Domain`, plants in loops.

Commands and public functions call :func:`resolve` once, where their user names something; all that they call takes
a domain or a plant. The package's domains are files in ``loop/domains``, with the source of every number.
"""

import dataclasses
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from ..common.checks import one_of
from ..common.errors import SwingupError, naming, one_line, quoted
from ..common.files import has_suffix
from ..common.yaml_map import read_map
from ..plant.files import (
    PARAMETER_FILES,
    PLANT_FILES,
    SHIPPED_PLANTS,
    base_plant,
    is_model_file,
    load_plant,
    with_both_limits,
)
from ..plant.plant import NAMES, ZEROS, Plant, PlantLike, make_plant
from ..plant.units import scaled, scales_of
from .domain import MOTORS, TORQUE_LIMIT, Domain, PlantInLoop
from .loop import VALUES, Loop

NO_LOOP = "none"  # The name of a perfect loop among the names of domains
PLANT_ALONE = "C.1"
"""The plant where neither a plant nor a domain is given: design C.1 as identified, in a perfect loop."""

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

PLANT = tuple(
    name for name in NAMES if name not in (*MOTORS, *ZEROS)
)  # Parameters that a domain without "plant" has


def resolve(
    plant: PlantLike | Domain | None = None,
    domain: Domain | Mapping[str, Any] | str | Path | None = None,
    share: float | None = None,
) -> Domain:
    """The plants in loops that a user names.

    The first of these that gives a number has the last word:

    1. the plant's file: values and ranges of the plant, its motors' limits, and what the file says of its loop;
    2. the domain's loop, in that pendulum's own units: torques, their rates and velocities are relative to the
       plant that the domain is made for; delays, periods, angles and shares stay. The passive joint's motor has
       no more torque than in the plant;
    3. a perfect loop, and design C.1 as identified where neither a plant nor a domain is given.

    Without a plant, the domain's own plants count as well as its loop.

    Args:
        plant: a plant, the name of a shipped one, or a file, which may have ranges and a loop; or a domain.
        domain: a domain, the name of a shipped domain or plant, a YAML file, its content, or "none" for a perfect
            loop. Contents are values by name: a number, or a range of two, and perhaps ``plant`` and ``design``,
            plants or names or files of plants, and ``velocities``.
        share: a plant without ranges is a guess: masses and inertias are off by up to this share, friction and
            rotors by five times that.

    Raises:
        SwingupError: there is no such plant or domain, a file cannot be read, or its content makes no pendulum.
    """
    found = None if domain is None or domain == NO_LOOP else _find(domain)
    if plant is None and found is not None:
        return found
    facts = _guessed(_find_plant(PLANT_ALONE if plant is None else plant), share)
    return facts if found is None else _in_loop(facts, found)


def _find(source: Domain | Mapping[str, Any] | str | Path) -> Domain:
    if isinstance(source, Domain):
        return source
    if isinstance(source, Mapping):
        return _domain_of(source)
    source = str(source)
    if source in SHIPPED_DOMAINS:
        with resources.as_file(resources.files(__package__) / "domains" / f"{source}.yml") as path:
            return _domain_of(read_map(path, "domain"), source)
    if source in SHIPPED_PLANTS or is_model_file(source):
        return _find_plant(source)
    if not has_suffix(source, *PARAMETER_FILES):
        one_of("domain", source, (*SHIPPED_DOMAINS, *SHIPPED_PLANTS), " or a YAML file (.yml)")
    with naming(f"domain {one_line(source)}"):
        return _domain_of(read_map(source, "domain"), source, Path(source).parent)


def _find_plant(source: PlantLike | Domain) -> Domain:
    if isinstance(source, Domain):
        return source
    if not isinstance(source, Plant) and has_suffix(source, *PARAMETER_FILES) and Path(source).is_file():
        return _find(source)
    found = load_plant(source)
    return _domain_of({"plant": found}, found.name)


def _domain_of(content: Mapping[str, Any], name: str = "DOMAIN.yml", folder: str | Path = ".") -> Domain:
    """A domain from its content; files of other plants that it names are in the folder."""
    values = dict(content)
    velocities = values.pop("velocities", None)
    named, design = (
        source if source is None or isinstance(source, Plant) else base_plant(source, folder)
        for source in (values.pop("plant", None), values.pop("design", None))
    )
    ranges = {each: _range(each, value) for each, value in values.items()}
    ends = with_both_limits(ranges)
    if named is None and not ends.keys() >= set(PLANT):
        raise SwingupError(
            f"domain {one_line(name)} lacks its plant: add 'plant', one of {', '.join(SHIPPED_PLANTS)}, "
            f"{PLANT_FILES}, or all values of one"
        )
    # A plant without ranges is the middle of ranges of one value.
    middles = {each: 0.5 * (low + high) for each, (low, high) in ends.items()}
    plant = make_plant(middles, f"domain {name}", name) if named is None else named
    low, high = (
        PlantInLoop(
            plant.changed(**{each: ends[each][end] for each in ends if each in NAMES}),
            Loop(**{each: ends[each][end] for each in ends if each in VALUES}, velocities=velocities),
        )
        for end in (0, 1)
    )
    # The middle is known once both ends are.
    made = Domain(low, high, tuple(ranges), plant, plant, name)
    return dataclasses.replace(made, design=design or made.nominal_plant)


def _guessed(facts: Domain, share: float | None) -> Domain:
    """The domain of a guess that is off by a share, if one is given; a plant with ranges and the loop stay."""
    if share is None or not facts.knows_plant:
        return facts
    off = dict.fromkeys(("m1", "m2", "I1", "I2"), share)
    # At most all of it: no friction is below 0.
    off |= dict.fromkeys(("b1", "b2", "cf1", "cf2", "Ir"), min(1.0, 5.0 * share))
    plant = facts.nominal_plant

    def end(sign: int, found: PlantInLoop) -> PlantInLoop:
        values = {name: getattr(plant, name) * (1.0 + sign * part) for name, part in off.items()}
        return found._replace(plant=plant.changed(**values))

    return dataclasses.replace(
        facts,
        low=end(-1, facts.low),
        high=end(1, facts.high),
        # Each motor has its own limit among them.
        names=(*NAMES, *(name for name in facts.names if name in VALUES)),
        plant=plant,
        name=f"{facts.name} within {100 * share:g} %",
    )


def _in_loop(facts: Domain, domain: Domain) -> Domain:
    """The plants of a domain in the loop of another one, see :func:`resolve`."""
    for each in (facts, domain):
        if not max(each.nominal.plant.tl1, each.nominal.plant.tl2) > 0:
            raise SwingupError(
                f"{each.name or 'the plant'} has no motor, and the loop of {domain.name} is relative to its "
                "torque: raise tl1 or tl2"
            )
    # A weaker motor has weaker noise, pushes and rate limits; clocks and encoders stay.
    scales = scales_of(facts.nominal_plant).over(scales_of(domain.plant))
    added = [name for name in domain.names if name in VALUES and name not in facts.names]

    def around(mine: PlantInLoop, other: PlantInLoop) -> PlantInLoop:
        loop = scaled(other.loop, scales)
        values = {name: getattr(loop, name) for name in added}
        velocities = mine.loop.velocities or loop.velocities
        return mine._replace(loop=dataclasses.replace(mine.loop, **values, velocities=velocities))

    return dataclasses.replace(
        facts,
        low=around(facts.low, domain.low),
        high=around(facts.high, domain.high),
        names=(*facts.names, *added),
        name=f"{facts.name} in the loop of {domain.name}",
    )


def _range(name: str, value: Any) -> tuple[float, float]:
    one_of("name", name, (*NAMES, TORQUE_LIMIT, *VALUES))
    ends = value if isinstance(value, list | tuple) else [value, value]
    try:
        if bool in map(type, ends):
            raise TypeError("a truth value")
        # YAML reads 4e-5, which has no point, as a text.
        low, high = map(float, ends)
    except (TypeError, ValueError, OverflowError):
        raise SwingupError(f"{name} = {quoted(value)} must be a number, or a range [low, high]") from None
    # Negated, so that NaN is refused as well.
    if not low <= high:
        raise SwingupError(f"{name} = [{low:g}, {high:g}] must be a range from low to high")
    allowed = VALUES.get(name)
    if allowed is not None and not allowed.minimum <= low <= high <= allowed.maximum:
        raise SwingupError(
            f"{name} = [{low:g}, {high:g}] must lie between {allowed.minimum:g} and {allowed.maximum:g}"
        )
    return low, high
