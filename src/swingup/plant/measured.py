"""Plants from what a user knows: a model file, another plant, or what a ruler and a scale say.

A link whose inertia is not given is a uniform rod with a point mass at one end, which puts its centre of mass where
it was measured: at the tip if the centre is beyond the rod's middle, else at the joint. With mass m, length l and
centre r from the joint, the inertia about the joint is m l² (4 r / l - 1) / 3 beyond the middle, 2/3 m r l before.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..common.checks import finite_number, one_of
from ..common.errors import SwingupError
from .equations import mass_entries
from .files import LINK_NUMBERS, is_model_file, load_plant, representative
from .model_file import read_model
from .plant import NAMES, ZEROS, Plant, PlantLike, lump, make_plant

MORE_NAMES = ("Ic1", "Ic2", "motor")
"""What is given beside a plant's numbers: inertias about the centres of mass (kg m²), and the torque of both motors
before their gears (N m)."""

LUMPED_NAMES = {
    "m1r1+m2l1": "k", "theta4": "k", "m2r2": "m2r2", "theta5": "m2r2", "theta3": "coupling",
    "I1+m2l1^2": "shoulder", "theta1": "shoulder", "I1+I2+m2l1^2": "A", "theta2": "B",
}  # fmt: skip
"""Base parameters, as motion tells them, and Spong's θ (IEEE Control Systems 15, 1995); the elbow's, B, is I2."""

DEFAULT_VALUES = {"Ir": 0.0, "gr": 1.0, "b1": 0.0, "b2": 0.0, "cf1": 0.0, "cf2": 0.0, "g": 9.81}
"""Values of what is not measured."""

MOTORS = ("tl1", "tl2")

HUGE_SIZES = {"l": (10.0, "m", "mm"), "m": (100.0, "kg", "g"), "I": (1000.0, "kg m²", "kg mm² or g mm²")}
"""Sizes beyond which a number looks like another unit's."""


class MeasuredPlant(NamedTuple):
    """A plant, and what was assumed or left out."""

    plant: Plant
    notes: list[str]


def measured_plant(
    source: PlantLike | None = None, values: Mapping[str, float] | None = None, inertia: str | None = None
) -> MeasuredPlant:
    """A plant from a source, measured values, or both.

    Args:
        source: a plant, its name or its file; None where the values say all.
        values: numbers by name that replace the source's: a plant's, some of :data:`MORE_NAMES`, or base
            parameters, :data:`LUMPED_NAMES`, in the place of masses, centres and inertias.
        inertia: of a URDF or an MJCF, what its inertias are about: "centre" (of mass) or "joint".

    Raises:
        SwingupError: a name is unknown, a value is missing or given twice, or they make no pendulum.
    """
    given = {name.replace(" ", "").replace("²", "^2"): value for name, value in (values or {}).items()}
    given = {name: finite_number(name, value) for name, value in given.items()}
    for kinds in ({"k"}, {"m2r2"}, {"shoulder", "A"}, {"B"}):
        same = [name for name in given if (LUMPED_NAMES | {"I2": "B"}).get(name) in kinds]
        if len(same) > 1:
            raise SwingupError(f"{' and '.join(same)} say the same: give one of them")
    lumped = {LUMPED_NAMES[name]: given.pop(name) for name in [*given] if name in LUMPED_NAMES}
    measured = {one_of("value", name, (*NAMES, *MORE_NAMES)): value for name, value in given.items()}
    # Before the file is read, whose armature is divided by it.
    if not measured.get("gr", 1.0) > 0:
        raise SwingupError(f"gr = {measured['gr']:g} must be positive")
    known, notes, name = _known(source, measured, inertia)
    facts = known | {each: value for each, value in measured.items() if each in NAMES}
    if "motor" in measured:
        _refuse_both(measured, "motor", *MOTORS)
        # A gear multiplies the motor's torque.
        facts |= dict.fromkeys(MOTORS, measured["motor"] * facts["gr"])
    elif source is None and facts.keys() & set(MOTORS):
        facts = dict.fromkeys(MOTORS, 0.0) | facts
    for each in ("l1", "l2"):
        if not facts.get(each, 1.0) > 0:
            raise SwingupError(f"{each} = {facts[each]:g} must be positive")
    if lumped:
        notes += _build_links(facts, measured, lumped)
    needed = [f"{each}{link}" for each in ("m", "l") for link in (1, 2)]
    missing = [each for each in (*needed, *MOTORS) if each not in facts]
    if missing:
        lacking = "a plant needs" if source is None else f"{name} does not say"
        words = " ".join(f"{each}=VALUE" for each in missing)
        motors = ", and 0 of a joint without a motor" if {*missing} & {*MOTORS} else ""
        raise SwingupError(f"{lacking} {', '.join(missing)}: add --set {words}, in SI units{motors}")
    for link in (1, 2):
        _refuse_both(measured, f"I{link}", f"Ic{link}")
        notes += _complete_link(facts, link, measured)
    plant = make_plant(facts, "the plant", name)
    return MeasuredPlant(plant, [*notes, *_check(plant, measured)])


