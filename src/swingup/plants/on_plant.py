"""A domain's loop around another plant, in that pendulum's own units."""

import dataclasses

from ..errors import SwingupError
from ..physics.plant import PlantLike, load_plant
from ..physics.units import Scales, scales_of
from .domain import PLANT, Domain

DRIVEN_LIMIT = "torque_limit"
"""A domain's limit of the driven motor: the plant has its own."""


def on_plant(domain: Domain, plant: PlantLike) -> Domain:
    """The domain's loop around a plant: torques and velocities in its units, delays and periods as they are.

    Args:
        domain: one without values of the plant's own, as ``identified``.
        plant: a plant, its name or its file.

    Raises:
        SwingupError: there is no such plant, it has no units, or the domain has values or ranges of its plant.
    """
    found, own = load_plant(plant), [name for name, _, _ in domain.ranges if name in PLANT]
    if own or domain.plant is not None:
        what = f"values of its own plant ({', '.join(own)})" if own else f"the plant {domain.plant}"
        raise SwingupError(
            f"domain {domain.name} has {what}: choose a domain without, as identified, or write plant: NAME and "
            "your ranges into its file"
        )
    units = _units(scales_of(found))
    ranges = tuple(
        (name, low * units.get(name, 1.0), high * units.get(name, 1.0))
        for name, low, high in domain.ranges
        if name != DRIVEN_LIMIT
    )
    return dataclasses.replace(domain, ranges=ranges, name=f"{domain.name}, plant {found.name}", plant=found)


def _units(scales: Scales) -> dict[str, float]:
    torques = dict.fromkeys(
        ("passive_limit", "torque_noise", "ripple", "push", "passive_push"), scales.torque_limit
    )
    return torques | {
        "rate_limit": scales.torque_limit / scales.time,
        "velocity_noise": scales.velocity,
    }
