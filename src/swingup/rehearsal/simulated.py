"""The robot that a rehearsal simulates: one plant, and the loop around it."""

import dataclasses
from pathlib import Path

from ..physics.plant import PlantLike, load_plant
from ..plants.domain import Domain, load_domain
from ..plants.loop import EVERY_LOOP
from ..robots import Robot

RECORDED = "recorded"
"""The domain of a rehearsal that names none: design C.1 in its loop, as recordings show them."""

TORQUES = ("passive_limit", "torque_noise", "rate_limit", "ripple", "push", "passive_push")
"""Torques of a loop besides its limit, which scale with it (N m, N m/s)."""


def simulated_robot(plant: PlantLike | None, domain: Domain | str | None, robot: Robot) -> Domain:
    """Plant and loop as one domain.

    The driven motor gives the plant's torque limit or the loop's, whichever is lower. Around a plant with weaker
    motors the loop's other torques are smaller in the same proportion.

    Args:
        plant: the plant, with the loop that its file has; None for the domain's.
        domain: the loop that the plant's file lacks, and the plant if none is given; None for a perfect loop.
        robot: which joint is driven.

    Raises:
        SwingupError: there is no such plant or domain.
    """
    around = load_domain(domain) if isinstance(domain, str) else domain or Domain((), "a perfect loop")
    if plant is None:
        return around
    facts = plant_as_domain(plant)
    own, (limit, scale) = facts.names, _torque_limit(facts, around, robot)
    loop = [
        (name, *((low * scale, high * scale) if name in TORQUES else (low, high)))
        for name, low, high in around.ranges
        if name in EVERY_LOOP and name not in {*own, "torque_limit"}
    ]
    if "torque_limit" not in own:
        loop.append(("torque_limit", limit, limit))
    return dataclasses.replace(
        facts,
        ranges=(*facts.ranges, *loop),
        name=f"{facts.name} in the loop of {around.name}" if around.ranges else facts.name,
        velocities=facts.velocities or around.velocities,
    )


def plant_as_domain(plant: PlantLike) -> Domain:
    """A plant as a domain; its file may have a loop and ranges as well.

    Raises:
        SwingupError: there is no such plant, or its file makes none.
    """
    if isinstance(plant, str | Path) and Path(plant).suffix in (".yml", ".yaml") and Path(plant).is_file():
        return load_domain(plant)
    found = load_plant(plant)
    return Domain((), found.name, found)


def _torque_limit(facts: Domain, around: Domain, robot: Robot) -> tuple[float, float]:
    """The driven motor's limit (N m), and how much weaker it is than the loop's."""
    motor = facts.middle(("tl1", "tl2")[robot.joint])
    given = {name: high for name, _, high in around.ranges}.get("torque_limit")
    return (motor, 1.0) if given is None else (min(motor, given), min(motor / given, 1.0))
