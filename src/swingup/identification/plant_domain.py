"""Domains around a plant: before it is identified, and after."""

import contextlib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ..common.errors import SwingupError
from ..loop.domain import Domain
from ..loop.loop import VALUES
from ..loop.resolve import resolve
from ..plant.plant import Plant
from .prediction import INDEX, MINIMUM_LAG, vector_of
from .unknowns import MASSES

Range = tuple[float, float]

BASE = (0.8, 1.2)  # base parameters, as multiples of those that a drawing or a fit of another specimen gives
ROTOR = (0.5, 2.5)
FRICTION = (0.4, 1.6)
"""Rotors' inertia and Coulomb friction, as multiples. Source: fits of one robot in several sessions."""
MINIMUM_FRICTION = 0.02  # coulomb friction may reach this part of gravity's torque where the plant has none
DELAY, LAG = (0.001, 0.006), (0.001, 0.004)  # s. Source: fits of recordings.


def prior_around(facts: Domain) -> Domain:
    """A domain around a plant's facts: as wide as specimens of one design, and sessions of one robot, differ.

    What the facts say of the loop stays, and so do the limits of the motors.
    """
    plant = facts.nominal_plant
    vector = vector_of(plant)
    # Friction's size is not known, but it is small beside gravity's torque.
    torque = plant.g * vector[INDEX["k"]]
    vector[INDEX["A"]] -= vector[INDEX["B"]]
    around = dict.fromkeys(MASSES[:4], BASE) | {"Ir": ROTOR, "cf1": FRICTION, "cf2": FRICTION}
    ranges = {name: (low * vector[INDEX[name]], high * vector[INDEX[name]]) for name, (low, high) in around.items()}
    for joint in ("1", "2"):
        low, high = ranges[f"cf{joint}"]
        ranges[f"cf{joint}"] = (min(low, high), max(low, high, MINIMUM_FRICTION * torque))
        damping = vector[INDEX[f"b{joint}"]]
        ranges[f"b{joint}"] = (min(damping, 0.0), max(3 * damping, 0.002 * torque))
    loop = {"delay": DELAY, "lag": LAG, "offset1": (0.0, 0.0), "offset2": (0.0, 0.0)}
    wide = resolve(domain=domain_of(plant, ranges | loop, {}) | {"plant": plant})
    low, high = (mine._replace(plant=end.plant) for mine, end in ((facts.low, wide.low), (facts.high, wide.high)))
    names = (*wide.names, *(name for name in facts.names if name in VALUES))
    prior = replace(facts, low=low, high=high, plant=plant, name=f"around {facts.name}")
    return replace(resolve(prior, wide), names=tuple(dict.fromkeys(names)), name=prior.name)


def domain_of(plant: Plant, ranges: Mapping[str, Range], others: Mapping[str, Any]) -> dict[str, Any]:
    """A domain's content: ranges of plant and loop around an identified plant.

    Where corners of wide ranges do not make a pendulum, all ranges are narrowed together until they do. Ranges are
    of the base parameters, ``delay`` and ``lag`` (s); instead of A, of I1 + m2 l1² = A - B. Other entries stay as
    they are: offsets, quanta, torque gains, and where velocities come from.
    """
    for narrowing in (1.0, 0.7, 0.5, 0.3, 0.15):
        content = {**_content(plant, ranges, narrowing), **others}
        with contextlib.suppress(SwingupError):
            resolve(domain=content)
            return content
    content = {**_content(plant, ranges, 0.0), **others}
    resolve(domain=content)
    return content


def _content(p: Plant, ranges: Mapping[str, Range], narrowing: float) -> dict[str, float | list[float]]:
    first, second, shoulder, elbow = (ranges[name] for name in ("k", "m2r2", "A", "B"))
    weight, inertia = float(p.m2 * p.l1), float(p.m2 * p.l1**2)
    # The masses stay: a range of a base parameter is one of the centre of mass or the inertia.
    spans: dict[str, Range] = {
        "r1": ((first[0] - weight) / float(p.m1), (first[1] - weight) / float(p.m1)),
        "r2": (second[0] / float(p.m2), second[1] / float(p.m2)),
        "I1": (shoulder[0] - inertia, shoulder[1] - inertia),
        "I2": elbow,
        **{name: ranges[name] for name in ("Ir", "b1", "b2", "cf1", "cf2")},
    }
    kept = ("m1", "m2", "l1", "l2", "gr", "g")
    content: dict[str, float | list[float]] = {name: float(getattr(p, name)) for name in kept}
    for name, (low, high) in spans.items():
        value = float(getattr(p, name))
        content[name] = [value + narrowing * min(low - value, 0.0), value + narrowing * max(high - value, 0.0)]
    content |= {"tl1": float(p.tl1), "tl2": float(p.tl2)}
    # Measured torques may be later than those that act, which a fit sees as a delay below 0. A loop has none.
    content["delay"] = [max(end, 0.0) for end in ranges["delay"]]
    content["lag"] = [max(end, MINIMUM_LAG) for end in ranges["lag"]]
    return content