def _known(
    source: PlantLike | None, measured: Mapping[str, float], inertia: str | None
) -> tuple[dict[str, float], list[str], str]:
    """Numbers that a source has, its notes and its name."""
    if isinstance(source, str | Path) and is_model_file(source):
        model = read_model(source, inertia, measured.get("gr"))
        # A given length replaces the one that the file's shapes suggest.
        notes = [note for note in model.notes if not ("l2" in measured and note.startswith("l2 = "))]
        return dict(model.facts), notes, str(source)
    if inertia is not None:
        raise SwingupError(f"inertia = {inertia} says how to read a URDF or an MJCF: leave it out")
    if source is None:
        return dict(DEFAULT_VALUES), [], "measured"
    found = load_plant(source)
    return found.values(), [], found.name


def _build_links(facts: dict[str, float], measured: Mapping[str, float], lumped: Mapping[str, float]) -> list[str]:
    """Add masses, centres and inertias that have these base parameters; returns what was assumed."""
    if own := [name for name in measured if name in (*LINK_NUMBERS, "Ic1", "Ic2")]:
        raise SwingupError(f"{own[0]} and base parameters say the same: give I2 and base parameters, or links")
    if "l1" not in facts:
        raise SwingupError("base parameters need l1: add l1=VALUE, in SI units")
    l1, known = facts["l1"], dict[str, float]()
    if {"m1", "m2", "r1", "r2", "I1"} <= facts.keys():  # of the source
        known = {"shoulder": facts["I1"] + facts["m2"] * l1**2, "m2r2": facts["m2"] * facts["r2"]}
        known["k"] = facts["m1"] * facts["r1"] + facts["m2"] * l1
    known |= {"B": facts["I2"]} if "I2" in facts else {}
    known |= lumped
    if "coupling" in lumped:
        implied = lumped["coupling"] / l1
        if not math.isclose(lumped.get("m2r2", implied), implied, rel_tol=0.01):
            raise SwingupError(
                f"theta3 / l1 = {implied:.4g} and m2r2 = {lumped['m2r2']:.4g} say the same: give one"
            )
        known["m2r2"] = implied
    if "A" in lumped and "B" in known:
        known["shoulder"] = lumped["A"] - known["B"]
    texts = {"k": "m1r1+m2l1", "m2r2": "m2r2", "shoulder": "I1+m2l1^2", "B": "I2"}
    if missing := [text for name, text in texts.items() if name not in known]:
        raise SwingupError(
            f"base parameters need {', '.join(missing)} as well: add {missing[0]}=VALUE, in SI units"
        )
    notes = [] if "l2" in facts else [f"assumed: l2 = {l1:g} m, which only pictures and the tip's height show"]
    facts.setdefault("l2", l1)
    base = known | {"A": known["shoulder"] + known["B"]} | {name: facts[name] for name in DEFAULT_VALUES}
    # Masses near those of the source; without one, the lightest that can be built.
    start = dict.fromkeys((*LINK_NUMBERS, "I2"), 1e-6) | dict.fromkeys(MOTORS, 0.0) | ZEROS | facts
    numbers: dict[str, Any] = {name: start[name] for name in NAMES}
    plant = representative(base, Plant(**numbers))
    facts |= {name: float(getattr(plant, name)) for name in (*LINK_NUMBERS, "I2")}
    return [*notes, "m1, m2, r1, r2 and I1 are one choice of many that move alike"]


