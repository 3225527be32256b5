"""The loop of a domain around another plant, in that pendulum's own units."""

import dataclasses
from pathlib import Path

from ..common.files import has_suffix
from ..plant.files import PARAMETER_FILES, load_plant
from ..plant.plant import PlantLike
from ..plant.units import scaled, scales_of
from .domain import Domain, PlantInLoop, load_domain, make_domain
from .loop import VALUES

NO_LOOP = "none"
"""The name of a perfect loop among those of domains."""
PLANT_ALONE = "C.1"
"""The plant where neither a plant nor a domain is given: design C.1 as identified, in a perfect loop."""


def loop_around(plant: PlantLike | Domain | None, domain: Domain | str | None) -> Domain:
    """The loop of a domain around a plant, as every command means its options ``--plant`` and ``--domain``.

    Torques, their rates and velocities are in the pendulum's own units, relative to the plant that the domain is
    made for; delays, periods, angles and shares stay. What the plant's file says of its own loop has the last word,
    and its motors keep their limits. Values of the domain's own plant count where the plant is None. Without a
    domain, or with "none", the loop is perfect.
    """
    if isinstance(domain, str):
        domain = None if domain == NO_LOOP else load_domain(domain)
    if plant is None:
        return plant_as_domain(PLANT_ALONE) if domain is None else domain
    facts = plant if isinstance(plant, Domain) else plant_as_domain(plant)
    if domain is None:
        return facts
    # A weaker motor has weaker noise, pushes and rate limits; clocks and encoders stay.
    scales = scales_of(facts.nominal_plant).over(scales_of(domain.plant))
    # What the plant's own file says of its loop stays.
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


def drawn_around(plant: PlantLike, share: float = 0.1) -> Domain:
    """A domain around a guess: masses and inertias are off by a share, friction and rotors by five times that."""
    found = load_plant(plant)
    off = dict.fromkeys(("m1", "m2", "I1", "I2"), share)
    # At most all of it: no friction is below 0.
    off |= dict.fromkeys(("b1", "b2", "cf1", "cf2", "Ir"), min(1.0, 5.0 * share))
    ends = {name: (1.0 - off.get(name, 0.0), 1.0 + off.get(name, 0.0)) for name in found.values()}
    values = {name: [value * end for end in ends[name]] for name, value in found.values().items()}
    domain = make_domain(values, f"{found} within {100 * share:g} %")
    return dataclasses.replace(domain, plant=found, design=found)


def plant_as_domain(plant: PlantLike) -> Domain:
    """A plant as a domain; its file may have a loop and ranges as well."""
    if isinstance(plant, str | Path) and has_suffix(plant, *PARAMETER_FILES) and Path(plant).is_file():
        return load_domain(plant)
    found = load_plant(plant)
    return make_domain({"plant": found}, found.name)