def _refuse_both(measured: Mapping[str, float], *names: str) -> None:
    both = [name for name in names if name in measured]
    # The others do not exclude one another: tl1 and tl2 may both be given.
    if len(both) > 1 and names[0] in both:
        raise SwingupError(f"{' and '.join(both)} say the same: give one of them")


def _complete_link(facts: dict[str, float], link: int, measured: Mapping[str, float]) -> list[str]:
    """Add a link's centre of mass and inertia; returns what was assumed."""
    mass, length = facts[f"m{link}"], facts[f"l{link}"]
    notes, r, I, about_centre = [], f"r{link}", f"I{link}", f"Ic{link}"  # noqa: E741
    assumed = r not in facts
    centre = facts.setdefault(r, 0.5 * length)
    if about_centre in measured:
        facts[I] = measured[about_centre] + mass * centre**2
    elif I not in facts:
        if not 0 <= centre <= length:
            raise SwingupError(
                f"{r} = {centre:g} m is beyond the ends of link {link}: give {I} or {about_centre} as well"
            )
        share = centre / length
        facts[I] = mass * length**2 * ((4 * share - 1) / 3 if share > 0.5 else 2 / 3 * share)
        end = "" if share == 0.5 else f" with a mass at its {'tip' if share > 0.5 else 'joint'}"
        notes.append(f"assumed: {I} = {facts[I]:.4g} kg m² of a uniform rod{end}")
        return notes
    if assumed:
        notes.append(f"assumed: {r} = {centre:g} m, the middle of link {link}")
    return notes


def _check(plant: Plant, measured: Mapping[str, float]) -> list[str]:
    """Check I ≥ m r², which fitted plants may break and given values may not, and tell the times of swings."""
    notes = []
    for name in ("l1", "l2", "m1", "m2", "I1", "I2"):
        bound, unit, smaller = HUGE_SIZES[name[0]]
        if getattr(plant, name) > bound:
            notes.append(f"{name} = {getattr(plant, name):g} {unit} is huge: is it in {smaller}?")
    for link in (1, 2):
        inertia, point = getattr(plant, f"I{link}"), getattr(plant, f"m{link}") * getattr(plant, f"r{link}") ** 2
        if inertia < point * (1 - 1e-9):
            low = (
                f"I{link} = {inertia:.4g} kg m² is below m{link} r{link}² = {point:.4g}, the minimum of a body "
                f"about its joint: if it is about the centre of mass, give Ic{link}"
            )
            if {f"I{link}", f"Ic{link}"} & measured.keys():
                raise SwingupError(low)
            notes.append(low)
    # Times that a stopwatch can check are the best test of numbers from a ruler.
    lumped = lump(plant)
    m11, m12, m22 = mass_entries(lumped, 1.0)
    pull = np.array([[lumped.gravity1 + lumped.gravity2, lumped.gravity2], [lumped.gravity2, lumped.gravity2]])
    squares = np.linalg.eigvals(np.linalg.solve(np.array([[m11, m12], [m12, m22]]), pull)).real
    if (squares > 0).all():
        slow, fast = (2 * math.pi / math.sqrt(square) for square in sorted(squares))
        notes.append(f"small swings about hanging take {slow:.3g} s, and {fast:.3g} s with the links opposed")
    return notes
